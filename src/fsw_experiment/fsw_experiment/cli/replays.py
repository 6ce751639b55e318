"""``fsw.py bag verify`` and ``fsw.py bag shadow``: controllers on a recorded weld."""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path
from typing import Any

from fsw_analysis.changes import cut_to_scenario
from fsw_analysis.shadow import compare_shadow, missed_samples
from fsw_analysis.signals import load_weld
from fsw_analysis.verify import Make, recorded_controllers, verify
from fsw_experiment.cli.bags import add_command, print_notes, read_weld, write_json
from fsw_experiment.cli.errors import CommandError
from fsw_experiment.cli.progress import ProgressBar
from fsw_experiment.cli.simulate import assignment
from fsw_experiment.controllers import CONTROLLER_MODULES, KNOWN
from fsw_experiment.shadow_run import ShadowRun
from fsw_recorder.player import check_rate

_RATE = 5.0


def add_commands(commands: Any) -> None:
    """Add the commands to the subcommands of ``bag``."""
    check = add_command(
        commands,
        "verify",
        _verify,
        "replay controllers on a bag and compare with the recorded proposals, bit by bit",
        "bag of a weld, recorded from its start",
        "Drive controllers by a bag instead of the clock and compare their proposals with the recorded "
        "ones, bit by bit. Exit code 0: all equal; 1: they differ, or the bag cannot be replayed.",
    )
    check.add_argument("--controller", metavar="NAME", help="replay only this one (default: all in the bag)")
    check.add_argument("--class", dest="kind", metavar="MODULE:CLASS", help="class of a controller of your own")
    check.add_argument(
        "--parameters", metavar="PACKAGE:FILE", help="parameter descriptions of a controller of your own"
    )

    shadow = add_command(
        commands,
        "shadow",
        _shadow,
        "replay a weld to a controller and compare its proposals with what was applied",
        description="Replay the measurements, set-points and commands of a bag to a controller that runs in shadow, "
        "record its proposals and compare them with what was applied in the weld.",
    )
    shadow.add_argument("--controller", metavar="NAME", required=True, help="decentral, nmpc, or a name of your own")
    shadow.add_argument("--module", help="Python module that runs a controller of your own as a node")
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


def _verify(arguments: argparse.Namespace) -> int:
    recorded = recorded_controllers(arguments.bag)
    names = [arguments.controller] if arguments.controller else recorded
    if not recorded or not set(names) <= set(recorded):
        raise CommandError(f"{arguments.bag}: no proposals of {', '.join(names) or 'any controller'} in this bag")
    identical = True
    for name in names:
        make, parameters = _controller(name, arguments.kind, arguments.parameters)
        result = verify(arguments.bag, name, make, parameters)
        print_notes(result.notes)
        print("\n".join(result.lines()), flush=True)
        identical &= result.identical
    return 0 if identical else 1


def _controller(name: str, kind: str | None, parameters: str | None) -> tuple[Make, tuple[str, str] | None]:
    """Class of a controller, and where its parameters are described."""
    if kind is None and name not in KNOWN:
        raise CommandError(f"controller {name} is not one of {', '.join(KNOWN)}; give its class with --class")
    described: tuple[str, ...] = tuple(parameters.split(":")) if parameters else ()
    if kind is not None:
        module, _, class_name = kind.partition(":")
    else:
        module, class_name, file, _ = KNOWN[name]
        described = described or (module, file)
    if len(described) not in (0, 2):
        raise CommandError(f"--parameters {parameters}: write PACKAGE:FILE")
    try:
        made = getattr(import_module(module), class_name)
    except (ImportError, AttributeError, ValueError) as error:
        raise CommandError(f"controller {name} is not available: {error}") from None
    return (made, (described[0], described[1])) if described else (lambda _: made(), None)


def _shadow(arguments: argparse.Namespace) -> int:
    check_rate(arguments.rate)
    source, name = arguments.bag, arguments.controller
    module = arguments.module or _module_of(name)
    parameters = dict(assignment("--set", text) for text in arguments.parameters)
    weld = read_weld(source)
    folder = arguments.out or source.absolute().parent / f"{source.absolute().name}_shadow_{name}"
    shadow = ShadowRun(source, folder, name, module, arguments.rate, arguments.duration, parameters)
    with ProgressBar(f"{name} in shadow") as bar:
        shadow.run(weld, bar)
    missed = missed_samples(shadow.recorded, name)
    report = compare_shadow(cut_to_scenario(weld), load_weld(shadow.recorded), name, missed)
    print("\n".join(report.lines()))
    print(f"proposals recorded in {shadow.recorded}")
    write_json(arguments.json, report.values())
    return 0


def _module_of(name: str) -> str:
    if name not in KNOWN:
        known = ", ".join(KNOWN)
        raise CommandError(f"controller {name} is not one of {known}; give the module that runs it with --module")
    return CONTROLLER_MODULES[name]
