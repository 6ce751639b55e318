"""``fsw.py bag shadow``: a recorded weld replayed to a controller in shadow."""

from __future__ import annotations

import argparse
from math import inf
from pathlib import Path
from typing import Any

from fsw.bags import NAME_OR_CLASS, add_bag_command, read_weld
from fsw.errors import CommandError
from fsw.outputs import add_force, check_new, write_json
from fsw.progress import ProgressBar
from fsw.simulate import assignment
from fsw_analysis.changes import cut_to_scenario
from fsw_analysis.shadow import compare_shadow, missed_samples
from fsw_analysis.signals import load_weld
from fsw_recorder.player import check_rate
from fsw_scenario.controllers import name_of
from fsw_scenario.shadow_run import ShadowRun

_RATE = 5.0


def add_command(commands: Any) -> None:
    """Add the command to the subcommands of ``bag``."""
    shadow = add_bag_command(
        commands,
        "shadow",
        _run,
        "replay a weld to a controller and compare its proposals with what was applied",
        description="Replay the measurements, set-points and commands of a bag to a controller that runs in shadow, "
        "record its proposals and compare them with what was applied in the weld.",
    )
    shadow.add_argument("--controller", metavar="NAME", required=True, help=NAME_OR_CLASS)
    shadow.add_argument("--rate", type=float, default=_RATE, help=f"weld time per wall time (default: {_RATE:g})")
    shadow.add_argument("--duration", type=float, default=0.0, metavar="S", help="only the first seconds of the weld")
    shadow.add_argument(
        "--set",
        dest="parameters",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="parameter of the controller, instead of the recorded one or the default; may be repeated",
    )
    shadow.add_argument("--out", type=Path, help="folder for bag and logs (default: <bag>_shadow_<controller>)")
    shadow.add_argument("--json", type=Path, metavar="FILE", help="also write the differences as JSON")
    add_force(shadow)


def _run(arguments: argparse.Namespace) -> int:
    check_rate(arguments.rate)
    if not 0.0 <= arguments.duration < inf:
        raise CommandError(f"--duration {arguments.duration:g}: give 0 (all of the weld) or more seconds")
    check_new([arguments.json], arguments.force)
    source, name = arguments.bag, name_of(arguments.controller)
    parameters = dict(assignment("--set", text) for text in arguments.parameters)
    folder = arguments.out or source.absolute().parent / f"{source.absolute().name}_shadow_{name}"
    shadow = ShadowRun(source, folder, arguments.controller, arguments.rate, arguments.duration, parameters)
    weld = read_weld(source)
    with ProgressBar(f"{name} in shadow") as bar:
        shadow.run(weld, bar)
    missed = missed_samples(shadow.recorded, name)
    report = compare_shadow(cut_to_scenario(weld), load_weld(shadow.recorded), name, missed)
    print("\n".join(report.lines()))
    print(f"proposals recorded in {shadow.recorded}")
    write_json(arguments.json, report.values())
    return 0
