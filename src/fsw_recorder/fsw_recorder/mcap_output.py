"""Writes one MCAP file so that it is readable at every moment up to its last committed chunk.

A chunk reaches the file in one write. If that fails (disk full, ...) the file is cut back to the last whole chunk, so
a failure never leaves half a record behind. Layout of the records: https://mcap.dev/spec
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Mapping
from contextlib import suppress

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

MAGIC = b"\x89MCAP0\r\n"
COMPRESSIONS = ("", "zstd")
_MESSAGE = struct.Struct("<BQHIQQ")
_CHUNK = struct.Struct("<BQQQQI")


def _encoded(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())


class McapOutput:
    """One growing MCAP file.

    Parameters
    ----------
    descriptor : int
        Open for writing and positioned at 0; owned (closed) by this object.
    compression : str
        Of chunks: empty or ``zstd``.
    library : str
        Written to the header.

    Raises
    ------
    OSError
        From every method that writes. The file then ends at its last committed chunk and can still be finished.
    """

    def __init__(self, descriptor: int, compression: str = "", library: str = "fsw_recorder") -> None:
        self._descriptor = descriptor
        self._compressor = zstandard.ZstdCompressor(level=3) if compression else None
        self._compression = compression
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunk_indices: list[ChunkIndex] = []
        self._attachment_indices: list[AttachmentIndex] = []
        self._metadata_indices: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._start_ns, self._end_ns = 2**64 - 1, 0
        self._chunk = bytearray()
        self._index: dict[int, list[int]] = {}
        self._chunk_start_ns, self._chunk_end_ns = 2**64 - 1, 0
        self.size = 0
        self._append(MAGIC + _encoded(Header("ros2", library)))

    @property
    def chunk_size(self) -> int:
        """Bytes that `commit` would write (uncompressed)."""
        return len(self._chunk)

    @property
    def counts(self) -> dict[int, int]:
        """Messages in the file by channel, without those not yet committed."""
        return self._counts

    @property
    def message_count(self) -> int:
        """Messages in the file, without those not yet committed."""
        return sum(self._counts.values())

    @property
    def first_ns(self) -> int:
        """Earliest log time so far, committed or not; 2**64 - 1 without messages."""
        return min(self._start_ns, self._chunk_start_ns)

    @property
    def span_ns(self) -> tuple[int, int]:
        """Earliest and latest committed log time; meaningless without messages."""
        return self._start_ns, self._end_ns

    def add_schema(self, name: str, encoding: str, text: str) -> int:
        """Add a message definition; returns its id."""
        schema = Schema(id=len(self._schemas) + 1, data=text.encode(), encoding=encoding, name=name)
        self._schemas.append(schema)
        self._chunk += _encoded(schema)
        return len(self._schemas)

    def add_channel(self, topic: str, schema_id: int, encoding: str, metadata: Mapping[str, str]) -> int:
        """Add a topic; returns its id."""
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=encoding,
            metadata=dict(metadata),
            schema_id=schema_id,
        )
        self._channels.append(channel)
        self._chunk += _encoded(channel)
        return len(self._channels)

    def add_message(self, channel: int, sequence: int, log_time_ns: int, publish_time_ns: int, data: bytes) -> None:
        """Add a message to the chunk that the next `commit` writes."""
        chunk = self._chunk
        index = self._index.get(channel)
        if index is None:
            index = self._index[channel] = []
        index.append(log_time_ns)
        index.append(len(chunk))
        chunk += _MESSAGE.pack(5, 22 + len(data), channel, sequence, log_time_ns, publish_time_ns)
        chunk += data
        if log_time_ns < self._chunk_start_ns:
            self._chunk_start_ns = log_time_ns
        if log_time_ns > self._chunk_end_ns:
            self._chunk_end_ns = log_time_ns

    def commit(self) -> None:
        """Write the chunk in progress; afterwards its messages survive the death of the process."""
        if not self._index:
            return
        raw, index = bytes(self._chunk), self._index
        start_ns, end_ns = self._chunk_start_ns, self._chunk_end_ns
        self._chunk, self._index = bytearray(), {}
        self._chunk_start_ns, self._chunk_end_ns = 2**64 - 1, 0
        data = self._compressor.compress(raw) if self._compressor else raw
        name = self._compression.encode()
        record_size = 28 + 4 + len(name) + 8 + len(data)
        head = _CHUNK.pack(Opcode.CHUNK, record_size, start_ns, end_ns, len(raw), zlib.crc32(raw))
        parts = [head, struct.pack("<I", len(name)), name, struct.pack("<Q", len(data)), data]
        offsets: dict[int, int] = {}
        at = self.size + 9 + record_size
        chunk_end = at
        for channel, entries in index.items():
            offsets[channel] = at
            size = 8 * len(entries)
            parts.append(struct.pack(f"<BQHI{len(entries)}Q", Opcode.MESSAGE_INDEX, 6 + size, channel, size, *entries))
            at += 9 + 6 + size
        chunk_index = ChunkIndex(
            chunk_length=9 + record_size,
            chunk_start_offset=self.size,
            compression=self._compression,
            compressed_size=len(data),
            message_end_time=end_ns,
            message_index_length=at - chunk_end,
            message_index_offsets=offsets,
            message_start_time=start_ns,
            uncompressed_size=len(raw),
        )
        self._append(b"".join(parts))
        self._chunk_indices.append(chunk_index)
        for channel, entries in index.items():
            self._counts[channel] = self._counts.get(channel, 0) + len(entries) // 2
        self._start_ns, self._end_ns = min(self._start_ns, start_ns), max(self._end_ns, end_ns)

    def add_attachment(self, name: str, media_type: str, time_ns: int, data: bytes) -> None:
        """Write a file into the bag at once."""
        self.commit()
        offset = self.size
        record = Attachment(create_time=time_ns, log_time=time_ns, name=name, media_type=media_type, data=data)
        self._append(_encoded(record))
        self._attachment_indices.append(
            AttachmentIndex(
                offset=offset,
                length=self.size - offset,
                log_time=time_ns,
                create_time=time_ns,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
        )

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record at once."""
        self.commit()
        offset = self.size
        self._append(_encoded(Metadata(name=name, metadata=dict(values))))
        self._metadata_indices.append(MetadataIndex(offset=offset, length=self.size - offset, name=name))

    def sync(self) -> None:
        """Wait until what was committed is on the disk, so that it survives a power failure."""
        os.fdatasync(self._descriptor)

    def same_file(self, path: str) -> bool:
        """Whether ``path`` still is the file that is written."""
        try:
            there, here = os.stat(path), os.fstat(self._descriptor)
        except OSError:
            return False
        return (there.st_dev, there.st_ino) == (here.st_dev, here.st_ino)

    def finish(self) -> None:
        """Commit, write summary and footer, and make them durable; `close` is still needed."""
        self.commit()
        data_end = _encoded(DataEnd(data_section_crc=0))
        summary_start = self.size + len(data_end)
        summary, groups = bytearray(), []
        for opcode, records in (
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunk_indices),
            (Opcode.ATTACHMENT_INDEX, self._attachment_indices),
            (Opcode.METADATA_INDEX, self._metadata_indices),
        ):
            start = len(summary)
            summary += _encoded(*records)
            if len(summary) > start:
                groups.append(SummaryOffset(opcode, summary_start + start, len(summary) - start))
        offsets_start = summary_start + len(summary)
        summary += _encoded(*groups)
        footer = _encoded(Footer(summary_start, offsets_start, 0))
        crc = zlib.crc32(footer[:-4], zlib.crc32(summary))
        self._append(data_end + bytes(summary) + footer[:-4] + struct.pack("<I", crc) + MAGIC)
        os.fsync(self._descriptor)

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachment_indices),
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunk_indices),
            message_count=self.message_count,
            metadata_count=len(self._metadata_indices),
            message_start_time=self._start_ns if self._counts else 0,
            message_end_time=self._end_ns,
            schema_count=len(self._schemas),
        )

    def _append(self, data: bytes) -> None:
        view = memoryview(data)
        try:
            while view:
                view = view[os.write(self._descriptor, view) :]
        except OSError:
            with suppress(OSError):
                os.ftruncate(self._descriptor, self.size)
                os.lseek(self._descriptor, self.size, os.SEEK_SET)
            raise
        self.size += len(data)

    def close(self) -> None:
        """Close the file as it is; without `finish` it has no summary but is readable."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
