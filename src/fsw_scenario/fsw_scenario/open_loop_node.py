"""The open-loop controller as a node."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

from fsw_control import run_controller
from fsw_scenario.parameters import OpenLoopParameters
from fsw_scenario.plants import plant_of
from fsw_scenario.scenario_file import load
from fsw_scenario.timeline import OpenLoopController


def _make(values: Mapping[str, Any]) -> OpenLoopController:
    scenario = load(values["scenario"])
    return OpenLoopController(
        scenario, plant_of(scenario).applied, from_first_tick=values["from_first_tick"]
    )


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run_controller(
        _make,
        name=OpenLoopController.name,
        parameters=OpenLoopParameters,
        args=args,
    )


if __name__ == "__main__":
    sys.exit(main())
