"""Stamps of the ticks in real time."""

from __future__ import annotations

from math import copysign

from fsw_control.weld import TICK_NS

#: Distance of a stamp from the wall clock at which it is drawn back towards it, and at which it
#: jumps to it.
DRAW_NS = 5_000_000
JUMP_NS = TICK_NS // 2
#: Largest correction per tick: 100 ppm, more than clocks differ.
NUDGE_NS = 10_000


class TickStamps:
    """Stamps exactly one tick apart, independent of the timer's jitter, that follow the wall clock and never go back.

    Where the wall clock goes back against the steady clock, it was set: the stamps continue as if
    it had not been. So no stamp comes twice, and no command to a new measurement looks like one to
    an old measurement.
    """

    def __init__(self) -> None:
        #: how often the wall clock was set, or the process could not run for a while
        self.jumps = 0
        self.ahead_ns = 0  #: stamp less wall clock, after that was set back
        self._last_ns: int | None = None
        self._wall_ns = self._steady_ns = 0

    def next(self, wall_ns: int, steady_ns: int) -> int:
        """Stamp of the tick that is due now, on the wall clock; ``steady_ns`` is the time on the steady clock."""
        set_by_ns = wall_ns - self._wall_ns - (steady_ns - self._steady_ns)
        self._wall_ns, self._steady_ns = wall_ns, steady_ns
        if self._last_ns is None:
            self._last_ns = wall_ns
            return wall_ns
        if abs(set_by_ns) > JUMP_NS:
            before_ns, self.ahead_ns = self.ahead_ns, max(0, self.ahead_ns - set_by_ns)
            self.jumps += (
                self.ahead_ns - before_ns == -set_by_ns
            )  # otherwise the stamps jump below
        now_ns, stamp = wall_ns + self.ahead_ns, self._last_ns + TICK_NS
        off = now_ns - stamp
        if abs(off) > JUMP_NS:
            self.jumps += 1
            stamp = max(now_ns, self._last_ns + 1)
        elif abs(off) > DRAW_NS:
            stamp += int(copysign(NUDGE_NS, off))
        self._last_ns = stamp
        return stamp
