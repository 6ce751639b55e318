"""Whether a command may be applied: finite, inside the bounds, no jump. Refused, never repaired."""

from __future__ import annotations

from enum import StrEnum
from math import isfinite
from typing import NamedTuple, Protocol

from fsw_control.contract import Command, Limits

#: largest excess over a limit that is rounding of the unit conversion and not a violation [kN, rpm]
ROUNDING = 1e-6


class Flaw(StrEnum):
    """What can be wrong with a command."""

    NOT_FINITE = "not_finite"
    OUT_OF_RANGE = "out_of_range"
    JUMP = "jump"


class Refusal(NamedTuple):
    """Why a command is refused, for programs and in words."""

    flaw: Flaw
    words: str


class Bounds(Protocol):
    """Bounds of the manipulated variables, e.g. :class:`fsw_control.Limits`."""

    @property
    def force_min_kn(self) -> float: ...
    @property
    def force_max_kn(self) -> float: ...
    @property
    def speed_min_rpm(self) -> float: ...
    @property
    def speed_max_rpm(self) -> float: ...


def refusal(
    command: Command, bounds: Bounds | None = None, previous: Command | None = None, moves: Limits | None = None
) -> Refusal | None:
    """Why ``command`` may not be applied, None if it may.

    Parameters
    ----------
    command : Command
    bounds : Bounds, optional
        None: it has to be finite only.
    previous, moves : Command, Limits, optional
        Command of the tick before and the largest change; without them the change is not checked.
    """
    force, speed = command.force_kn, command.speed_rpm
    if not (isfinite(force) and isfinite(speed)):
        return Refusal(Flaw.NOT_FINITE, f"not finite: force {force} kN, speed {speed} rpm")
    if bounds is not None:
        for name, unit, value, low, high in (
            ("force", "kN", force, bounds.force_min_kn, bounds.force_max_kn),
            ("speed", "rpm", speed, bounds.speed_min_rpm, bounds.speed_max_rpm),
        ):
            if not low - ROUNDING <= value <= high + ROUNDING:
                return Refusal(Flaw.OUT_OF_RANGE, f"{name} {value:.3f} {unit} is outside {low:g} to {high:g} {unit}")
    if previous is not None and moves is not None:
        for name, unit, change, largest in (
            ("force", "kN", force - previous.force_kn, moves.force_step_kn),
            ("speed", "rpm", speed - previous.speed_rpm, moves.speed_step_rpm),
        ):
            if abs(change) > largest + ROUNDING:
                words = f"{name} would jump by {abs(change):.3f} {unit}, more than {largest:g} {unit} per tick"
                return Refusal(Flaw.JUMP, words)
    return None
