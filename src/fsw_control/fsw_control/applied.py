"""The command in force when a measurement was taken, reconstructed from the command topic."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

from fsw_control.command_gate import refusal
from fsw_control.contract import Command

#: A writer is silent once this many measurement periods have passed without a command.
SILENT_PERIODS = 1.5
#: Upper bound on a controller's lag, in commands.
_KEPT = 100
_BEFORE_ALL_NS = -1
#: A command further than this from the newest measurement belongs to another time base.
_REACH_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class AppliedCommand:
    """A message seen on the command topic.

    ``stamp_ns`` is the stamp of the measurement that the command answers, ``source`` the
    controller that computed it, ``writer`` the supervisor that sent it (empty if unknown), and
    ``term`` the number of that supervisor's lead.
    """

    stamp_ns: int
    command: Command
    source: str = ""
    writer: str = ""
    healthy: bool = True
    term: int = 0


class AppliedCommands:
    """Accepted commands, ordered by the stamp of the measurement that each one answers.

    The first command of each stamp counts, as it does in the plant. While another controller is
    in command, the answer to a tick may arrive before this controller has all samples of the
    tick. The command to track is then the one before that answer.

    Any node can publish on the topic, so commands are accepted from one writer only. A writer
    with a higher term (a standby that takes over) replaces it at once, a writer with a lower term
    never does, and any other writer only after the first one has fallen silent.

    Until the first command arrives, ``initial`` counts as applied.
    """

    def __init__(self, initial: Command, period_s: float = 0.1) -> None:
        self._silence_s = SILENT_PERIODS * period_s
        self._kept: deque[AppliedCommand] = deque(
            [AppliedCommand(_BEFORE_ALL_NS, initial)], maxlen=_KEPT
        )
        self._heard_s = 0.0
        self.ignored = 0  #: commands rejected since start, not counting repetitions
        self.complaint = ""  #: why the last one was rejected; empty if accepted or repeated

    @property
    def latest(self) -> AppliedCommand:
        """The last accepted command."""
        return self._kept[-1]

    def add(self, seen: AppliedCommand, newest_ns: int | None, now_s: float) -> bool:
        """Take a command received at ``now_s`` (steady clock); return whether it is accepted.

        ``newest_ns`` is the stamp of the newest measurement, None before the first one.
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
        is_other = seen.writer != last.writer and seen.term == last.term
        if last.stamp_ns != _BEFORE_ALL_NS and is_other:
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
        """After a jump of time: keep the values in force and drop the stamps."""
        self._kept = deque([replace(self.latest, stamp_ns=_BEFORE_ALL_NS)], maxlen=_KEPT)

    def before(self, tick_ns: int) -> Command:
        """Return the command in force until ``tick_ns``, or the oldest known one."""
        while len(self._kept) > 1 and self._kept[-1].stamp_ns > tick_ns + _REACH_NS:
            self._kept.pop()  # received before there was a measurement to compare it with
        for seen in reversed(self._kept):
            if seen.stamp_ns < tick_ns:
                return seen.command
        return self._kept[0].command
