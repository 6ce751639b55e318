"""A bag whose time is that of its welds, not that of the wall clock at which it was recorded.

A weld in simulated time runs as fast as the machine allows, so its receive times say nothing about the weld. Here every
message gets the simulated time at which it was received, so that a replay at rate 1 takes as long as the weld did.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from fsw_recorder.bag_reader import FOREVER_NS, BagInfo, BagReader, BagRecord
from fsw_recorder.tick_gaps import is_ticking, stamp_ns

#: topics that tell the weld's time, the best first; their first field is a time
_CLOCKS = ("/fsw/depth", "/fsw/spindle_torque", "/fsw/thermocouple", "/clock")
#: further than this from the receive time, a stamp comes from another clock
_OTHER_CLOCK_NS = 36_000 * 1_000_000_000
#: a message is received within this of its stamp, on the weld's clock; otherwise the stamp is not believed
_DISORDER_NS = 500_000_000
_ANSWER_NS = 10_000_000
#: share of a tick in which everything is played that was received in it
_ANSWERED_WITHIN = 0.2


def weld_times(reader: BagReader) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]] | None:
    """Receive times and the stamps received then, both increasing; None if the stamps tell the receive time anyway.

    Where the stamps go back (the plant was reset), the weld's time goes on from where it was.
    """
    topics = reader.topics()
    clock = next((name for name in _CLOCKS if name in topics and topics[name].count > 1), None)
    if clock is None:
        return None
    logs: list[int] = []
    times: list[int] = []
    shift, last = 0, None
    for record in reader.records([clock]):
        stamp = stamp_ns(record.data)
        if stamp is None or (logs and record.log_time_ns <= logs[-1]):
            continue
        if last is not None and stamp < last:
            shift += last - stamp
        last = stamp
        if not times or stamp + shift > times[-1]:
            logs.append(record.log_time_ns)
            times.append(stamp + shift)
    if len(logs) < 2 or abs(logs[0] - times[0]) < _OTHER_CLOCK_NS:
        return None
    return _early_in_tick(np.array(logs, dtype=np.int64), np.array(times, dtype=np.int64))


def _early_in_tick(
    logs: npt.NDArray[np.int64], times: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Points in between, so that what follows the measurements of a tick is played soon after them.

    In lockstep the next measurement follows a command at once; evenly stretched, both would come together and a
    controller that is shown them could be a tick behind with what was applied.
    """
    steps = np.diff(times)
    rows = np.flatnonzero((np.diff(logs) > 1) & (steps <= 2 * np.median(steps)))
    answered = times[rows] + np.maximum((steps[rows] * _ANSWERED_WITHIN).astype(np.int64), 1)
    order = np.argsort(np.concatenate([logs, logs[rows + 1] - 1]), kind="stable")
    return (
        np.concatenate([logs, logs[rows + 1] - 1])[order],
        np.concatenate([times, np.minimum(answered, times[rows + 1] - 1)])[order],
    )


class PacedReader:
    """Reads a bag as `BagReader` does, with log times on the weld's clock.

    Parameters
    ----------
    reader : BagReader
        The bag; owned by the caller.
    times : (array, array)
        From `weld_times`. Between two of them time runs evenly; what came before the first comes at the first; after
        the last, time runs as the wall clock did.
    """

    def __init__(self, reader: BagReader, times: tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]) -> None:
        self.path = reader.path
        self._reader = reader
        self._logs, self._times = times

    def info(self) -> BagInfo:
        """Summary of the bag; start and end are on the weld's clock."""
        info = self._reader.info()
        return replace(info, start_ns=self._weld_ns(info.start_ns), end_ns=self._weld_ns(info.end_ns))

    def records(
        self,
        topics: Collection[str] | None = None,
        start_ns: int = 0,
        stop_ns: int = FOREVER_NS,
        progress: Callable[[float], None] | None = None,
    ) -> Iterator[BagRecord]:
        """Messages as of `BagReader.records`; all times are on the weld's clock."""
        begin = 0 if start_ns <= self._times[0] else self._log_ns(start_ns - _DISORDER_NS)
        end = FOREVER_NS if stop_ns >= FOREVER_NS else self._log_ns(stop_ns + _DISORDER_NS)
        waiting: list[tuple[int, int, BagRecord]] = []
        for count, record in enumerate(self._reader.records(topics, max(begin, 0), end, progress)):
            received = self._weld_ns(record.log_time_ns)
            weld_ns = self._own_ns(record, received)
            if start_ns <= weld_ns < stop_ns:
                heapq.heappush(waiting, (weld_ns, count, record._replace(log_time_ns=weld_ns)))
            while waiting and waiting[0][0] < received - _DISORDER_NS:
                yield heapq.heappop(waiting)[2]
        while waiting:
            yield heapq.heappop(waiting)[2]

    def _own_ns(self, record: BagRecord, received: int) -> int:
        """Time at which a message is played: measurements all at their stamp, answers soon after it.

        The order of receipt is that in which the recorder came to read its topics, not that in which they were sent.
        """
        stamp = stamp_ns(record.data) if is_ticking(record.topic) else None
        if stamp is None or abs(stamp - received) > _DISORDER_NS:
            return received
        return stamp if record.topic in _CLOCKS else max(stamp + _ANSWER_NS, min(received, stamp + 2 * _ANSWER_NS))

    def _weld_ns(self, log_ns: int) -> int:
        return _mapped(log_ns, self._logs, self._times)

    def _log_ns(self, weld_ns: int) -> int:
        return _mapped(weld_ns, self._times, self._logs)


def _mapped(value: int, given: npt.NDArray[np.int64], wanted: npt.NDArray[np.int64]) -> int:
    """Piecewise linear in whole nanoseconds."""
    row = int(np.searchsorted(given, value, side="right")) - 1
    if row < 0:
        return int(wanted[0])
    beyond = value - int(given[row])
    if row + 1 == given.size:
        return int(wanted[row]) + beyond
    share = int(wanted[row + 1]) - int(wanted[row])
    return int(wanted[row]) + beyond * share // (int(given[row + 1]) - int(given[row]))
