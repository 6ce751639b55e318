"""The command in force: what was sent here and by others, what the drives report, and the offset between the two."""

from __future__ import annotations

from collections import deque

from fsw_control.command_check import refusal
from fsw_control.contract import Command, Limits
from fsw_control.units import NANOSECONDS
from fsw_supervisor.tick import Decision, Tick, same

#: ticks for which drive and command must agree before the drive counts as following (chosen)
_SURE_TICKS = 3
#: fastest drift of an offset per tick, in moves: a quarter of the safe ramp (chosen)
_DRIFT = 0.05
#: largest offset, in moves; a greater difference is not an offset (chosen)
_LARGEST_OFFSET = 10.0
#: time for which a foreign command counts as recent [s]
_FOREIGN_S = 5.0
#: so many commands of another supervisor belong to a takeover, and are no foreign writer's:
#: however busy the computer, by then one of the two has heard the other and stands by (chosen: 2
#: s)
_TAKEOVER_COMMANDS = 20


class CommandWatch:
    """Distinguishes this supervisor's own commands from those of other writers."""

    def __init__(self) -> None:
        self.foreign_commands = 0  #: commands of other writers since the start
        self.foreign_tick = -10  #: number of the tick in which the last of them arrived
        self._sent: deque[Decision] = deque(maxlen=50)
        self._foreign_s: float | None = None
        self._rival_s, self._rival_commands = float("-inf"), 0

    def sent(self, decision: Decision) -> None:
        """Record a decision that is sent."""
        self._sent.append(decision)

    def is_own(
        self, stamp_ns: int, source: str, command: Command, by_supervisor: bool = False
    ) -> bool:
        """Whether a command was sent here; each counts once.

        One ``by_supervisor``, signed by another, may say the same; the own one is then still to
        come.
        """
        for decision in self._sent:
            if (
                decision.stamp_ns == stamp_ns
                and decision.source == source
                and same(decision.command, command)
            ):
                if not by_supervisor:
                    self._sent.remove(decision)
                return True
        return False

    def note_foreign(self, now_s: float, tick: int, by_supervisor: bool = False) -> bool:
        """Record a foreign command; returns whether it is the first for a while that is to be reported.

        One ``by_supervisor``, signed by another supervisor, is only reported if they go on while
        this one leads.
        """
        first = not self.seen_lately(now_s)
        self.foreign_commands += 1
        self.foreign_tick = tick
        if by_supervisor:
            if now_s - self._rival_s > _FOREIGN_S:
                self._rival_commands = 0
            self._rival_s, self._rival_commands = now_s, self._rival_commands + 1
            if self._rival_commands <= _TAKEOVER_COMMANDS:
                return False
        self._foreign_s = now_s
        return first

    def change_role(self) -> None:
        """Note that this supervisor begins or ceases to lead: what the other one sends belongs to another takeover."""
        self._rival_commands = 0

    def seen_lately(self, now_s: float) -> bool:
        """Whether another writer has sent commands lately."""
        return self._foreign_s is not None and now_s - self._foreign_s <= _FOREIGN_S


class DriveOffset:
    """Offset between one drive's feedback and its command (kN or rpm): a load cell sees disturbances, too.

    A difference may also mean that the machine does not obey: a PLC ramps down on its own, a drive
    stands still. So it counts as an offset only where the drive has followed the command: if the
    difference set in from one tick to the next by more than any command or safe ramp moves, and
    has stayed; or if it has drifted more slowly than a safe ramp. Otherwise control begins again
    where the drive is; so it does if the drive has not followed since the gap before, as after a
    takeover that was refused.
    """

    def __init__(self) -> None:
        self.value = 0.0  #: to be subtracted from the feedback
        self._offset = 0.0
        self._last_difference: float | None = None
        self._candidate = 0.0
        self._stays = 0
        self._follows = 0

    def learn(self, difference: float | None, move: float) -> None:
        """Take feedback minus command at a tick (None: unknown); within ``move`` the drive may still be moving."""
        last, self._last_difference = self._last_difference, difference
        if difference is None:
            self._stays = 0
            return
        error = difference - self._offset
        if abs(error) > move:
            jumped = self._follows > 0 and last is not None and abs(difference - last) > move
            self._follows = 0
            if not self._lasts(difference, jumped, move):
                return
            error, self._offset, self._follows = 0.0, difference, _SURE_TICKS
        if abs(error) <= move / 2.0:
            drift = _DRIFT * move
            self._offset += min(max(error, -drift), drift)
        self._follows, self._stays = self._follows + 1, 0
        self.value = self._offset if abs(self._offset) > move else 0.0

    def _lasts(self, difference: float, jumped: bool, move: float) -> bool:
        """Whether a difference that set in at once has stayed for long enough."""
        if jumped:
            self._candidate, self._stays = difference, 1
        elif self._stays and abs(difference - self._candidate) <= move / 2.0:
            self._stays += 1
        else:
            self._stays = 0
        return self._stays >= _SURE_TICKS and abs(difference) <= _LARGEST_OFFSET * move

    def interrupt(self) -> None:
        """At a gap: keep the offset only if the drive has followed since the gap before."""
        self._offset = self.value = self.value if self._follows >= _SURE_TICKS else 0.0
        self._last_difference, self._stays, self._follows = None, 0, 0


