"""When a tick begins, and its stamp.

Lockstep makes a weld in simulated time independent of the machine's speed: time advances only when
the command for the present tick has arrived and the player has sent everything that precedes the
next one. Every wait has an end: a lost tick is sent again, a vanished player is not awaited. In
real time the stamps follow the wall clock.
"""

from __future__ import annotations

from math import copysign, inf

from fsw_control.weld import TICK_NS

#: period of resending a tick, for a supervisor that was started while the tick was unanswered [s]
_REPEAT_S = 0.5
#: deviation of a stamp from the wall clock at which it is corrected gradually, and at which it
#: jumps
DRAW_NS = 5_000_000
JUMP_NS = TICK_NS // 2
#: largest correction per tick: 100 ppm, more than clocks deviate
NUDGE_NS = 10_000


class Lockstep:
    """Waits for the answer to the present tick, and for the player's preceding messages.

    Times are on the steady clock.
    """

    def __init__(self) -> None:
        self.answered = True  #: the present tick has its command
        self.player_present = False  #: a player takes part
        self.resent = 0  #: number of repetitions of the present tick
        self._unplayed_ns: int | None = None
        self._begun_s = self._sent_s = 0.0
        self._repeat_s = inf

    @property
    def complete(self) -> bool:
        """Whether nothing is awaited any more."""
        return self.answered and not (self.player_present and self._unplayed_ns is not None)

    def begin(self, now_s: float) -> None:
        """Begin a tick."""
        self.answered, self.resent, self._repeat_s = False, 0, inf
        self._begun_s = self._sent_s = now_s

    def on_new_writer(self) -> None:
        """Note a new publisher of commands, which has seen neither the tick nor its answers."""
        self._repeat_s, self._sent_s = _REPEAT_S, -inf

    def must_repeat(self, now_s: float, timeout_s: float) -> bool:
        """Whether to resend the present tick: every ``timeout_s``, and for a new publisher."""
        # a supervisor that was started during the tick has not seen it: it would wait for a
        # measurement, and lockstep for its command, without end
        if self.answered or now_s - self._sent_s < min(timeout_s, self._repeat_s):
            return False
        self._sent_s = now_s
        self.resent += 1
        return True

    def waited_s(self, now_s: float) -> float:
        """Time since the start of the present tick."""
        return now_s - self._begun_s

    def await_player(self, depth_ns: int | None) -> None:
        """Note the stamp of the tick's depth sample, which a player follows; None without one."""
        self._unplayed_ns = depth_ns

    def on_player(self, depth_ns: int) -> bool:
        """Note that the player has sent all before the tick after this depth; True if current."""
        self.player_present = True
        if depth_ns != self._unplayed_ns:
            return False
        self._unplayed_ns = None
        return True


class TickStamps:
    """Stamps exactly one tick apart that follow the wall clock without jitter and never go back.

    If the wall clock goes back relative to the steady clock, it was set: the stamps continue
    unaffected. So no stamp occurs twice, and a command for a new measurement never looks like one
    for an old measurement.
    """

    def __init__(self) -> None:
        #: number of times that the wall clock was set or the process was suspended
        self.jumps = 0
        self.ahead_ns = 0  #: stamp less wall clock, after it was set back
        self._last_ns: int | None = None
        self._wall_ns = self._steady_ns = 0

    def next(self, wall_ns: int, steady_ns: int) -> int:
        """Stamp of the tick due now by the wall clock; ``steady_ns`` is the steady clock."""
        # What the wall clock moved beyond the steady clock since the last tick is what it was set
        # by. Set back: the stamps keep their pace, ahead of the clock by that much. Set forward,
        # or a process that was suspended: they jump. Less than that is jitter of the timer, and
        # the drift between the clocks, which small corrections follow
        set_by_ns = wall_ns - self._wall_ns - (steady_ns - self._steady_ns)
        self._wall_ns, self._steady_ns = wall_ns, steady_ns
        if self._last_ns is None:
            self._last_ns = wall_ns
            return wall_ns
        if abs(set_by_ns) > JUMP_NS:
            before_ns, self.ahead_ns = self.ahead_ns, max(0, self.ahead_ns - set_by_ns)
            # otherwise the stamps jump below
            self.jumps += self.ahead_ns - before_ns == -set_by_ns
        now_ns, stamp = wall_ns + self.ahead_ns, self._last_ns + TICK_NS
        off = now_ns - stamp
        if abs(off) > JUMP_NS:
            self.jumps += 1
            stamp = max(now_ns, self._last_ns + 1)
        elif abs(off) > DRAW_NS:
            stamp += int(copysign(NUDGE_NS, off))
        self._last_ns = stamp
        return stamp
