"""The command in force: sent here or by others, reported by the drives, and the offset between."""

from __future__ import annotations

from collections import deque

from fsw_control.command_gate import refusal
from fsw_control.contract import Command, Limits
from fsw_control.units import NANOSECONDS
from fsw_supervisor.tick import Decision, Tick, same

#: ticks in agreement with the command after which a drive counts as following it (chosen)
_SURE_TICKS = 3
#: fastest offset drift per tick, in moves: a quarter of the safe ramp (chosen)
_DRIFT = 0.05
#: largest offset, in moves; a greater difference is not an offset (chosen)
_LARGEST_OFFSET = 10.0
#: time for which a foreign command counts as recent [s]
_FOREIGN_S = 5.0
#: number of another supervisor's commands that still belong to a takeover: by then, however busy
#: the computer, one of the two has heard the other and stands by (chosen: 2 s)
_TAKEOVER_COMMANDS = 20


class CommandWatch:
    """Distinguishes this supervisor's own commands from those of other writers."""

    def __init__(self) -> None:
        self.foreign_commands = 0  #: commands of other writers since the start
        self.foreign_tick = -10  #: number of the tick in which the last one arrived
        self._sent: deque[Decision] = deque(maxlen=50)
        self._foreign_s: float | None = None
        self._rival_s, self._rival_commands = float("-inf"), 0

    def sent(self, decision: Decision) -> None:
        """Record a sent decision."""
        self._sent.append(decision)

    def is_own(
        self, stamp_ns: int, source: str, command: Command, by_supervisor: bool = False
    ) -> bool:
        """Whether this supervisor sent the command; each one counts once.

        With ``by_supervisor``, another one has signed it and may say the same; the own command is
        then still to come.
        """
        # Known by content, as a topic does not say who wrote: a message is own if such a decision
        # was sent and has not come back yet.
        for decision in self._sent:
            is_answer = decision.stamp_ns == stamp_ns and decision.source == source
            if is_answer and same(decision.command, command):
                if not by_supervisor:
                    self._sent.remove(decision)
                return True
        return False

    def note_foreign(self, now_s: float, tick: int, by_supervisor: bool = False) -> bool:
        """Record a foreign command; return whether to report it, as the first for a while.

        With ``by_supervisor``, it is only reported if such commands persist while this supervisor
        leads.
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
        """Note a change of role: the other supervisor's commands then belong to a new takeover."""
        self._rival_commands = 0

    def seen_lately(self, now_s: float) -> bool:
        """Whether another writer has sent commands recently."""
        return self._foreign_s is not None and now_s - self._foreign_s <= _FOREIGN_S


class DriveOffset:
    """Offset of a drive's feedback from its command (kN or rpm): load cells see disturbances, too.

    A difference may also mean that the machine does not obey: a PLC ramps down on its own, a drive
    stands still. It therefore counts as an offset only if the drive has followed the command: if
    the difference appeared within one tick, larger than any command or safe ramp, and has stayed;
    or if it has drifted more slowly than a safe ramp. Otherwise control restarts from the drive's
    value. The same holds if the drive has not followed since the last gap, for example after a
    refused takeover.
    """

    def __init__(self) -> None:
        self.value = 0.0  #: to subtract from the feedback
        self._offset = 0.0
        self._last_difference: float | None = None
        self._candidate = 0.0
        self._stays = 0
        self._follows = 0

    def learn(self, difference: float | None, move: float) -> None:
        """Take feedback minus command (None: unknown); up to ``move`` the drive may be moving."""
        last, self._last_difference = self._last_difference, difference
        if difference is None:
            self._stays = 0
            return
        error = difference - self._offset
        if abs(error) > move:
            # Not followed: a step of the difference may be a disturbance of the load cell;
            # anything slower may be the machine moving by itself and never becomes an offset.
            jumped = self._follows > 0 and last is not None and abs(difference - last) > move
            self._follows = 0
            if not self._lasts(difference, jumped, move):
                return
            error, self._offset, self._follows = 0.0, difference, _SURE_TICKS
        if abs(error) <= move / 2.0:
            # Followed: track a drift, but more slowly than any ramp of the machine.
            drift = _DRIFT * move
            self._offset += min(max(error, -drift), drift)
        self._follows, self._stays = self._follows + 1, 0
        self.value = self._offset if abs(self._offset) > move else 0.0

    def _lasts(self, difference: float, jumped: bool, move: float) -> bool:
        """Whether a step of the difference has lasted long enough."""
        if jumped:
            self._candidate, self._stays = difference, 1
        elif self._stays and abs(difference - self._candidate) <= move / 2.0:
            self._stays += 1
        else:
            self._stays = 0
        return self._stays >= _SURE_TICKS and abs(difference) <= _LARGEST_OFFSET * move

    def interrupt(self) -> None:
        """At a gap: keep the offset only if the drive has followed since the last gap."""
        self._offset = self.value = self.value if self._follows >= _SURE_TICKS else 0.0
        self._last_difference, self._stays, self._follows = None, 0, 0


