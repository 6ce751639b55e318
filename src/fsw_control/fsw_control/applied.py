"""Which command was in force when a measurement was taken."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

from fsw_control.command_check import refusal
from fsw_control.contract import Command

#: Periods of the measurements without a command after which its writer counts as silent.
SILENT_PERIODS = 1.5
#: More than a controller ever lags behind.
_KEPT = 100
_BEFORE_ALL_NS = -1
#: A command further than this from the newest measurement belongs to another time base.
_REACH_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class AppliedCommand:
    """A message seen on the command topic.

    ``stamp_ns`` is that of the measurement that it answers, ``source`` who computed it, ``writer``
    which supervisor sent it (empty where that is not given), and ``term`` the number of that
    supervisor's lead.
    """

    stamp_ns: int
    command: Command
    source: str = ""
    writer: str = ""
    healthy: bool = True
    term: int = 0


class AppliedCommands:
    """Commands by the stamp of the measurement that each answers; as in the plant, the first of each stamp counts.

    While another controller is in command, the command that answers a tick may arrive before this
    controller has seen all of the tick's samples. The one to follow is the command before that.

    Any node can write to the topic. So one writer is followed. One of a greater term (a standby
    that takes over) is followed at once, one of a smaller term never, another one only after the
    first has fallen silent.

    Until the first command ``initial`` is taken as applied.
    """

    def __init__(self, initial: Command, period_s: float = 0.1) -> None:
        self._silence_s = SILENT_PERIODS * period_s
        self._kept: deque[AppliedCommand] = deque(
            [AppliedCommand(_BEFORE_ALL_NS, initial)], maxlen=_KEPT
        )
        self._heard_s = 0.0
        self.ignored = 0  #: commands rejected since start, not counting repetitions
        self.complaint = ""  #: why the last one was rejected; empty if it was accepted or repeated

    @property
    def latest(self) -> AppliedCommand:
        """The last accepted command."""
        return self._kept[-1]

    def add(self, seen: AppliedCommand, newest_ns: int | None, now_s: float) -> bool:
        """Take a command seen at ``now_s`` on a steady clock; return whether it is accepted.

        ``newest_ns`` is the newest stamp of a measurement, None before the first.
        """
        last = self.latest
        self.complaint = self._complaint(seen, last, newest_ns, now_s)
        if self.complaint:
            self.ignored += 1
            return False
        self._heard_s = now_s
        if seen.stamp_ns <= last.stamp_ns:
            return False
        self._kept.append(seen)
        return True

    def _complaint(
        self, seen: AppliedCommand, last: AppliedCommand, newest_ns: int | None, now_s: float
    ) -> str:
        refused = refusal(seen.command)
        if refused is not None:
            return f"it is {refused.words}"
        if not seen.healthy:
            return "it is marked as not to be applied"
        if newest_ns is not None and abs(seen.stamp_ns - newest_ns) > _REACH_NS:
            return f"it answers {seen.stamp_ns * 1e-9:.1f} s, far from the newest measurement"
        if seen.term < last.term:
            return "its supervisor no longer leads"
        if (
            last.stamp_ns != _BEFORE_ALL_NS
            and seen.writer != last.writer
            and seen.term == last.term
        ):
            skipped = seen.stamp_ns - last.stamp_ns > self._silence_s * 1e9
            if not skipped and now_s - self._heard_s <= self._silence_s:
                return "the supervisor being followed sends commands, too"
            if newest_ns is not None and seen.stamp_ns > newest_ns:
                return "it answers a measurement that does not exist yet"
        if seen.stamp_ns < last.stamp_ns:
            return "a later measurement has been answered already"
        if seen.stamp_ns == last.stamp_ns and seen.command != last.command:
            return "this measurement has been answered already"
        return ""

    def restart(self) -> None:
        """After a jump of time: keep the values in force, forget the stamps."""
        self._kept = deque([replace(self.latest, stamp_ns=_BEFORE_ALL_NS)], maxlen=_KEPT)

    def before(self, tick_ns: int) -> Command:
        """The command in force until the tick of ``tick_ns``; the oldest known one if all are newer."""
        while len(self._kept) > 1 and self._kept[-1].stamp_ns > tick_ns + _REACH_NS:
            self._kept.pop()  # came before there was a measurement to compare it with
        for seen in reversed(self._kept):
            if seen.stamp_ns < tick_ns:
                return seen.command
        return self._kept[0].command
