"""Requests rejected before they reach the graph: they would trip an interlock or change nothing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fsw_control.ranges import beyond_trip
from fsw_hmi.answers import REFUSED, Answer, Code
from fsw_hmi.requests import AcknowledgeStop, Action, ChangeMode, SetReference, Switch

_SAME = 1e-6


def why_not(
    action: Action,
    state: Mapping[str, Any] | None,
    in_force: tuple[float, float] | None,
    interlocks: Mapping[str, float],
) -> Answer | None:
    """Reason for refusing an action before it is sent; None: send it. A safe stop is always sent.

    ``state`` is the supervisor's, as the page gets it (None: not known now), ``in_force`` are
    set-points in mm and degC (None: not known, or others are to come), and ``interlocks`` are
    parameters of the supervisor.
    """
    if isinstance(action, SetReference):
        wanted = action.depth_mm, action.temperature_c
        pairs = zip(wanted, in_force or (), strict=False)
        if in_force and all(abs(one - other) <= _SAME for one, other in pairs):
            return Code.IN_FORCE.refused()
        why = beyond_trip(*wanted, interlocks)
        return Answer(REFUSED, why.code, why.words) if why else None
    if state is None:
        return None
    mode, commanding = state["actual_mode"], state["actual_controller"]
    nominal = mode == state["target_mode"] == "auto" and commanding == state["target_controller"]
    if isinstance(action, Switch) and nominal and action.controller == commanding:
        return Code.COMMANDS_ALREADY.refused(controller=commanding)
    readmits = any(one["inhibited"] for one in state["controllers"])
    if isinstance(action, ChangeMode) and action.mode == "auto" and nominal and not readmits:
        return Code.AUTO_ALREADY.refused()
    if isinstance(action, AcknowledgeStop) and mode != "safe_stop":
        return Code.NO_STOP.refused()
    if isinstance(action, AcknowledgeStop) and state["acknowledged"]:
        return Code.STOP_ACKNOWLEDGED.refused()
    return None
