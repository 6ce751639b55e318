"""Tells the arbiter's own commands on the command topic from those of others."""

from __future__ import annotations

from collections import deque

from fsw_control.contract import Command
from fsw_supervisor.checks import same
from fsw_supervisor.tick import Decision

#: for so long a foreign command is remembered [s]
_FOREIGN_S = 5.0


class CommandWatch:
    """What was sent, and what was seen that was not.

    Attributes
    ----------
    foreign_commands : int
        Commands of other writers seen.
    foreign_tick : int
        Number of the tick in which the last of them came.
    """

    def __init__(self) -> None:
        self.foreign_commands = 0
        self.foreign_tick = -10
        self._sent: deque[Decision] = deque(maxlen=50)
        self._foreign_s: float | None = None

    def sent(self, decision: Decision) -> None:
        """Note that a decision goes out."""
        self._sent.append(decision)

    def is_own(self, stamp_ns: int, source: str, command: Command) -> bool:
        """Whether a command seen was sent here; each counts once."""
        for decision in self._sent:
            if decision.stamp_ns == stamp_ns and decision.source == source and same(decision.command, command):
                self._sent.remove(decision)
                return True
        return False

    def note_foreign(self, now_s: float, tick: int) -> bool:
        """Note a foreign command; returns whether it is the first for a while."""
        first = not self.seen_lately(now_s)
        self.foreign_commands += 1
        self._foreign_s, self.foreign_tick = now_s, tick
        return first

    def seen_lately(self, now_s: float) -> bool:
        """Whether someone else has written commands lately."""
        return self._foreign_s is not None and now_s - self._foreign_s <= _FOREIGN_S
