"""Stamps of the ticks in real time."""

from __future__ import annotations

from math import copysign

from fsw_control.weld import TICK_NS

#: deviation of a stamp from the wall clock at which it is corrected gradually, and at which it
#: jumps
DRAW_NS = 5_000_000
JUMP_NS = TICK_NS // 2
#: largest correction per tick: 100 ppm, more than clocks deviate
NUDGE_NS = 10_000


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
