"""Check of a command: finite, in bounds, no jump. A bad command is rejected, never corrected."""

from __future__ import annotations

from math import inf, isfinite
from typing import NamedTuple

from fsw_control.coded import Fact, Worded
from fsw_control.contract import Command, Limits
from fsw_control.reason import Reason, ReasonCode

#: excess over a limit that is rounding of the unit conversion, not a violation [kN, rpm]
ROUNDING = 1e-6


class Flaw(Worded):
    """Reasons for rejecting a command."""

    NOT_FINITE = "not_finite", "not finite: {quantity} {value} {unit}"
    OUT_OF_RANGE = (
        "out_of_range",
        "{quantity} {value:.3f} {unit} is outside {low:g} to {high:g} {unit}",
    )
    JUMP = "jump", "{quantity} would jump {value:.3f} {unit}, more than {high:g} {unit} per tick"


_UNITS = {"force": "kN", "speed": "rpm"}


class Refusal(NamedTuple):
    """Why a command is rejected."""

    flaw: Flaw
    quantity: str  #: ``force`` or ``speed``
    value: float  #: its value, of a jump its change [kN, rpm]
    low: float = 0.0
    high: float = inf  #: the range of the value

    @property
    def fact(self) -> Fact:
        """The refusal as a fact."""
        data = self._asdict() | {"unit": _UNITS[self.quantity]}
        return Fact(data.pop("flaw"), data)

    @property
    def words(self) -> str:
        """The refusal in words."""
        return self.fact.words

    @property
    def reason(self) -> Reason:
        """The refusal as the reason of a command."""
        return Reason(ReasonCode[self.flaw.name], subject=self.quantity)


def refusal(
    command: Command, limits: Limits | None = None, previous: Command | None = None
) -> Refusal | None:
    """Return why ``command`` must not be applied, None if it may be.

    Without ``limits`` it only has to be finite. Without ``previous``, the command of the previous
    tick, the change is not checked.
    """
    force, speed = command
    for name, value in zip(_UNITS, command, strict=True):
        if not isfinite(value):
            return Refusal(Flaw.NOT_FINITE, name, value)
    if limits is None:
        return None
    for name, value, low, high in (
        ("force", force, limits.force_min_kn, limits.force_max_kn),
        ("speed", speed, limits.speed_min_rpm, limits.speed_max_rpm),
    ):
        if not low - ROUNDING <= value <= high + ROUNDING:
            return Refusal(Flaw.OUT_OF_RANGE, name, value, low, high)
    if previous is not None:
        for name, change, largest in (
            ("force", abs(force - previous.force_kn), limits.force_step_kn),
            ("speed", abs(speed - previous.speed_rpm), limits.speed_step_rpm),
        ):
            if change > largest + ROUNDING:
                return Refusal(Flaw.JUMP, name, change, high=largest)
    return None