class CommandInForce:
    """The command that the drives follow, and their feedback."""

    def __init__(self) -> None:
        self.applied: Command | None = None  #: the command in force; None until it is known
        #: no command yet from this supervisor or from a leader that it follows
        self.before_first = True
        self.seen: Command | None = None  #: last command known from before the start or gap
        self._drives: tuple[int, Command] | None = None
        self._force_offset, self._speed_offset = DriveOffset(), DriveOffset()
        self._just_begun = False

    def on_sent(self, command: Command) -> None:
        """Take a command sent here or by the leader."""
        self.applied, self.before_first = command, False

    def begin_from(self, command: Command) -> None:
        """Take a command known to be in force before one is sent."""
        self.applied, self._just_begun = command, True

    def forget(self) -> None:
        """Determine again which command is in force."""
        self.applied = None

    def interrupt(self) -> None:
        """At a gap in the measurements: keep what was in force only as the last command seen."""
        for offset in (self._force_offset, self._speed_offset):
            offset.interrupt()
        self.seen, self.applied = self.applied or self.seen, None

    def on_foreign(self, command: Command) -> None:
        """Take a command sent by another supervisor."""
        if self.before_first and refusal(command) is None:
            self.seen = command

    def on_drives(self, stamp_ns: int, feedback: Command) -> bool:
        """Take the drives' feedback; return whether it repeats a stamp."""
        repeated = self.feedback(stamp_ns) is not None
        if refusal(feedback) is None:
            self._drives = (stamp_ns, feedback)
        return repeated

    def feedback(self, stamp_ns: int) -> Command | None:
        """Feedback of the drives with this stamp, if any."""
        return self._drives[1] if self._drives and self._drives[0] == stamp_ns else None

    def learn_offsets(self, tick: Tick, limits: Limits) -> None:
        """Compare the drives' feedback of a tick with the command in force."""
        drives, command = tick.drives, tick.previous
        off: tuple[float | None, float | None] = None, None
        # at the start of control the two agree by construction
        if drives is not None and command is not None and not self._just_begun:
            off = drives.force_kn - command.force_kn, drives.speed_rpm - command.speed_rpm
        self._force_offset.learn(off[0], limits.force_step_kn)
        self._speed_offset.learn(off[1], limits.speed_step_rpm)
        self._just_begun = False

    def commanded(self, drives: Command) -> Command:
        """Command that the drives execute when they report ``drives``."""
        force_kn = drives.force_kn - self._force_offset.value
        return Command(force_kn, drives.speed_rpm - self._speed_offset.value)

    def acting(self, tick: Tick, hold_s: float) -> Command | None:
        """Actual force and speed: feedback no older than ``hold_s``, else the command."""
        if tick.drives is not None or self._drives is None:
            return tick.drives or self.applied
        age_ns, feedback = tick.stamp_ns - self._drives[0], self._drives[1]
        return feedback if 0 <= age_ns <= round(hold_s * NANOSECONDS) else self.applied
