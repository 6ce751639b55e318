"""Check of a command: finite, in bounds, no jump. A bad command is rejected, never corrected."""

from __future__ import annotations

from enum import StrEnum
from math import isfinite
from typing import NamedTuple

from fsw_control.contract import Command, Limits

#: excess over a limit that is rounding of the unit conversion, not a violation [kN, rpm]
ROUNDING = 1e-6


class Flaw(StrEnum):
    """Reasons for rejecting a command."""

    NOT_FINITE = "not_finite"
    OUT_OF_RANGE = "out_of_range"
    JUMP = "jump"


class Refusal(NamedTuple):
    """Why a command is rejected, as a code and in words."""

    flaw: Flaw
    words: str


def refusal(
    command: Command, limits: Limits | None = None, previous: Command | None = None
) -> Refusal | None:
    """Return why ``command`` must not be applied, None if it may be.

    Without ``limits`` it only has to be finite. Without ``previous``, the command of the previous
    tick, the change is not checked.
    """
    force, speed = command.force_kn, command.speed_rpm
    if not (isfinite(force) and isfinite(speed)):
        return Refusal(Flaw.NOT_FINITE, f"not finite: force {force} kN, speed {speed} rpm")
    if limits is None:
        return None
    for name, unit, value, low, high in (
        ("force", "kN", force, limits.force_min_kn, limits.force_max_kn),
        ("speed", "rpm", speed, limits.speed_min_rpm, limits.speed_max_rpm),
    ):
        if not low - ROUNDING <= value <= high + ROUNDING:
            return Refusal(
                Flaw.OUT_OF_RANGE,
                f"{name} {value:.3f} {unit} is outside {low:g} to {high:g} {unit}",
            )
    if previous is not None:
        for name, unit, change, largest in (
            ("force", "kN", force - previous.force_kn, limits.force_step_kn),
            ("speed", "rpm", speed - previous.speed_rpm, limits.speed_step_rpm),
        ):
            if abs(change) > largest + ROUNDING:
                words = (
                    f"{name} would jump by {abs(change):.3f} {unit}, "
                    f"more than {largest:g} {unit} per tick"
                )
                return Refusal(Flaw.JUMP, words)
    return None
