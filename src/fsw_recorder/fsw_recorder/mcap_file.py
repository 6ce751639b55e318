"""Reads an MCAP file of a bag in any state: intact, truncated or damaged.

Every length is checked against the rest of the file, and a chunk never expands beyond
`MAX_CHUNK_BYTES`, so damaged files cost neither time nor memory.

The libraries cannot do that: ``mcap`` and ``rosbags`` stop at the first damaged record, and
``mcap`` takes ten times as long for a weld. So the frames of the records (one byte of type, eight
of length) are scanned here, and their content is left to ``mcap``. If the frame after one is
implausible, the next position with several consecutive frames is searched, so that damage costs
only the affected records. Layout of the records: https://mcap.dev/spec
"""

from __future__ import annotations

import mmap
import re
import struct
import zlib
from bisect import bisect_left
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from io import BytesIO
from operator import attrgetter
from pathlib import Path

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC as MAGIC

from fsw_control.schema.files import open_regular
from fsw_recorder.bag_metadata import BagMetadata, metadata_inside
from fsw_recorder.errors import BagError
from fsw_recorder.rosbags_file import decompressed
from fsw_recorder.topic import BagRecord, RecordedTopic, read_qos

#: most messages that wait for earlier ones in overlapping chunks
_MOST_WAITING = 1_000_000
#: longest run of messages outside chunks that is sorted at once
_RUN_BYTES = 1024 * 1024
#: channel, sequence, log time, publish time
_MESSAGE = struct.Struct("<HIQQ")
_DAMAGE = (ValueError, struct.error, McapError, MemoryError, RuntimeError, zstandard.ZstdError)


@dataclass(slots=True)
class _Piece:
    """A compressed chunk, or a run of records outside chunks (size -1), with its log times."""

    start_ns: int
    end_ns: int
    begin: int
    end: int
    compression: str = ""
    uncompressed_size: int = -1
    crc: int = 0
    is_cut: bool = False


