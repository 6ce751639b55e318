"""What is not even asked for: requests that would trip an interlock, or change nothing. The rest the graph decides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import nan
from typing import Any

from fsw_hmi.limits import beyond_trip
from fsw_hmi.requests import AcknowledgeStop, Action, ChangeMode, SetReference, Switch

_SAME = 1e-6


@dataclass(frozen=True, slots=True)
class Known:
    """What is known of the weld now; what is outdated is left out.

    Attributes
    ----------
    state : mapping or None
        The supervisor's, as the page gets it.
    depth_mm, temperature_c : float
        Set-points in force, NaN where unknown or others are to come.
    interlocks : mapping of str to float
        Parameters of the supervisor.
    """

    state: Mapping[str, Any] | None = None
    depth_mm: float = nan
    temperature_c: float = nan
    interlocks: Mapping[str, float] = field(default_factory=dict)


def why_not(action: Action, known: Known) -> str:
    """Why an action is refused before it is sent; empty if it is not. A safe stop never is."""
    if isinstance(action, SetReference):
        return _set_points(action, known)
    return _supervisor(action, known.state) if known.state is not None else ""


def _set_points(action: SetReference, known: Known) -> str:
    off = abs(action.depth_mm - known.depth_mm), abs(action.temperature_c - known.temperature_c)
    if all(one <= _SAME for one in off):
        return "these set-points are in force already"
    return beyond_trip({"depth_mm": action.depth_mm, "temperature_c": action.temperature_c}, known.interlocks)


def _supervisor(action: Action, state: Mapping[str, Any]) -> str:
    mode, commanding = state["actual_mode"], state["actual_controller"]
    nominal = mode == state["target_mode"] == "auto" and commanding == state["target_controller"]
    if isinstance(action, Switch) and nominal and action.controller == commanding:
        return f"{commanding} commands already"
    readmits = any(one["inhibited"] for one in state["controllers"])
    if isinstance(action, ChangeMode) and action.mode == "auto" and nominal and not readmits:
        return "the mode is auto already"
    if isinstance(action, AcknowledgeStop) and mode != "safe_stop":
        return "there is no safe stop to acknowledge"
    if isinstance(action, AcknowledgeStop) and state["acknowledged"]:
        return "the safe stop is acknowledged already"
    return ""
