"""Decides when each recorded message is published: the player without middleware."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from fsw_recorder.bag_reader import BagReader, BagRecord
from fsw_recorder.errors import BagError
from fsw_recorder.topic import is_latched
from fsw_recorder.weld_clock import WeldClockReader

#: as in ``parameters.py``
MIN_RATE, MAX_RATE = 1e-3, 1e6


class Player:
    """Plays a bag; time is passed in as ``now_ns``, so any clock can drive it.

    The caller closes the reader; its log times are the playback time. The other arguments are
    parameters of the replayer (``parameters.py``). Raises a `BagError` if there is nothing to
    play, or the start is outside the bag.
    """

    def __init__(
        self,
        reader: BagReader | WeldClockReader,
        now_ns: int,
        topics: Collection[str] | None = None,
        rate: float = 1.0,
        start_offset_s: float = 0.0,
        duration_s: float = 0.0,
        loop: bool = False,
        paused: bool = False,
    ) -> None:
        self._reader = reader
        self._wanted = topics
        info = reader.info()
        taken = info.counts.keys() if topics is None else info.counts.keys() & topics
        self.topics = [topic for name, topic in sorted(reader.topics().items()) if name in taken]
        if not self.topics:
            suffix = f" on {', '.join(sorted(topics))}" if topics else ""
            raise BagError(f"{reader.path}: nothing to play: no messages{suffix}")
        self._bag_start_ns, self.end_ns = info.start_ns, info.end_ns
        self.start_ns = info.start_ns + round(start_offset_s * 1e9)
        if not info.start_ns <= self.start_ns <= self.end_ns:
            raise BagError(
                f"{reader.path}: start offset {start_offset_s:g} s is outside the bag, "
                f"which is {info.duration_s:.3f} s long"
            )
        if duration_s > 0.0:
            self.end_ns = min(self.end_ns, self.start_ns + round(duration_s * 1e9))
        self._loop = loop
        self.rate = rate
        self.is_paused = paused
        self.finished = False
        self._next: BagRecord | None = None
        self.seek(self.start_ns, now_ns)

    def latched_before_start(self) -> list[BagRecord]:
        """Last message before the start of every latched topic, to be published first."""
        names = {topic.name for topic in self.topics if any(map(is_latched, topic.qos))}
        if not names or self.start_ns == self._bag_start_ns:
            return []
        return list(
            {
                record.topic: record
                for record in self._reader.records(names, stop_ns=self.start_ns)
            }.values()
        )

    def bag_time_ns(self, now_ns: int) -> int:
        """Bag time for a clock time, at most the end."""
        elapsed = 0 if self.is_paused else round((now_ns - self._anchor_now_ns) * self.rate)
        return min(self._anchor_bag_ns + elapsed, self.end_ns)

    def take_due(self, now_ns: int, most: int = 1000) -> list[BagRecord]:
        """Messages that are due, at most ``most``; `finished` is set after the last one."""
        due: list[BagRecord] = []
        if self.is_paused or self.finished:
            return due
        bag_time = self.bag_time_ns(now_ns)
        while self._next is not None and self._next.log_time_ns <= bag_time and len(due) < most:
            due.append(self._next)
            self._next = next(self._source, None)
        if self._next is None:
            if self._loop:
                self.seek(self.start_ns, now_ns)
            else:
                self.finished = True
        return due

    def hold_back(self, lost_ns: int) -> None:
        """Skip the time ``lost_ns`` in which nothing could be played.

        Messages recorded at different times but sent at once would overflow their subscribers'
        queues.
        """
        if not self.is_paused:
            self._anchor_now_ns += lost_ns

    def pause(self, now_ns: int) -> None:
        """Pause playback."""
        self._anchor(self.bag_time_ns(now_ns), now_ns)
        self.is_paused = True

    def resume(self, now_ns: int) -> None:
        """Continue from where `pause` stopped."""
        if self.is_paused:
            self.is_paused = False
            self._anchor_now_ns = now_ns

    def set_rate(self, rate: float, now_ns: int) -> bool:
        """Change the rate; False if it is not positive or absurd."""
        if not MIN_RATE <= rate <= MAX_RATE:
            return False
        self._anchor(self.bag_time_ns(now_ns), now_ns)
        self.rate = rate
        return True

    def seek(self, bag_time_ns: int, now_ns: int) -> bool:
        """Continue from a time in the bag; False if it is outside the bag."""
        if not self._bag_start_ns <= bag_time_ns <= self.end_ns:
            return False
        self._source: Iterator[BagRecord] = self._reader.records(
            self._wanted, bag_time_ns, self.end_ns + 1
        )
        self._next = next(self._source, None)
        self._anchor(bag_time_ns, now_ns)
        self.finished = False
        return True

    def step(self, now_ns: int) -> BagRecord | None:
        """While paused: return the next message; None at the end or if not paused."""
        record = self._next if self.is_paused else None
        if record is not None:
            self._anchor(record.log_time_ns, now_ns)
            self._next = next(self._source, None)
        return record

    def _anchor(self, bag_time_ns: int, now_ns: int) -> None:
        self._anchor_bag_ns, self._anchor_now_ns = bag_time_ns, now_ns
