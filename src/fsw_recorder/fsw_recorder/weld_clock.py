"""A bag on the time of its weld instead of the wall clock of its recording.

A weld in simulated time runs as fast as the machine allows, so its receive times mean nothing for
the weld. Here every message gets the simulated time of its receipt, so that a replay at rate 1
takes as long as the weld did. Stamps are read without decoding the messages.

The stamps alone also show which ticks are missing: the middleware reports at best the messages
lost on the way to the recorder, but all topics of a weld carry the same stamp in a tick.
"""

from __future__ import annotations

import heapq
import re
import struct
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fsw_control.references import OTHER_CLOCK_NS
from fsw_control.sensors import REQUIRED, SENSORS
from fsw_control.units import NANOSECONDS
from fsw_recorder.bag_reader import FOREVER_NS, BagInfo, BagReader, BagRecord

#: suffixes of the topics with the weld's time, best first
_CLOCKS = (*(f"/{SENSORS[name].topic}" for name in REQUIRED), "/clock")
#: largest distance between a message's receipt and its stamp, on the weld's clock; beyond it the
#: stamp is ignored
_DISORDER_NS = 500_000_000
#: delay with which answers to a measurement, and messages without stamp, are played
_ANSWER_NS = 10_000_000

#: shortest plausible period; with the next two it bounds the memory that a damaged bag can require
_SHORTEST_PERIOD_NS = 10_000_000
_MOST_GAPS = 1000
#: longest pause of all topics that still is a gap; beyond it the plant was started again
_LONGEST_GAP_NS = 60 * NANOSECONDS

_SENSORS = "|".join(row.topic for row in SENSORS.values())
_TICKING = re.compile(
    rf"(/.*)?/({_SENSORS}|fsw/(drives|command|plant/truth|[^/]+/(proposal|status|prediction)))"
)
#: end of a stamp in the message's bytes, including the encapsulation header
_STAMP_END = 12


def is_ticking(topic: str) -> bool:
    """Whether the topic has a message per tick of the weld, in any namespace."""
    return _TICKING.fullmatch(topic) is not None


def stamp_ns(data: bytes) -> int | None:
    """Stamp of a serialized message that begins with a header or a time; None if it has none.

    The stamp is the first field: ``int32`` seconds and ``uint32`` nanoseconds after the four
    bytes of the encapsulation header.
    """
    if len(data) < _STAMP_END or not data[1] & 1:  # big-endian is not decoded
        return None
    seconds, nanoseconds = struct.unpack_from("<iI", data, 4)
    return int(seconds) * NANOSECONDS + int(nanoseconds)


class WeldClockReader:
    """Reads a bag like `BagReader`, with log times on the weld's clock; see `on_weld_clock`.

    Measurements are played at their stamps, all of a tick together, and their answers soon after;
    the order of receipt only reflects how the recorder polled its topics. Messages without stamp
    follow the measurement received before them. If the stamps go back (the plant was reset), the
    time continues from where it was.
    """

    def __init__(self, reader: BagReader, clock: str, first_ns: int) -> None:
        self.path: Path = reader.path
        self.topics = reader.topics
        self._reader = reader
        self._clock = clock
        self._first_ns = first_ns

    def info(self) -> BagInfo:
        """Messages of the bag; start and end are on the weld's clock."""
        end = self._first_ns
        for record in self.records():
            end = record.log_time_ns
        return replace(self._reader.info(), start_ns=self._first_ns, end_ns=end)

    def records(
        self,
        topics: Collection[str] | None = None,
        start_ns: int = 0,
        stop_ns: int = FOREVER_NS,
    ) -> Iterator[BagRecord]:
        """Messages as in `BagReader.records`; all times are on the weld's clock."""
        needed = None if topics is None else {*topics, self._clock}
        waiting: list[tuple[int, int, BagRecord]] = []
        now, shift, last = self._first_ns, 0, 0
        for count, record in enumerate(self._reader.records(needed)):
            stamp = (
                stamp_ns(record.data)
                if record.topic == self._clock or is_ticking(record.topic)
                else None
            )
            if record.topic == self._clock and stamp is not None:
                shift += max(last - stamp, 0)
                last = stamp
                now = max(now, stamp + shift)
            own = now + _ANSWER_NS if count and now > self._first_ns else now
            if stamp is not None and abs(stamp + shift - now) <= _DISORDER_NS:
                own = stamp + shift + (0 if record.topic.endswith(_CLOCKS) else _ANSWER_NS)
            if start_ns <= own < stop_ns and (topics is None or record.topic in topics):
                heapq.heappush(waiting, (own, count, record._replace(log_time_ns=own)))
            while waiting and waiting[0][0] < now - _DISORDER_NS:
                yield heapq.heappop(waiting)[2]
            if now > stop_ns + _DISORDER_NS:
                break
        while waiting:
            yield heapq.heappop(waiting)[2]


def on_weld_clock(reader: BagReader) -> BagReader | WeldClockReader:
    """The bag on its weld's clock; unchanged if it has none or was received by that clock."""
    counts = reader.info().counts
    clocks = (
        name
        for end in _CLOCKS
        for name in sorted(counts)
        if name.endswith(end) and counts[name] > 1
    )
    clock = next(clocks, None)
    if clock is None:
        return reader
    first = next(reader.records([clock]))
    stamp = stamp_ns(first.data)
    if stamp is None or abs(first.log_time_ns - stamp) < OTHER_CLOCK_NS:
        return reader
    return WeldClockReader(reader, clock, stamp)


class TickGaps(NamedTuple):
    """Gaps of a topic.

    ``missing`` ticks are between its first and last message, ``first_ns`` is the stamp of the
    first. ``before`` and ``after`` are the ticks of the bag outside: it began later or ended
    earlier than another topic.
    """

    missing: int
    first_ns: int
    before: int
    after: int


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
        result: dict[str, TickGaps] = {}
        for topic, own in stamps.items():
            begin, end = map(int, np.searchsorted(ticks, (own[0], own[-1])))
            lacking = np.setdiff1d(ticks[begin:end], own, assume_unique=True)
            first_ns = int(lacking[0]) if lacking.size else 0
            result[topic] = TickGaps(lacking.size, first_ns, begin, ticks.size - end - 1)
        return result


def _filled(ticks: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
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
