"""Stamps of the ticks in real time."""

from __future__ import annotations

from math import copysign

from fsw_control.weld import TICK_NS

#: Distance of a stamp from the wall clock at which it is drawn back towards it, and at which it jumps to it.
DRAW_NS = 5_000_000
JUMP_NS = TICK_NS // 2
#: Largest correction per tick: 100 ppm, more than clocks differ.
NUDGE_NS = 10_000


class TickStamps:
    """Stamps exactly one tick apart, independent of the timer's jitter, that follow the wall clock."""

    def __init__(self) -> None:
        #: how often the stamps had to jump: the clock was set, or the process could not run for a while
        self.jumps = 0
        self._last_ns: int | None = None

    def next(self, now_ns: int) -> int:
        """Stamp of the tick that is due now."""
        if self._last_ns is None:
            self._last_ns = now_ns
            return now_ns
        stamp = self._last_ns + TICK_NS
        off = now_ns - stamp
        if abs(off) > JUMP_NS:
            self.jumps += 1
            stamp = now_ns
        elif abs(off) > DRAW_NS:
            stamp += int(copysign(NUDGE_NS, off))
        self._last_ns = stamp
        return stamp
