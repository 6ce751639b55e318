"""Parameters of the scenario player, the procedure node and the open-loop controller."""

from __future__ import annotations

from typing import Annotated

from fsw_control.parameters import AT_START, NodeParameters
from fsw_control.schema.models import Many, Whole
from fsw_control.schema.ranges import Range


class PlayerParameters(NodeParameters):
    """Parameters of the scenario player."""

    scenario: Annotated[str, AT_START] = "reference_tracking"
    """Scenario to play: name of a shipped one, or path of a YAML file; empty: the player waits for
    goals of fsw/run_weld."""
    overrides: Annotated[Many[str], AT_START] = ()
    """Entries key=value that replace values of the scenario, e.g. controller=nmpc."""
    heat_file: Annotated[str, AT_START] = ""
    """Heat profile of the type of weld (YAML), published on fsw/heat_plan; empty: none."""
    wait_for_controllers: Annotated[Whole, Range(0, 100, ""), AT_START] = 1
    """The player starts once this many controllers subscribe to fsw/reference; the plant can wait
    for the player."""
    silence_timeout_s: Annotated[float, Range(1.0, 86400.0, "s"), AT_START] = 60.0
    """Wall time without a measurement after which the player exits with an error."""


class ProcedureParameters(NodeParameters):
    """Parameters of the node that reports when a running weld leaves its procedure.

    It commands nothing.
    """

    procedure: Annotated[str, AT_START] = "copper_lid"
    """Welding procedure: YAML file, or name of a shipped one."""


class OpenLoopParameters(NodeParameters):
    """Parameters of the open-loop controller."""

    scenario: Annotated[str, AT_START] = "open_loop_force_steps"
    """Scenario whose command events are proposed: name of a shipped one, or path of a YAML
    file."""
    from_first_tick: Annotated[bool, AT_START] = False
    """Count the scenario's time from the first measurement (wall clock), not from stamp 0
    (simulated time)."""
