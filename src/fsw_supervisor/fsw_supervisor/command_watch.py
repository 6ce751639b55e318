"""Tells the commands that are sent here from those of other writers."""

from __future__ import annotations

from collections import deque

from fsw_control.contract import Command
from fsw_supervisor.tick import Decision, same

#: time for which a foreign command counts as recent [s]
_FOREIGN_S = 5.0


class CommandWatch:
    """Compares what appears on the command topic with what was sent.

    Attributes
    ----------
    foreign_commands : int
        Commands of other writers since the start.
    foreign_tick : int
        Number of the tick in which the last of them arrived.
    """

    def __init__(self) -> None:
        self.foreign_commands = 0
        self.foreign_tick = -10
        self._sent: deque[Decision] = deque(maxlen=50)
        self._foreign_s: float | None = None

    def sent(self, decision: Decision) -> None:
        """Record a decision that is sent."""
        self._sent.append(decision)

    def is_own(self, stamp_ns: int, source: str, command: Command) -> bool:
        """Whether a command was sent here; each counts once."""
        for decision in self._sent:
            if decision.stamp_ns == stamp_ns and decision.source == source and same(decision.command, command):
                self._sent.remove(decision)
                return True
        return False

    def note_foreign(self, now_s: float, tick: int) -> bool:
        """Record a foreign command; returns whether it is the first for a while."""
        first = not self.seen_lately(now_s)
        self.foreign_commands += 1
        self._foreign_s, self.foreign_tick = now_s, tick
        return first

    def seen_lately(self, now_s: float) -> bool:
        """Whether another writer has sent commands lately."""
        return self._foreign_s is not None and now_s - self._foreign_s <= _FOREIGN_S