class CommandInForce:
    """The command that the drives follow, and what they report."""

    def __init__(self) -> None:
        self.applied: Command | None = None  #: the command in force; None until it is known
        self.before_first = (
            True  #: neither this supervisor nor a leader that it follows has sent a command yet
        )
        self.seen: Command | None = None  #: last command known from before the start or gap
        self._drives: tuple[int, Command] | None = None
        self._force_offset, self._speed_offset = DriveOffset(), DriveOffset()
        self._just_begun = False

    def on_sent(self, command: Command) -> None:
        """Take a command that was sent, here or by the leader."""
        self.applied, self.before_first = command, False

    def begin_from(self, command: Command) -> None:
        """Take a command that is known to be in force before one is sent."""
        self.applied, self._just_begun = command, True

    def forget(self) -> None:
        """Find out again which command is in force."""
        self.applied = None

    def interrupt(self) -> None:
        """At a gap in the measurements: forget what is in force, but keep it as what was seen last."""
        for offset in (self._force_offset, self._speed_offset):
            offset.interrupt()
        self.seen, self.applied = self.applied or self.seen, None

    def on_foreign(self, command: Command) -> None:
        """Take a command that another supervisor has sent."""
        if self.before_first and refusal(command) is None:
            self.seen = command

    def on_drives(self, stamp_ns: int, feedback: Command) -> bool:
        """Take the drives' feedback; returns whether there was one of this stamp before."""
        repeated = self.feedback(stamp_ns) is not None
        if refusal(feedback) is None:
            self._drives = (stamp_ns, feedback)
        return repeated

    def feedback(self, stamp_ns: int) -> Command | None:
        """What the drives have reported at a stamp."""
        return (
            self._drives[1] if self._drives is not None and self._drives[0] == stamp_ns else None
        )

    def learn_offsets(self, tick: Tick, limits: Limits) -> None:
        """Compare the drives' feedback of a tick with the command in force."""
        drives, command = tick.drives, tick.previous
        if (
            drives is None or command is None or self._just_begun
        ):  # where control has just begun, the two agree anyway
            self._force_offset.learn(None, limits.force_step_kn)
            self._speed_offset.learn(None, limits.speed_step_rpm)
        else:
            self._force_offset.learn(drives.force_kn - command.force_kn, limits.force_step_kn)
            self._speed_offset.learn(drives.speed_rpm - command.speed_rpm, limits.speed_step_rpm)
        self._just_begun = False

    def commanded(self, drives: Command) -> Command:
        """The command that the drives obey when they report ``drives``."""
        return Command(
            drives.force_kn - self._force_offset.value, drives.speed_rpm - self._speed_offset.value
        )

    def acting(self, tick: Tick, hold_s: float) -> Command | None:
        """Actual force and speed: as the drives report, or have reported within ``hold_s``; else as commanded."""
        if tick.drives is not None or self._drives is None:
            return tick.drives or self.applied
        stamp_ns, feedback = self._drives
        return (
            feedback
            if 0 <= tick.stamp_ns - stamp_ns <= round(hold_s * NANOSECONDS)
            else self.applied
        )
