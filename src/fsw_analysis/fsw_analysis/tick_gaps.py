"""Counts the ticks that are missing in a bag, from the stamps of its messages alone.

The middleware reports at best the messages lost on the way to the recorder. The topics of a weld carry
one stamp per tick, the same on all of them, so the bag itself shows the gaps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fsw_analysis.weld_signals import IntArray
from fsw_control.units import NANOSECONDS
from fsw_recorder.bag_reader import BagRecord
from fsw_recorder.weld_clock import is_ticking, stamp_ns

#: shortest plausible period; with the next two it bounds the memory that a damaged bag can require
_SHORTEST_PERIOD_NS = 10_000_000
_MOST_GAPS = 1000
#: longest pause of all topics that still is a gap; beyond it the plant was started again
_LONGEST_GAP_NS = 60 * NANOSECONDS


class TickGaps(NamedTuple):
    """Ticks of the bag that a topic lacks, and the stamp of the first of them [ns]."""

    missing: int
    first_ns: int


class TickCounter:
    """Takes the messages of a bag and finds the ticks that each topic lacks."""

    def __init__(self) -> None:
        self._stamps: dict[str, list[int] | None] = {}

    def note(self, record: BagRecord) -> None:
        """Take up one message."""
        if record.topic not in self._stamps:
            self._stamps[record.topic] = [] if is_ticking(record.topic) else None
        stamps = self._stamps[record.topic]
        if stamps is not None and (stamp := stamp_ns(record.data)):
            stamps.append(stamp)

    def span_ns(self) -> tuple[int, int]:
        """First and last stamp, by the clock of the weld; two zeros without any."""
        stamps = [stamp for stamps_ns in self._stamps.values() for stamp in stamps_ns or ()]
        return min(stamps, default=0), max(stamps, default=0)

    def gaps(self) -> dict[str, TickGaps]:
        """Missing ticks per topic.

        A tick is a stamp that any of the topics has; where none has one for several periods, the
        missing ones are put in at the usual period.
        """
        stamps = {
            topic: np.unique(np.array(stamp, dtype=np.int64))
            for topic, stamp in self._stamps.items()
            if stamp
        }
        if not stamps:
            return {}
        ticks = _filled(np.unique(np.concatenate(list(stamps.values()))))
        lacking = {topic: np.setdiff1d(ticks, own) for topic, own in stamps.items()}
        return {
            topic: TickGaps(lost.size, int(lost[0]) if lost.size else 0)
            for topic, lost in lacking.items()
        }


def _filled(ticks: IntArray) -> IntArray:
    """Ticks, including those that are missing on all topics."""
    steps = np.diff(ticks)
    period = int(np.median(steps)) if steps.size > 1 else 0
    if period < _SHORTEST_PERIOD_NS:
        return ticks
    wide = np.flatnonzero((steps > 1.5 * period) & (steps <= _LONGEST_GAP_NS))
    between = [
        ticks[row] + np.arange(1, round(int(steps[row]) / period), dtype=np.int64) * period
        for row in wide[:_MOST_GAPS].tolist()
    ]
    return np.unique(np.concatenate([ticks, *between]))
