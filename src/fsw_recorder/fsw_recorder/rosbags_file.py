"""Reads other formats than plain MCAP with ``rosbags``: sqlite3 and compressed bags.

A file that rosbag2 has compressed as a whole is decompressed first.
"""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import zstandard
from mcap.records import Attachment
from mcap.writer import MCAP0_MAGIC
from rosbags.rosbag2 import Reader

from fsw_control.schema.files import open_regular
from fsw_recorder.bag_metadata import BagMetadata
from fsw_recorder.errors import BagError
from fsw_recorder.topic import BagRecord, RecordedTopic

COMPRESSED = ".zstd"
#: magic bytes of sqlite3 and MCAP files
_BEGINNINGS = (b"SQLite format 3\0", MCAP0_MAGIC)
#: numbers in sqlite3 are signed
_MOST = 2**63 - 1


@contextmanager
def decompressed(path: Path) -> Iterator[Path]:
    """Yield a decompressed copy of a file, or the file itself if its name lacks ``.zstd``.

    A damaged or truncated file is decompressed up to that point; the reader of the copy finds out
    what is missing.
    """
    if path.suffix != COMPRESSED:
        yield path
        return
    with TemporaryDirectory(prefix="fsw_bag_") as folder:
        copy = Path(folder) / path.stem
        decompressor = zstandard.ZstdDecompressor(max_window_size=2**27)
        with open_regular(path) as source, copy.open("wb") as target:
            try:
                content = decompressor.stream_reader(source, read_across_frames=True)
                head = content.read(len(_BEGINNINGS[0]))
                target.write(head)
                if head.startswith(_BEGINNINGS):  # anything else may be huge, and is not a bag
                    shutil.copyfileobj(content, target)
            except zstandard.ZstdError:
                pass
        yield copy


@contextmanager
def with_its_log(path: Path) -> Iterator[Path]:
    """Yield a copy of a sqlite3 file merged with its write-ahead log; the file itself without log.

    rosbag2's preset ``resilient`` writes such a log; if it is killed, most messages are only
    there.
    """
    log = path.with_name(f"{path.name}-wal")
    if not path.is_file() or not log.is_file() or not log.stat().st_size:
        yield path
        return
    with TemporaryDirectory(prefix="fsw_bag_") as folder:
        copy = Path(folder) / path.name
        for original in (path, log):
            shutil.copyfile(original, copy.with_name(original.name))
        with closing(sqlite3.connect(copy)) as database:
            # moves the log into the file, as the last connection does when it closes
            database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        yield copy


class RosbagsFile:
    """A sqlite3 file, or a bag folder compressed by message, with `McapFile`'s interface."""

    def __init__(self, path: Path, add_problem: Callable[[str], None], storage: str) -> None:
        self.storage = storage
        self.attachments: list[Attachment] = []
        self.metadata = BagMetadata()  #: the file contains none
        self._add_problem: Callable[[str], None] = lambda text: add_problem(f"{path}: {text}")
        self.fraction = 0.0
        if path.is_file() and not path.stat().st_size:
            raise BagError(f"{path}: the file is empty")
        self._stack = ExitStack()
        try:
            plain = self._stack.enter_context(decompressed(path))
            whole = self._stack.enter_context(with_its_log(plain))
            if whole != plain:
                self._add_problem(
                    "was not closed; the messages in its write-ahead log are read, too"
                )
            self._reader: Any = Reader(whole)
            self._reader.open()
            self._stack.callback(self._reader.close)
            self._connections = list(self._reader.connections)
            if not all(
                isinstance(text, str)
                for connection in self._connections
                for text in (connection.topic, connection.msgtype)
            ):
                raise ValueError("its table of topics has unexpected content")
        except Exception as error:  # rosbags and apsw raise many kinds on damaged files
            self._stack.close()
            raise BagError(f"{path}: not a {storage} bag, or damaged: {error}") from None

    def close(self) -> None:
        """Close the file."""
        self._stack.close()

    def topics(self) -> list[RecordedTopic]:
        """All topics."""
        return [
            RecordedTopic(
                connection.topic,
                connection.msgtype,
                connection.msgdef.data or "",
                connection.digest,
                tuple(connection.ext.offered_qos_profiles),
                connection.ext.serialization_format,
                "ros2msg"
                if connection.msgdef.data and connection.msgdef.format.name == "MSG"
                else "",
            )
            for connection in self._connections
        ]

    def records(
        self, topics: Collection[str] | None, start_ns: int, stop_ns: int
    ) -> Iterator[BagRecord]:
        """Messages with ``start_ns`` <= log time < ``stop_ns`` by log time."""
        selected = [
            connection
            for connection in self._connections
            if topics is None or connection.topic in topics
        ]
        if not selected:
            return
        total = max(int(self._reader.message_count), 1)
        count = 0
        try:
            for connection, time_ns, data in self._reader.messages(
                selected, min(start_ns, _MOST), min(stop_ns, _MOST)
            ):
                count += 1
                self.fraction = min(count / total, 1.0)
                if isinstance(time_ns, int) and 0 <= time_ns <= _MOST and isinstance(data, bytes):
                    yield BagRecord(
                        connection.topic, connection.msgtype, time_ns, time_ns, data, 0
                    )
                else:
                    self._add_problem("damaged: rows that are no messages are left out")
        except Exception as error:  # apsw raises many kinds on damaged pages
            self._add_problem(f"damaged after {count} messages: {error}")
