"""An MCAP file of a bag while it is written."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import replace

from mcap.data_stream import RecordBuilder
from mcap.records import DataEnd, Footer
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer

from fsw_recorder.bag_metadata import FileSummary
from fsw_recorder.manifest import FileHasher, FileManifest
from fsw_recorder.topic import RecordedTopic, qos_text

COMPRESSIONS = {"": CompressionType.NONE, "zstd": CompressionType.ZSTD}
#: size at which a chunk is committed early
CHUNK_BYTES = 1024 * 1024


class _Committed:
    """Output stream for ``mcap``: `flush` writes everything to the file at once, or nothing.

    If a write fails (disk full, ...) the file is truncated to its previous size, so it never ends
    inside a record.
    """

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self.size = 0
        self.waiting = bytearray()
        self.hasher = FileHasher()

    def write(self, data: bytes) -> None:
        self.waiting += data

    def tell(self) -> int:
        return self.size + len(self.waiting)

    def flush(self) -> None:
        data = bytes(self.waiting)
        self.waiting.clear()
        view = memoryview(data)
        try:
            while view:
                view = view[os.write(self.descriptor, view) :]
        except OSError:
            with suppress(OSError):
                os.ftruncate(self.descriptor, self.size)
            raise
        self.size += len(data)
        self.hasher.add(data)


class BagFile:
    """An MCAP file being written, in an open folder, even if that is moved.

    `added` counts all messages, `committed` those that no failure can lose; any method may raise
    an OSError.
    """

    def __init__(self, name: str, folder_descriptor: int, compression: str) -> None:
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | os.O_APPEND
        self._descriptor = os.open(name, flags, 0o644, dir_fd=folder_descriptor)
        self._stream = _Committed(self._descriptor)
        self._mcap = Writer(
            self._stream,  # type: ignore[arg-type]  # it calls write, tell and flush
            chunk_size=CHUNK_BYTES,
            compression=COMPRESSIONS[compression],
        )
        self._channels: dict[str, int] = {}
        self._schemas: dict[tuple[str, str], int] = {}
        self.added, self.committed = FileSummary(name), FileSummary(name)
        try:
            self._mcap.start("ros2", "fsw_recorder")
            self._stream.flush()
        except OSError:
            os.close(self._descriptor)
            raise

    def add_message(
        self,
        topic: RecordedTopic,
        data: bytes,
        log_time_ns: int,
        publish_time_ns: int,
        sequence: int,
    ) -> bool:
        """Add a message; True if a chunk is due to be committed."""
        channel = self._channels.get(topic.name)
        if channel is None:
            channel = self._channels[topic.name] = self._add_channel(topic)
        self._mcap.add_message(channel, log_time_ns, data, publish_time_ns, sequence)
        self.added.note(topic.name, log_time_ns)
        return bool(self._stream.waiting)

    def _add_channel(self, topic: RecordedTopic) -> int:
        key = (topic.type_name, topic.definition)
        if key not in self._schemas:
            encoding = topic.definition_encoding if topic.definition else ""
            self._schemas[key] = self._mcap.register_schema(
                topic.type_name, encoding, topic.definition.encode()
            )
        metadata = {
            "offered_qos_profiles": qos_text(topic.qos),
            "topic_type_hash": topic.type_hash,
        }
        return int(
            self._mcap.register_channel(topic.name, topic.encoding, self._schemas[key], metadata)
        )

    def attach(self, time_ns: int, name: str, media_type: str, data: bytes) -> None:
        """Attach a file."""
        self._mcap.add_attachment(time_ns, time_ns, name, media_type, data)
        self._stream.flush()

    def commit(self) -> None:
        """Pass all messages to the operating system."""
        self._mcap.flush()
        self.added.size_bytes = self._stream.size
        self.committed = replace(self.added, counts=self.added.counts.copy())

    def sync(self) -> None:
        """Flush committed data to disk."""
        os.fdatasync(self._descriptor)

    def is_at(self, path: str | os.PathLike[str]) -> bool:
        """Whether a path leads to this file."""
        try:
            return os.path.samestat(os.stat(path), os.fstat(self._descriptor))
        except OSError:
            return False

    def finish(self, metadata: str) -> None:
        """Write the index with the bag's metadata, and close; everything must be committed."""
        self._mcap.add_metadata("rosbag2", {"serialized_metadata": metadata})
        self._mcap.finish()
        self._stream.flush()
        os.fsync(self._descriptor)
        self.committed.size_bytes = self._stream.size
        os.close(self._descriptor)

    def manifest(self) -> FileManifest:
        """Hashes of the data written so far."""
        return self._stream.hasher.manifest(self.committed.path)

    def close_off(self) -> None:
        """Truncate to the committed data, without an index, so that every reader accepts it."""
        self._stream.waiting[:] = end_without_index()
        try:
            self._stream.flush()
        finally:
            os.close(self._descriptor)


def end_without_index() -> bytes:
    """The end of a file without an index that every reader accepts."""
    builder = RecordBuilder()
    DataEnd(0).write(builder)
    Footer(summary_start=0, summary_offset_start=0, summary_crc=0).write(builder)
    return bytes(builder.end() + MCAP0_MAGIC)