class McapFile:
    """An MCAP file, scanned when opened; chunks are decompressed only when they are read.

    ``add_problem`` is called with each problem, also repeatedly. `fraction` is the part of the
    file that `records` has read. Raises a `BagError` if nothing of the file is usable.
    """

    storage = "mcap"

    def __init__(self, path: Path, add_problem: Callable[[str], None]) -> None:
        self.attachments: list[Attachment] = []
        #: the bag's metadata in the file; empty if the file was not finished
        self.metadata = BagMetadata()
        self.fraction = 0.0
        self._add_problem: Callable[[str], None] = lambda text: add_problem(f"{path}: {text}")
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._pieces: list[_Piece] = []
        with decompressed(path) as plain, open_regular(plain) as stream:
            magic = stream.read(len(MAGIC))
            if not magic:
                raise BagError(f"{path}: the file is empty")
            if magic != MAGIC:
                raise BagError(f"{path}: not an MCAP file (its first bytes are {magic.hex(' ')})")
            self._data = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        self.close = self._data.close
        if not self._scan() or not self._channels:  # channels may be defined in chunks only
            for piece in self._pieces:
                self._read(piece, ())

    def _scan(self) -> bool:
        """Find chunks and runs of messages, read everything else; False if damaged or unfinished.

        The summary is scanned, too: its copies of schemas and channels replace damaged originals.
        """
        size = len(self._data)
        is_whole, is_finished = True, False
        run: _Piece | None = None
        offset = len(MAGIC)
        for opcode, begin, end in frames(self._data, offset, size):
            offset = min(end, size)
            if opcode == DAMAGED:
                is_whole = False
                self._add_problem(f"damaged: bytes {begin} to {end} are left out")
            elif opcode == Opcode.CHUNK:
                self._add_chunk(begin, end)
            elif end > size:
                break
            elif opcode == Opcode.MESSAGE:
                log_time = _MESSAGE.unpack_from(self._data, begin)[2]
                if run is None or run.end != begin - HEAD_BYTES or end - run.begin > _RUN_BYTES:
                    run = _Piece(log_time, log_time, begin - HEAD_BYTES, end)
                    self._pieces.append(run)
                else:
                    run.start_ns, run.end_ns, run.end = (
                        min(run.start_ns, log_time),
                        max(run.end_ns, log_time),
                        end,
                    )
            elif opcode == Opcode.DATA_END:
                is_finished = self._data[-len(MAGIC) :] == MAGIC
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.ATTACHMENT, Opcode.METADATA):
                self._take(opcode, self._data[begin:end])
        if not is_finished and is_whole:
            self._add_problem(
                f"not finished (recorder killed or disk full?); read up to byte {offset}"
            )
        return is_whole and is_finished

    def _take(self, opcode: int, body: bytes) -> None:
        stream = ReadDataStream(BytesIO(body))
        try:
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                self._schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(stream)
                self._channels[channel.id] = channel
            elif opcode == Opcode.METADATA:
                record = Metadata.read(stream)
                if record.name == "rosbag2":
                    self.metadata = metadata_inside(record.metadata.get("serialized_metadata", ""))
            else:
                attachment = Attachment.read(stream)
                if zlib.crc32(body[:-4]) != int.from_bytes(body[-4:], "little") != 0:
                    raise ValueError(f"attachment '{attachment.name}' has a wrong checksum")
                self.attachments.append(attachment)
        except _DAMAGE as error:
            self._add_problem(
                f"a record of kind {Opcode(opcode).name.lower()} is damaged and left out: {error}"
            )

    def _add_chunk(self, begin: int, end: int) -> None:
        size = len(self._data)
        compression, data_begin, data_end = chunk_data(self._data, begin)
        if data_begin > size:
            return  # truncated within its head
        if data_end > end:
            self._add_problem(f"damaged: the chunk at byte {begin} is larger than its record")
            return
        start_ns, end_ns, content_size, crc = CHUNK_HEAD.unpack_from(self._data, begin)
        cut_end = min(data_end, size)
        self._pieces.append(
            _Piece(
                start_ns,
                end_ns,
                data_begin,
                cut_end,
                compression,
                content_size,
                crc,
                cut_end < data_end,
            )
        )

    def topics(self) -> list[RecordedTopic]:
        """All topics in the file."""
        topics = []
        for channel in self._channels.values():
            schema = self._schemas.get(channel.schema_id) or Schema(0, b"", "", "")
            topics.append(
                RecordedTopic(
                    channel.topic,
                    schema.name,
                    schema.data.decode("utf-8", "replace"),
                    channel.metadata.get("topic_type_hash", ""),
                    tuple(read_qos(channel.metadata.get("offered_qos_profiles", ""))),
                    channel.message_encoding,
                    schema.encoding,
                )
            )
        return topics

    def records(
        self, topics: Collection[str] | None, start_ns: int, stop_ns: int
    ) -> Iterator[BagRecord]:
        """Messages with ``start_ns`` <= log time < ``stop_ns`` by log time, then file order."""
        log_time = attrgetter("log_time_ns")
        pieces = [
            piece
            for piece in self._pieces
            if piece.is_cut or (piece.end_ns >= start_ns and piece.start_ns < stop_ns)
        ]
        pieces.sort(key=attrgetter("start_ns"))
        waiting: list[BagRecord] = []
        for number, piece in enumerate(pieces, 1):
            waiting += self._read(piece, topics)
            waiting.sort(key=log_time)
            ready = len(waiting)
            if number < len(pieces) and ready < _MOST_WAITING:
                ready = bisect_left(waiting, pieces[number].start_ns, key=log_time)
            self.fraction = number / len(pieces)
            for record in waiting[:ready]:
                if start_ns <= record.log_time_ns < stop_ns:
                    yield record
            del waiting[:ready]

    def _read(self, piece: _Piece, topics: Collection[str] | None) -> list[BagRecord]:
        """Messages of a chunk or run in file order; its schemas and channels are registered."""
        data: Buffer = self._data
        offset, stop = piece.begin, piece.end
        if piece.uncompressed_size >= 0:
            try:
                data = _content(data[offset:stop], piece)
            except _DAMAGE as error:
                self._add_problem(f"the chunk at byte {piece.begin} is left out: {error}")
                return []
            offset, stop = 0, len(data)

        records: list[BagRecord] = []
        selected = self._wanted(topics)
        for opcode, begin, end in frames(data, offset, stop):
            if opcode == DAMAGED and not piece.is_cut:
                self._add_problem(
                    f"damaged: {end - begin} bytes of the chunk at byte {piece.begin} are left out"
                )
            if end > stop:
                break
            if opcode == Opcode.MESSAGE:
                channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(data, begin)
                if channel in selected:
                    body = data[begin + _MESSAGE.size : end]
                    records.append(
                        BagRecord(*selected[channel], log_time, publish_time, body, sequence)
                    )
                elif channel not in self._channels:
                    self._add_problem(
                        f"messages of channel {channel}, which is not defined, are left out"
                    )
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._take(opcode, data[begin:end])
                selected = self._wanted(topics)
        return records

    def _wanted(self, topics: Collection[str] | None) -> dict[int, tuple[str, str]]:
        """Topic and type by channel."""
        names = {number: schema.name for number, schema in self._schemas.items()}
        return {
            number: (channel.topic, names.get(channel.schema_id, ""))
            for number, channel in self._channels.items()
            if topics is None or channel.topic in topics
        }


