"""Which command was in force when a measurement was taken."""

from __future__ import annotations

from collections import deque

from fsw_control.contract import Command

#: More than a controller ever lags behind.
_KEPT = 100


class AppliedCommands:
    """Commands by the stamp of the measurement that each answers.

    While another controller is in command, the command that answers a tick may arrive before this controller has
    seen all of the tick's samples. What it shall follow is the command before that.

    Parameters
    ----------
    initial : Command
        Taken as applied until the first command.
    """

    def __init__(self, initial: Command) -> None:
        self._commands: deque[tuple[int, Command, str]] = deque([(-1, initial, "")], maxlen=_KEPT)

    @property
    def latest(self) -> Command:
        """The last command that came."""
        return self._commands[-1][1]

    @property
    def source(self) -> str:
        """Who computed the last command; empty before the first."""
        return self._commands[-1][2]

    def add(self, stamp_ns: int, command: Command, source: str) -> None:
        """Take the command that answers the measurement of ``stamp_ns``."""
        while len(self._commands) > 1 and self._commands[-1][0] >= stamp_ns:
            self._commands.pop()  # time went back, or the command was sent again
        self._commands.append((stamp_ns, command, source))

    def before(self, tick_ns: int) -> Command:
        """The command in force until the tick of ``tick_ns``; the oldest known one if all are newer."""
        for stamp_ns, command, _ in reversed(self._commands):
            if stamp_ns < tick_ns:
                return command
        return self._commands[0][1]
