"""The command ``bag shadow``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from fsw_recorder.errors import BagError
from fsw_recorder.player import check_rate
from fsw_recorder.shadow import compare_shadow, missed_samples
from fsw_recorder.shadow_run import ShadowRun
from fsw_recorder.signals import load_weld

Progress = Callable[[float], None] | None


def add_shadow_command(subparsers: Any, progress: Callable[[], Progress]) -> None:
    """Add ``bag shadow``; ``progress`` makes a function that shows a fraction, or None."""
    command = subparsers.add_parser(
        "shadow",
        help="show a weld to a controller and compare its proposals with what was applied",
        description="Replay the measurements, references and commands of a bag to a controller that runs in shadow, "
        "record its proposals and compare them with what was applied in the weld.",
    )
    command.add_argument("bag", type=Path, help="bag of a weld")
    command.add_argument("--controller", metavar="NAME", required=True, help="decentral, nmpc, or a name of your own")
    command.add_argument("--module", help="Python module that runs an own controller as a node")
    command.add_argument("--rate", type=float, default=5.0, help="weld time per wall time (default: 5)")
    command.add_argument("--duration", type=float, default=0.0, metavar="S", help="only the first seconds of the weld")
    command.add_argument(
        "--set",
        dest="parameters",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="parameter of the controller, instead of the recorded one or the default; may be repeated",
    )
    command.add_argument("--out", type=Path, help="folder for bag and logs (default: <bag>_shadow_<controller>)")
    command.add_argument("--json", type=Path, metavar="FILE", help="also write the differences as JSON")
    command.set_defaults(run=lambda arguments: run_shadow(arguments, progress))


def run_shadow(arguments: argparse.Namespace, progress: Callable[[], Progress]) -> int:
    """``bag shadow``."""
    from fsw_experiment.weld_events import cut_to_scenario

    check_rate(arguments.rate)
    source, name = arguments.bag, arguments.controller
    weld = load_weld(source, progress())
    folder = arguments.out or source.absolute().parent / f"{source.absolute().name}_shadow_{name}"
    shadow = ShadowRun(
        bag=source,
        folder=folder,
        controller=name,
        module=arguments.module or _module_of(name),
        rate=arguments.rate,
        duration_s=arguments.duration,
        parameters=dict(_parameter(text) for text in arguments.parameters),
    )
    shadow.run(weld, progress())
    missed = missed_samples(shadow.recorded, name)
    report = compare_shadow(cut_to_scenario(weld), load_weld(shadow.recorded), name, missed)
    print("\n".join(report.lines()))
    print(f"proposals recorded in {shadow.recorded}")
    if arguments.json is not None:
        try:
            arguments.json.write_text(json.dumps(report.values(), indent=2) + "\n", encoding="utf-8")
        except OSError as error:
            raise BagError(f"{arguments.json}: cannot be written: {error.strerror}") from None
    return 0


def _module_of(name: str) -> str:
    from fsw_experiment.graph import CONTROLLER_MODULES, installed_controllers

    if name not in installed_controllers():
        available = ", ".join(installed_controllers())
        raise BagError(f"controller {name} is not one of {available}; give the module that runs it with --module")
    return CONTROLLER_MODULES[name]


def _parameter(text: str) -> tuple[str, Any]:
    name, separator, value = text.partition("=")
    if not separator or not name.strip():
        raise BagError(f"--set {text}: write NAME=VALUE")
    try:
        return name.strip(), yaml.safe_load(value)
    except yaml.YAMLError:
        return name.strip(), value
