"""Any controller as a node: known by its name, a user's own, or that of an open-loop scenario."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

from fsw_control import run_controller
from fsw_control.schema.models import InputError
from fsw_scenario.controllers import kind_of
from fsw_scenario.parameters import OpenLoopParameters
from fsw_scenario.plants import plant_of
from fsw_scenario.scenario_file import load
from fsw_scenario.timeline import OpenLoopController

_USAGE = "NAME | MODULE:CLASS | FILE.py:CLASS [--help] [--ros-args ...]"


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    program, *words = sys.argv if args is None else args
    if not words or words[0] in ("-h", "--help"):
        print(f"usage: {program.rsplit('/', 1)[-1]} {_USAGE}\n\nNAME --help lists the parameters.")
        return 0 if words else 2
    try:
        kind = kind_of(words[0] if words else "")
    except InputError as error:
        print(f"{program.rsplit('/', 1)[-1]}: {error}", file=sys.stderr)
        return 2
    return run_controller(kind, args=[program, *words[1:]])


def _make(values: Mapping[str, Any]) -> OpenLoopController:
    scenario = load(values["scenario"])
    return OpenLoopController(
        scenario, plant_of(scenario).applied, from_first_tick=values["from_first_tick"]
    )


def open_loop(args: Sequence[str] | None = None) -> int:
    """Run the node of an open-loop scenario; returns the exit code."""
    return run_controller(
        _make,
        name=OpenLoopController.name,
        parameters=OpenLoopParameters,
        args=args,
    )


if __name__ == "__main__":
    sys.exit(main())
