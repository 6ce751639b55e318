"""One sqlite3 file of a rosbag2 bag, read through ``rosbags``."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fsw_recorder.bag_metadata import OfferedQos
from fsw_recorder.errors import BagError

if TYPE_CHECKING:
    from fsw_recorder.bag_reader import BagRecord, TopicInfo


class SqliteBag:
    """Reads a ``.db3`` file.

    Parameters
    ----------
    path : Path
        The file.
    name : str
        Its name, for messages.

    Raises
    ------
    BagError
        Not a sqlite3 bag, or damaged.
    """

    def __init__(self, path: Path, name: str) -> None:
        from rosbags.rosbag2 import Reader

        self.name = name
        self._problems: list[str] = []
        self._done = 0
        if path.stat().st_size == 0:
            raise BagError(f"{name}: the file is empty")
        try:
            self._reader: Any = Reader(path)
            self._reader.open()
            self._connections = list(self._reader.connections)
            if not all(isinstance(text, str) for one in self._connections for text in (one.topic, one.msgtype)):
                raise ValueError("its table of topics holds something else")
            self._total = max(int(self._reader.message_count), 1)
        except Exception as error:  # rosbags and apsw raise many kinds on damaged files
            raise BagError(f"{name}: not a sqlite3 bag, or damaged: {error}") from None

    def records(self, topics: Collection[str] | None, start_ns: int, stop_ns: int) -> Iterator[BagRecord]:
        """Messages in order of log time."""
        from fsw_recorder.bag_reader import BagRecord

        wanted = [one for one in self._connections if topics is None or one.topic in topics]
        self._done = 0
        if not wanted:
            return
        limit = 2**63 - 1
        source = self._reader.messages(wanted, min(start_ns, limit), min(stop_ns, limit))
        while True:
            try:
                connection, time_ns, data = next(source)
            except StopIteration:
                return
            except Exception as error:  # apsw raises many kinds on damaged pages
                self._complain(f"{self.name}: damaged after {self._done} messages: {error}")
                return
            self._done += 1
            if not isinstance(time_ns, int) or not 0 <= time_ns < 2**63 or not isinstance(data, bytes | memoryview):
                self._complain(f"{self.name}: damaged: rows that are no messages are left out")
                continue
            yield BagRecord(connection.topic, connection.msgtype, time_ns, time_ns, bytes(data), 0)

    def _complain(self, problem: str) -> None:
        if problem not in self._problems:
            self._problems.append(problem)

    def topics(self) -> list[TopicInfo]:
        """Topics of the file; ``count`` is left at 0."""
        from fsw_recorder.bag_reader import TopicInfo

        result: list[TopicInfo] = []
        for one in self._connections:
            text = one.msgdef.data or ""
            result.append(
                TopicInfo(
                    name=one.topic,
                    type_name=one.msgtype,
                    encoding=one.ext.serialization_format,
                    type_hash=one.digest,
                    schema_encoding="ros2msg" if text and one.msgdef.format.name == "MSG" else "",
                    schema_text=text,
                    qos=[_offered(profile) for profile in one.ext.offered_qos_profiles],
                )
            )
        return result

    def problems(self) -> list[str]:
        """What was wrong with the file so far."""
        return self._problems

    def fraction(self) -> float:
        """Part of the file that was read, 0 to 1."""
        return min(self._done / self._total, 1.0)

    def close(self) -> None:
        """Close the file."""
        if self._reader.is_open:
            self._reader.close()


def _offered(profile: Any) -> OfferedQos:
    reliability, durability = profile.reliability.name.lower(), profile.durability.name.lower()
    return OfferedQos(
        reliability=reliability if reliability in ("reliable", "best_effort") else "reliable",
        durability=durability if durability in ("volatile", "transient_local") else "volatile",
        history="keep_all" if profile.history.name.lower() == "keep_all" else "keep_last",
        depth=int(profile.depth),
    )