def _content(data: bytes, piece: _Piece) -> bytes:
    """Decompress a chunk as far as it exists; an error of `_DAMAGE` if it is unusable."""
    size = piece.uncompressed_size
    if max(len(data), size) > MAX_CHUNK_BYTES:
        raise ValueError(f"it is larger than the {MAX_CHUNK_BYTES} bytes that are accepted")
    # Reading one byte more than announced reveals damage without expanding further.
    if piece.compression == "zstd":
        data = zstandard.ZstdDecompressor(max_window_size=2**27).stream_reader(data).read(size + 1)
    elif piece.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    elif piece.compression:
        raise ValueError(f"compression '{piece.compression}' is not known")
    if not piece.is_cut:
        if len(data) != size:
            raise ValueError(f"it holds {len(data)} bytes, it should hold {size}")
        if piece.crc and zlib.crc32(data) != piece.crc:
            raise ValueError("its checksum is wrong")
    return data


Buffer = bytes | mmap.mmap

#: not a type of record
DAMAGED = 0
#: largest accepted chunk, on disk and in memory
MAX_CHUNK_BYTES = 256 * 1024 * 1024
_FRAME = struct.Struct("<BQ")
HEAD_BYTES = _FRAME.size
#: head of a chunk before its compression: first and last log time, size and checksum
CHUNK_HEAD = struct.Struct("<QQQI")
#: minimum length of every type of record, with empty texts
_LEAST = dict(enumerate((8, 20, 14, 16, 22, 40, 6, 64, 36, 48, 46, 8, 20, 17, 4), 1))
_NEVER = 2**64
#: a frame of the data section with a plausible length
_CANDIDATE = re.compile(rb"(?=[\x03-\x07\x09\x0c\x0f].{4}\0{4})", re.DOTALL)
#: consecutive frames that confirm a position after damage
_CHAIN = 3


def frames(data: Buffer, offset: int, stop: int) -> Iterator[tuple[int, int, int]]:
    """Records between two offsets: type, begin and end of the body; the last may be truncated.

    Skipped bytes have the type `DAMAGED`.
    """
    unpack = _FRAME.unpack_from
    while offset + HEAD_BYTES <= stop:
        opcode, length = unpack(data, offset)
        end = offset + HEAD_BYTES + length
        possible = _LEAST.get(opcode, _NEVER) <= length
        if possible and end <= stop and (end + HEAD_BYTES > stop or _is_frame(data, end, stop)):
            yield opcode, offset + HEAD_BYTES, end
            offset = end
            continue
        # The length of this frame or the head of the next one is damaged, or the file is
        # truncated inside this frame.
        trusted = (
            possible and opcode == Opcode.CHUNK and chunk_data(data, offset + HEAD_BYTES)[2] == end
        )
        further = _next_frame(data, end if trusted else offset + 1, stop)
        if possible and (trusted or further is None or further >= end):
            yield opcode, offset + HEAD_BYTES, end
            offset = end
        if further is None:
            further = stop
        if further > offset:
            yield DAMAGED, offset, further
            offset = further


def chunk_data(data: Buffer, begin: int) -> tuple[str, int, int]:
    """Compression of a chunk, begin and end of its data; ``begin`` is that of the record body."""
    name = begin + CHUNK_HEAD.size + 4
    name_end = name + int.from_bytes(data[name - 4 : name], "little")
    data_begin = name_end + 8
    compression = bytes(data[name : min(name_end, name + 20)]).decode("ascii", "replace")
    return (
        compression,
        data_begin,
        data_begin + int.from_bytes(data[name_end:data_begin], "little"),
    )


def _is_frame(data: Buffer, offset: int, stop: int) -> bool:
    """Whether a frame with a plausible length begins here."""
    opcode, length = _FRAME.unpack_from(data, offset)
    if _LEAST.get(opcode, _NEVER) > length:
        return False
    end = offset + HEAD_BYTES + length
    if end <= stop or (opcode == Opcode.CHUNK and chunk_data(data, offset + HEAD_BYTES)[2] == end):
        return True
    return _next_frame(data, offset + 1, stop) is None  # truncated


def _next_frame(data: Buffer, offset: int, stop: int) -> int | None:
    """First position from ``offset`` on with several consecutive frames; None if not found."""
    places = (match.start() for match in _CANDIDATE.finditer(data, min(offset, stop), stop))
    return next((place for place in places if _is_chain(data, place, stop)), None)


def _is_chain(data: Buffer, offset: int, stop: int) -> bool:
    """Whether enough frames follow from ``offset`` on, or all up to the end if that is near."""
    for link in range(_CHAIN):
        if offset + HEAD_BYTES > stop:
            return offset == stop or link > 1
        opcode, length = _FRAME.unpack_from(data, offset)
        if not _LEAST.get(opcode, _NEVER) <= length <= MAX_CHUNK_BYTES:
            return False
        offset += HEAD_BYTES + length
        if offset > stop:
            return link > 1
    return True
