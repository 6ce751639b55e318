"""Acceptance rules for commands, shared by the plant emulator and the machine gateway."""

from __future__ import annotations

from collections.abc import Sequence

from fsw_control.command_check import Flaw, refusal
from fsw_control.contract import Command, Limits
from fsw_control.units import NANOSECONDS

#: Reasons for a rejection; ``leader`` and ``stopped`` come from the fence.
REASONS = (
    "not_finite",
    "out_of_range",
    "unhealthy",
    "source",
    "repeated",
    "too_old",
    "future",
    "leader",
    "stopped",
)


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
        more_reasons: Sequence[str] = (),
    ) -> None:
        self.configure(limits, max_age_s, sources)
        #: rejected commands for each of ``REASONS`` and of the node's own ``more_reasons``
        self.refused = dict.fromkeys((*REASONS, *more_reasons), 0)
        self.last_reason = ""  #: of the last rejection
        self.last_refusal = ""  #: in words
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
        reason, words = self._refusal(command, stamp_ns, source, healthy, measured_ns)
        if reason:
            self.refuse(reason, words)
        else:
            self.last_stamp_ns = stamp_ns
        return reason

    def refuse(self, reason: str, words: str) -> None:
        """Count a rejected command."""
        self.refused[reason] += 1
        self.last_reason, self.last_refusal = reason, f"{reason}: {words}"

    def _refusal(
        self, command: Command, stamp_ns: int, source: str, healthy: bool, measured_ns: int | None
    ) -> tuple[str, str]:
        if self.sources and source not in self.sources:
            return "source", f"source {source!r} is not one of {', '.join(sorted(self.sources))}"
        wrong = refusal(command, self.limits)
        if not healthy and (wrong is None or wrong.flaw is not Flaw.NOT_FINITE):
            return "unhealthy", f"{source!r} marked it as not to be applied"
        if wrong is not None:
            return wrong.flaw, wrong.words
        if measured_ns is None or stamp_ns > measured_ns:
            return "future", f"it answers {stamp_ns * 1e-9:.1f} s, which has not been measured yet"
        # A last answer newer than the last measurement dates from before the clock was set back.
        if self.last_stamp_ns is not None and stamp_ns <= self.last_stamp_ns <= measured_ns:
            return (
                "repeated",
                f"{stamp_ns * 1e-9:.1f} s or a later measurement has been answered already",
            )
        if measured_ns - stamp_ns > round(self.max_age_s * NANOSECONDS):
            return (
                "too_old",
                f"it answers a measurement {(measured_ns - stamp_ns) * 1e-9:.1f} s old",
            )
        return "", ""

    def total(self) -> int:
        """Number of rejected commands, all reasons together."""
        return sum(self.refused.values())
