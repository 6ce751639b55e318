"""Checks of a command: where it is proposed, by itself, and at the actuator end before it acts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf, isfinite
from pathlib import Path
from traceback import extract_tb
from typing import NamedTuple

from fsw_control.coded import Fact, Worded
from fsw_control.contract import Command, Controller, Limits, Measurement, Proposal, Reference
from fsw_control.fence import Barrier
from fsw_control.reason import Reason, ReasonCode
from fsw_control.units import NANOSECONDS

#: excess over a limit that is rounding of the unit conversion, not a violation [kN, rpm]
ROUNDING = 1e-6


class Flaw(Worded):
    """Reasons for rejecting a command."""

    NOT_FINITE = "not finite: {quantity} {value} {unit}"
    OUT_OF_RANGE = "{quantity} {value:.3f} {unit} is outside {low:g} to {high:g} {unit}"
    JUMP = "{quantity} would jump {value:.3f} {unit}, more than {high:g} {unit} per tick"


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


class Rejection(Worded):
    """Reasons for a rejection beside a flaw of the command itself."""

    SOURCE = "source {source!r} is not one of {sources}"
    UNHEALTHY = "{source!r} marked it as not to be applied"
    FUTURE = "it answers {stamp_s:.1f} s, which has not been measured yet"
    REPEATED = "{stamp_s:.1f} s or a later measurement has been answered already"
    TOO_OLD = "it answers a measurement {age_s:.1f} s old"


#: codes of all rejections, the fence's too
REASONS: tuple[Worded, ...] = (Flaw.NOT_FINITE, Flaw.OUT_OF_RANGE, *Rejection, *Barrier)


class CommandGate:
    """Checks commands and counts rejections.

    A command is accepted if it is within ``limits`` (its change per tick is not checked), answers
    a measurement that is at most ``max_age_s`` old, and comes from one of ``sources`` (empty:
    any).
    """

    def __init__(
        self,
        limits: Limits,
        max_age_s: float,
        sources: Sequence[str] = (),
        more_reasons: Sequence[Worded] = (),
    ) -> None:
        self.configure(limits, max_age_s, sources)
        #: rejected commands for each of ``REASONS`` and of the node's own ``more_reasons``
        self.refused: dict[str, int] = dict.fromkeys(map(str, (*REASONS, *more_reasons)), 0)
        self.last: Fact | None = None  #: the last rejection
        self.last_stamp_ns: int | None = None  #: of the last measurement that was answered

    def configure(self, limits: Limits, max_age_s: float, sources: Sequence[str] = ()) -> None:
        """Apply new settings; the counts and the last stamp stay."""
        self.limits, self.max_age_s = limits, max_age_s
        self.sources: tuple[str, ...] = tuple(sources)

    def check(
        self, command: Command, stamp_ns: int, source: str, healthy: bool, measured_ns: int | None
    ) -> str:
        """Return why a command is rejected (one of ``REASONS``), empty if it is accepted.

        ``stamp_ns`` is the stamp of the measurement that it answers, ``measured_ns`` that of the
        last measurement (None before the first one); ``healthy`` is whether its sender marked it
        as applicable.
        """
        why = self._refusal(command, stamp_ns, source, healthy, measured_ns)
        if why is None:
            self.last_stamp_ns = stamp_ns
            return ""
        return self.refuse(why)

    def refuse(self, why: Fact) -> str:
        """Count a rejected command; returns the code of its reason."""
        self.refused[why.code] += 1
        self.last = why
        return why.code

    def _refusal(
        self, command: Command, stamp_ns: int, source: str, healthy: bool, measured_ns: int | None
    ) -> Fact | None:
        if self.sources and source not in self.sources:
            allowed = tuple(sorted(self.sources))
            return Fact.of(Rejection.SOURCE, source=source, sources=allowed)
        wrong = refusal(command, self.limits)
        if not healthy and (wrong is None or wrong.flaw is not Flaw.NOT_FINITE):
            return Fact.of(Rejection.UNHEALTHY, source=source)
        if wrong is not None:
            return wrong.fact
        stamp_s = stamp_ns / NANOSECONDS
        if measured_ns is None or stamp_ns > measured_ns:
            return Fact.of(Rejection.FUTURE, stamp_s=stamp_s)
        # A last answer newer than the last measurement dates from before the clock was set back.
        if self.last_stamp_ns is not None and stamp_ns <= self.last_stamp_ns <= measured_ns:
            return Fact.of(Rejection.REPEATED, stamp_s=stamp_s)
        if measured_ns - stamp_ns > round(self.max_age_s * NANOSECONDS):
            return Fact.of(Rejection.TOO_OLD, age_s=(measured_ns - stamp_ns) / NANOSECONDS)
        return None

    def total(self) -> int:
        """Number of rejected commands, all reasons together."""
        return sum(self.refused.values())


#: reason of a controller without set-points
NO_SET_POINT = Reason(ReasonCode.NO_SET_POINT)


def answer(
    controller: Controller,
    measurement: Measurement,
    reference: Reference | None,
    applied: Command,
    dt_s: float,
) -> Proposal:
    """Step ``controller`` and return its proposal, marked unhealthy if it must not be applied.

    It is unhealthy, with a :class:`~fsw_control.reason.Reason`, if the controller raises, if its
    command is not finite, if a sensor that it needs is invalid, or if there is no set-point yet
    (the controller is not stepped then). An unusable command is replaced by ``applied``. The
    arguments are those of :meth:`fsw_control.Controller.step`.
    """
    if reference is None:
        return Proposal(applied, healthy=False, reason=NO_SET_POINT)
    m, needed = measurement, []
    try:
        proposal = controller.step(measurement, reference, applied, dt_s)
        refused = refusal(proposal.command)
        if proposal.healthy not in (True, False) or not isinstance(proposal.reason, str | Reason):
            raise TypeError(f"healthy is {proposal.healthy!r}, reason is {proposal.reason!r}")
        if not (m.depth_valid and m.torque_valid and m.temperature_valid):
            tolerated = controller.tolerated_sensors
            needed = [name for name in m.invalid_sensors() if name not in tolerated]
    except Exception as error:
        # A user's controller may fail in any way; the weld must continue under another one.
        raised = Reason(ReasonCode.RAISED, detail=_detail(error))
        return Proposal(applied, healthy=False, reason=raised)
    if refused is not None:
        return Proposal(applied, False, refused.reason, proposal.diagnosis)
    if proposal.healthy and needed:
        reason = Reason(ReasonCode.INVALID_SENSOR, tuple(needed))
        return replace(proposal, healthy=False, reason=reason)
    if isinstance(proposal.reason, str):
        return replace(proposal, reason=Reason.of(proposal.reason))
    return proposal


def _detail(error: Exception) -> str:
    """The error in one line, with the place in the controller's file where it was raised."""
    frame = extract_tb(error.__traceback__)[-1]
    where = "" if frame.filename == __file__ else f" ({Path(frame.filename).name}:{frame.lineno})"
    return f"{type(error).__name__}: {' '.join(str(error).split())}{where}"
