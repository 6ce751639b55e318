"""What is known of the command in force: from the drives, from what was sent here, and from other writers."""

from __future__ import annotations

from collections import deque

from fsw_control.command_check import refusal
from fsw_control.contract import Command, Limits
from fsw_control.units import NANOSECONDS
from fsw_supervisor.tick import Decision, Tick, same

#: for so long a foreign command is remembered [s]
_FOREIGN_S = 5.0
#: ticks for which drives and command must agree before it is believed that the drives follow (chosen)
_SURE_TICKS = 3
#: fastest drift of a push per tick, in moves: a quarter of the safe ramp (chosen)
_DRIFT = 0.05
#: largest push, in moves; what is further off is no push (chosen)
_LARGEST_PUSH = 10.0


class CommandWatch:
    """Tells the commands sent here from those of other writers."""

    def __init__(self) -> None:
        self.foreign_commands = 0  #: of other writers, seen since the start
        self.foreign_tick = -10  #: number of the tick in which the last of them came
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


class Push:
    """What moves one drive besides its command (kN or rpm): a load cell sees a disturbance, too.

    It must be told from a command that the machine does not obey: a PLC that ramps down by itself, a drive that stands
    still. So a difference between drive and command is taken for a push only where the drive has followed the command:
    if the difference set in from one tick to the next by more than any command or safe ramp moves, and has stayed; or
    if it has drifted more slowly than a safe ramp. Otherwise control begins again where the drive is; so it does if
    the drive has not followed since the gap before, as after a takeover that was refused.
    """

    def __init__(self) -> None:
        self.value = 0.0  #: that is taken off what the drive reports
        self._push = 0.0
        self._before: float | None = None
        self._candidate = 0.0
        self._stays = 0
        self._follows = 0

    def learn(self, difference: float | None, move: float) -> None:
        """Take the difference of drive and command at a tick (None: unknown); up to ``move`` it may be under way."""
        before, self._before = self._before, difference
        if difference is None:
            self._stays = 0
            return
        off = difference - self._push
        if abs(off) > move:
            jumped = self._follows and before is not None and abs(difference - before) > move
            self._follows = 0
            if not self._lasts(difference, jumped, move):
                return
            off, self._push, self._follows = 0.0, difference, _SURE_TICKS
        if abs(off) <= move / 2.0:
            drift = _DRIFT * move
            self._push += min(max(off, -drift), drift)
        self._follows, self._stays = self._follows + 1, 0
        self.value = self._push if abs(self._push) > move else 0.0

    def _lasts(self, difference: float, jumped: object, move: float) -> bool:
        """Whether a difference that set in at once has stayed for long enough."""
        if jumped:
            self._candidate, self._stays = difference, 1
        elif self._stays and abs(difference - self._candidate) <= move / 2.0:
            self._stays += 1
        else:
            self._stays = 0
        return self._stays >= _SURE_TICKS and abs(difference) <= _LARGEST_PUSH * move

    def interrupt(self) -> None:
        """At a gap: keep only what the drive has shown to hold since the gap before."""
        self._push = self.value = self.value if self._follows >= _SURE_TICKS else 0.0
        self._before, self._stays, self._follows = None, 0, 0


class BumplessStart:
    """The command in force, and after a start or a gap all that helps to find it out.

    Until the first command (``asking``) nobody can have seen one of this supervisor: a controller that says it is
    selected means the supervisor before.
    """

    def __init__(self) -> None:
        self.applied: Command | None = None  #: command in force; None until it is known
        self.asking = True
        self.was_active = ""  #: controller that was active before; empty when unknown
        self.seen: Command | None = None  #: last command known from before
        self._started_s: float | None = None
        self._drives: tuple[int, Command] | None = None
        self._force_push, self._speed_push = Push(), Push()
        self._just_begun = False

    def begin(self, now_s: float) -> None:
        """Note that measurements come; the time to listen counts from the first."""
        if self._started_s is None:
            self._started_s = now_s

    def note_applied(self, command: Command) -> None:
        """Take a command that has been sent, here or by the leader."""
        self.applied, self.asking = command, False

    def begin_from(self, found: Command) -> None:
        """Take the command that was found to be in force; none has been sent yet."""
        self.applied, self._just_begun = found, True

    def forget_applied(self) -> None:
        """Find out again which command is in force."""
        self.applied = None

    def forget_active(self) -> None:
        """Wait no longer for the controller that was active before."""
        self.was_active = ""

    def interrupt(self, active: str) -> None:
        """Keep the own state for later at a gap in the measurements: what acts must be found out again."""
        for push in (self._force_push, self._speed_push):
            push.interrupt()
        self.was_active = active or self.was_active
        if self.asking:
            self._started_s = None
        self.seen, self.applied = self.applied or self.seen, None

    def hear_status(self, name: str, selected: bool) -> None:
        """Take what a controller says of itself."""
        if selected and self.asking:
            self.was_active = name

    def hear_command(self, command: Command) -> None:
        """Take a command that another supervisor has sent."""
        if self.asking and refusal(command) is None:
            self.seen = command

    def hear_drives(self, stamp_ns: int, feedback: Command) -> bool:
        """Take the drives' feedback; returns whether its stamp was seen before."""
        repeated = self.feedback(stamp_ns) is not None
        if refusal(feedback) is None:
            self._drives = (stamp_ns, feedback)
        return repeated

    def feedback(self, stamp_ns: int) -> Command | None:
        """What the drives have reported at a stamp."""
        return self._drives[1] if self._drives is not None and self._drives[0] == stamp_ns else None

    def listening_ends_s(self, wait_s: float) -> float | None:
        """Steady time at which the controllers have had the time to tell who was selected; None: no matter any more."""
        return self._started_s + wait_s if self.asking and self._started_s is not None else None

    def learn_offset(self, tick: Tick, limits: Limits) -> None:
        """Learn what pushes besides the command."""
        drives, before = tick.drives, tick.before
        if drives is None or before is None or self._just_begun:  # where control has just begun, the two agree anyway
            self._force_push.learn(None, limits.force_step_kn)
            self._speed_push.learn(None, limits.speed_step_rpm)
        else:
            self._force_push.learn(drives.force_kn - before.force_kn, limits.force_step_kn)
            self._speed_push.learn(drives.speed_rpm - before.speed_rpm, limits.speed_step_rpm)
        self._just_begun = False

    def commanded(self, drives: Command) -> Command:
        """The command that the drives obey when they report ``drives``: a load cell sees everything that pushes."""
        return Command(drives.force_kn - self._force_push.value, drives.speed_rpm - self._speed_push.value)

    def acting(self, tick: Tick, hold_s: float) -> Command | None:
        """Force and speed that act: as the drives report, or have reported within ``hold_s``; else as commanded."""
        if tick.drives is not None or self._drives is None:
            return tick.drives or self.applied
        stamp_ns, feedback = self._drives
        return feedback if 0 <= tick.stamp_ns - stamp_ns <= round(hold_s * NANOSECONDS) else self.applied
