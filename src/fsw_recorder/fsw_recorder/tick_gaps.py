"""Counts the ticks that are missing in a bag, from the stamps of its messages alone.

Sequence numbers tell what was lost on the way only where the middleware has them. The topics of a weld carry one
stamp per tick, the same on all of them, so the bag itself shows what is not in it.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

_TICKING = re.compile(
    r"^/fsw/(depth|spindle_torque|thermocouple|command|plant/truth|[^/]+/(proposal|status|prediction))$"
)
#: shorter ones are no weld's; with the next two it bounds the memory that a damaged bag can ask for
_SHORTEST_PERIOD_NS = 10_000_000
_MOST_GAPS = 1000
#: longest pause of all topics that still is a gap; beyond it the plant was started anew
_LONGEST_GAP_NS = 60 * 1_000_000_000


@dataclass(frozen=True, slots=True)
class TickGaps:
    """What one topic lacks.

    Attributes
    ----------
    missing : int
        Ticks between the topic's first and last message for which it has none.
    first_ns : int
        Stamp of the first missing tick; 0 if none is missing.
    """

    missing: int
    first_ns: int = 0


def is_ticking(topic: str) -> bool:
    """Whether the topic has one message per tick."""
    return _TICKING.match(topic) is not None


def stamp_ns(data: bytes) -> int | None:
    """Stamp of a serialized message that begins with a header (or is a clock); None if it is too short for one.

    The stamp is the first field: ``int32`` seconds and ``uint32`` nanoseconds behind the four bytes of the encoding.
    """
    if len(data) < 12:
        return None
    seconds, nanoseconds = struct.unpack_from("<iI" if data[1] & 1 else ">iI", data, 4)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)


class TickCounter:
    """Takes the messages of a bag and tells which ticks each topic lacks."""

    def __init__(self) -> None:
        self._stamps: dict[str, list[int]] = {}

    def note(self, topic: str, data: bytes) -> None:
        """Take up one message."""
        stamps = self._stamps.get(topic)
        if stamps is None:
            if not is_ticking(topic):
                return
            stamps = self._stamps[topic] = []
        stamp = stamp_ns(data)
        if stamp:
            stamps.append(stamp)

    def gaps(self) -> dict[str, TickGaps]:
        """Missing ticks per topic.

        A tick is a stamp that any of the topics has; where none has one for several periods, the missing ones are put
        in at the usual period. What a topic lacks before its first and after its last message is not counted: it
        began later or ended earlier.
        """
        stamps = {topic: np.unique(np.array(one, dtype=np.int64)) for topic, one in self._stamps.items() if one}
        if not stamps:
            return {}
        ticks = _filled(np.unique(np.concatenate(list(stamps.values()))))
        result: dict[str, TickGaps] = {}
        for topic, own in stamps.items():
            expected = ticks[(ticks >= own[0]) & (ticks <= own[-1])]
            lacking = np.setdiff1d(expected, own, assume_unique=True)
            result[topic] = TickGaps(int(lacking.size), int(lacking[0]) if lacking.size else 0)
        return result


def _filled(ticks: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Ticks with those put in that no topic has."""
    steps = np.diff(ticks)
    if steps.size < 2:
        return ticks
    period = int(np.median(steps))
    if period < _SHORTEST_PERIOD_NS:
        return ticks
    wide = np.flatnonzero((steps > 1.5 * period) & (steps <= _LONGEST_GAP_NS))
    between: list[npt.NDArray[np.int64]] = []
    for row in wide[:_MOST_GAPS].tolist():
        between.append(ticks[row] + np.arange(1, round(int(steps[row]) / period), dtype=np.int64) * period)
    return np.unique(np.concatenate([ticks, *between]))
