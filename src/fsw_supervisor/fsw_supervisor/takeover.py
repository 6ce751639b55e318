"""What an arbiter that starts, or that was cut off, knows of what went before."""

from __future__ import annotations

from math import isfinite

from fsw_control.contract import Command
from fsw_supervisor.roster import Roster


class Takeover:
    """Remembers who was active and what was applied before the first command of this arbiter.

    Attributes
    ----------
    asking : bool
        Until the first command nobody can have seen one of this arbiter: a controller that says it is selected
        means the one before it.
    was_active : str
        Controller that was active before; empty when unknown.
    seen : Command or None
        Last command known from before.
    """

    def __init__(self) -> None:
        self.asking = True
        self.was_active = ""
        self.seen: Command | None = None
        self._started_s: float | None = None

    def begin(self, now_s: float) -> None:
        """Note that measurements come; the time to listen counts from the first."""
        if self._started_s is None:
            self._started_s = now_s

    def hear_status(self, name: str, selected: bool) -> None:
        """Take what a controller says of itself."""
        if selected and self.asking:
            self.was_active = name

    def hear_command(self, command: Command) -> None:
        """Take a command that another arbiter has sent."""
        if self.asking and isfinite(command.force_kn) and isfinite(command.speed_rpm):
            self.seen = command

    def interrupt(self, applied: Command | None, active: str) -> None:
        """Remember the own state at a gap in the measurements."""
        self.asking, self.was_active = False, active or self.was_active
        self.seen = applied or self.seen

    def ends_s(self, wait_s: float) -> float | None:
        """Steady time at which listening ends; None when it does not matter."""
        return self._started_s + wait_s if self.asking and self._started_s is not None else None

    def informed(self, now_s: float, wait_s: float) -> bool:
        """Whether the controllers had the time to tell who of them was selected."""
        return not self.asking or (self._started_s is not None and now_s - self._started_s >= wait_s)

    @staticmethod
    def all_told(roster: Roster) -> bool:
        """Whether every controller in the graph has told."""
        present = [record for record in roster if record.present]
        return bool(present) and all(record.status_seen for record in present)
