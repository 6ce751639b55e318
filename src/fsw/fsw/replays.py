"""``fsw.py bag verify`` and ``fsw.py bag shadow``: controllers on a recorded weld."""

from __future__ import annotations

import argparse
from math import inf
from pathlib import Path
from typing import Any

from fsw.bags import add_command, print_notes, read_weld
from fsw.errors import CommandError
from fsw.outputs import add_force, check_new, write_json
from fsw.progress import ProgressBar
from fsw.simulate import assignment
from fsw_analysis.changes import cut_to_scenario
from fsw_analysis.shadow import compare_shadow, missed_samples
from fsw_analysis.signals import load_weld
from fsw_analysis.verify import recorded_controllers, verify
from fsw_recorder.player import check_rate
from fsw_scenario.controllers import described_in, maker, name_of
from fsw_scenario.scenario import ScenarioError
from fsw_scenario.shadow_run import ShadowRun

_RATE = 5.0
#: another processor changes some 1e-12 of a command; what an operator could notice begins at 1e-4
_TOLERANCE = 1e-9
#: exit code when all that was replayed is equal, but a controller of the bag could not be replayed
_LEFT_OUT = 3
#: exit code when proposals differ, but only those of controllers whose state at the beginning is unknown
_NOT_COMPARABLE = 4
_OWN = "NAME, or MODULE:CLASS or FILE.py:CLASS of one of your own"


def add_commands(commands: Any) -> None:
    """Add the commands to the subcommands of ``bag``."""
    check = add_command(
        commands,
        "verify",
        _verify,
        "replay controllers on a bag and compare with the recorded proposals",
        "bag of a weld, recorded from its start",
        "Drive controllers by a bag instead of the clock and compare their proposals with the recorded "
        "ones. Exit code 0: all equal; 1: they differ, or the bag cannot be replayed; "
        f"{_LEFT_OUT}: equal, but a controller of the bag is not known here and was left out; "
        f"{_NOT_COMPARABLE}: they differ and cannot be compared, as the bag begins in mid-weld.",
    )
    check.add_argument(
        "--controller",
        action="append",
        metavar="NAME",
        help=f"replay this one: {_OWN}; may be repeated (default: all in the bag)",
    )
    check.add_argument(
        "--tolerance",
        type=float,
        default=_TOLERANCE,
        metavar="X",
        help="commands count as equal that differ by up to X (1 + recorded value), in kN or rpm; 0: bit by bit "
        f"(default: {_TOLERANCE:g}, more than another kind of processor changes)",
    )

    shadow = add_command(
        commands,
        "shadow",
        _shadow,
        "replay a weld to a controller and compare its proposals with what was applied",
        description="Replay the measurements, set-points and commands of a bag to a controller that runs in shadow, "
        "record its proposals and compare them with what was applied in the weld.",
    )
    shadow.add_argument("--controller", metavar="NAME", required=True, help=_OWN)
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


def _verify(arguments: argparse.Namespace) -> int:
    if not arguments.tolerance >= 0.0:
        raise CommandError(f"--tolerance {arguments.tolerance:g}: is not 0 or more")
    recorded = recorded_controllers(arguments.bag)
    names = [name_of(label) for label in arguments.controller or ()]
    if not recorded or not set(names) <= set(recorded):
        raise CommandError(f"{arguments.bag}: no proposals of {', '.join(names) or 'any controller'} in this bag")
    code, replayed = 0, 0
    for name in dict.fromkeys(names or recorded):
        try:
            make, parameters = maker(name), described_in(name)
        except ScenarioError as error:
            print_notes([f"{name} is left out: {error}"])
            code = code or _LEFT_OUT
            continue
        result = verify(arguments.bag, name, make, parameters, arguments.tolerance)
        print_notes(result.notes)
        print("\n".join(result.lines()), flush=True)
        if result.beyond and code != 1:
            code = 1 if result.comparable else _NOT_COMPARABLE
        replayed += 1
    if not replayed:
        raise CommandError(f"{arguments.bag}: nothing could be replayed")
    return code


def _shadow(arguments: argparse.Namespace) -> int:
    check_rate(arguments.rate)
    if not 0.0 <= arguments.duration < inf:
        raise CommandError(f"--duration {arguments.duration:g}: give 0 (all of the weld) or more seconds")
    check_new([arguments.json], arguments.force)
    source, name = arguments.bag, name_of(arguments.controller)
    parameters = dict(assignment("--set", text) for text in arguments.parameters)
    weld = read_weld(source)
    folder = arguments.out or source.absolute().parent / f"{source.absolute().name}_shadow_{name}"
    shadow = ShadowRun(source, folder, arguments.controller, arguments.rate, arguments.duration, parameters)
    with ProgressBar(f"{name} in shadow") as bar:
        shadow.run(weld, bar)
    missed = missed_samples(shadow.recorded, name)
    report = compare_shadow(cut_to_scenario(weld), load_weld(shadow.recorded), name, missed)
    print("\n".join(report.lines()))
    print(f"proposals recorded in {shadow.recorded}")
    write_json(arguments.json, report.values())
    return 0
