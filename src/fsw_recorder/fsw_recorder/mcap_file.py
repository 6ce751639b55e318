"""Reads one MCAP file of a bag in any state: whole, cut off or damaged.

Every length is checked against what is left of the file, and a chunk never expands beyond `MAX_CHUNK_BYTES`: damaged
files cost neither time nor memory.
"""

from __future__ import annotations

import mmap
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
from mcap.records import Attachment, Channel, Schema
from mcap.writer import MCAP0_MAGIC as MAGIC

from fsw_recorder.bag_record import BagRecord
from fsw_recorder.errors import BagError
from fsw_recorder.mcap_frames import CHUNK_HEAD, HEAD_BYTES, MAX_CHUNK_BYTES, Buffer, chunk_data, frames
from fsw_recorder.qos import read_qos
from fsw_recorder.topic import RecordedTopic

#: most messages that wait for earlier ones in chunks that overlap in time
_MOST_WAITING = 1_000_000
#: largest run of messages outside chunks that is sorted at once
_RUN_BYTES = 1024 * 1024
#: channel, sequence, log time, publish time
_MESSAGE = struct.Struct("<HIQQ")
_FOOTER_BYTES = 20
_FOOTER_HEAD = struct.pack("<BQ", Opcode.FOOTER, _FOOTER_BYTES)
_DAMAGE = (ValueError, struct.error, McapError, MemoryError, RuntimeError, zstandard.ZstdError)

_log_time = attrgetter("log_time_ns")


@dataclass(slots=True)
class _Piece:
    """A chunk's compressed data, or a run of records outside chunks (size -1), with the log times it covers."""

    start_ns: int
    end_ns: int
    begin: int
    end: int
    compression: str = ""
    uncompressed_size: int = -1
    crc: int = 0
    is_cut: bool = False


class McapFile:
    """One MCAP file, walked over when it is opened; chunks are decompressed only when they are read.

    Parameters
    ----------
    path : Path
        The file.
    name : str
        What it is called in messages.
    complain : callable
        Called with every problem of the file, some more than once.

    Attributes
    ----------
    attachments : list of Attachment
    fraction : float
        Part of the file that `records` has read, 0 to 1.

    Raises
    ------
    BagError
        Nothing of the file can be used.
    OSError
        It cannot be read.
    """

    storage = "mcap"

    def __init__(self, path: Path, name: str, complain: Callable[[str], None]) -> None:
        self.attachments: list[Attachment] = []
        self._complain: Callable[[str], None] = lambda text: complain(f"{name}: {text}")
        self.fraction = 0.0
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._pieces: list[_Piece] = []
        with path.open("rb") as stream:
            magic = stream.read(len(MAGIC))
            if not magic:
                raise BagError(f"{name}: the file is empty")
            if magic != MAGIC:
                raise BagError(f"{name}: not an MCAP file (its first bytes are {magic.hex(' ')})")
            self._data = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        if not self._scan():
            for piece in self._pieces:  # there may be channels that only chunks define
                self._read(piece, ())

    def close(self) -> None:
        """Let go of the file."""
        self._data.close()

    # ------------------------------------------------------------------ the whole file

    def _scan(self) -> bool:
        """Find chunks, attachments, schemas and channels; False when there may be more of the latter in chunks."""
        size, summary = len(self._data), self._summary_start()
        is_finished = is_whole = bool(summary)

        def damaged(begin: int, end: int) -> None:
            nonlocal is_whole
            is_whole = False
            self._complain(f"damaged: bytes {begin} to {end} are left out")

        run: _Piece | None = None
        at = len(MAGIC)
        for opcode, begin, end in frames(self._data, at, summary or size, damaged):
            at = min(end, size)
            if opcode == Opcode.CHUNK:
                self._add_chunk(begin, end)
            elif end > size:
                break
            elif opcode == Opcode.MESSAGE:
                log_time = _MESSAGE.unpack_from(self._data, begin)[2]
                if run is None or run.end != begin - HEAD_BYTES or end - run.begin > _RUN_BYTES:
                    run = _Piece(log_time, log_time, begin - HEAD_BYTES, end)
                    self._pieces.append(run)
                else:
                    run.start_ns, run.end_ns, run.end = min(run.start_ns, log_time), max(run.end_ns, log_time), end
            elif opcode == Opcode.DATA_END:
                is_finished = self._data[-len(MAGIC) :] == MAGIC
                break
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.ATTACHMENT):
                self._take(opcode, self._data[begin:end])
        if summary:
            for opcode, begin, end in frames(self._data, summary, size, damaged):
                if opcode in (Opcode.SCHEMA, Opcode.CHANNEL) and end <= size:
                    self._take(opcode, self._data[begin:end], is_copy=True)
        if not is_finished:
            self._complain(f"not finished (recorder killed or disk full?); read up to byte {at}")
        return is_whole

    def _summary_start(self) -> int:
        """Where the summary begins; 0 if the file has none (it was cut off, or never finished)."""
        foot = len(self._data) - len(MAGIC) - _FOOTER_BYTES
        if foot < HEAD_BYTES or self._data[foot - HEAD_BYTES : foot] != _FOOTER_HEAD:
            return 0
        start = int.from_bytes(self._data[foot : foot + 8], "little")
        return start if len(MAGIC) <= start < foot else 0

    def _take(self, opcode: int, body: bytes, is_copy: bool = False) -> None:
        """Take up a schema, channel or attachment; a copy in the summary only where the original is missing."""
        stream = ReadDataStream(BytesIO(body))
        try:
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                if not (is_copy and schema.id in self._schemas):
                    self._schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(stream)
                if not (is_copy and channel.id in self._channels):
                    self._channels[channel.id] = channel
            else:
                attachment = Attachment.read(stream)
                if zlib.crc32(body[:-4]) != int.from_bytes(body[-4:], "little") != 0:
                    raise ValueError(f"attachment '{attachment.name}' has a wrong checksum")
                self.attachments.append(attachment)
        except _DAMAGE as error:
            self._complain(f"a record of kind {Opcode(opcode).name.lower()} is damaged and left out: {error}")

    def _add_chunk(self, begin: int, end: int) -> None:
        size = len(self._data)
        compression, data_begin, data_end = chunk_data(self._data, begin)
        if data_begin > size:
            return  # cut off in its head
        if data_end > end:
            self._complain(f"damaged: the chunk at byte {begin} is larger than its record")
            return
        start_ns, end_ns, uncompressed_size, crc = CHUNK_HEAD.unpack_from(self._data, begin)
        is_cut = data_end > size
        piece = _Piece(start_ns, end_ns, data_begin, min(data_end, size), compression, uncompressed_size, crc, is_cut)
        self._pieces.append(piece)

    def topics(self) -> list[RecordedTopic]:
        """All topics that are known so far; reading may add more where the file is damaged."""
        result = []
        for channel in self._channels.values():
            schema = self._schemas.get(channel.schema_id)
            result.append(
                RecordedTopic(
                    channel.topic,
                    schema.name if schema else "",
                    schema.data.decode("utf-8", "replace") if schema else "",
                    channel.metadata.get("topic_type_hash", ""),
                    tuple(read_qos(channel.metadata.get("offered_qos_profiles", ""))),
                    channel.message_encoding,
                    schema.encoding if schema else "",
                )
            )
        return result

    # ------------------------------------------------------------------ messages

    def records(self, topics: Collection[str] | None, start_ns: int, stop_ns: int) -> Iterator[BagRecord]:
        """Messages with ``start_ns`` <= log time < ``stop_ns`` by log time; equal times keep the file's order."""
        pieces = [one for one in self._pieces if one.is_cut or (one.end_ns >= start_ns and one.start_ns < stop_ns)]
        pieces.sort(key=attrgetter("start_ns"))
        waiting: list[BagRecord] = []
        for number, piece in enumerate(pieces, 1):
            waiting += self._read(piece, topics)
            waiting.sort(key=_log_time)
            ready = len(waiting)
            if number < len(pieces) and ready < _MOST_WAITING:
                ready = bisect_left(waiting, pieces[number].start_ns, key=_log_time)
            self.fraction = number / len(pieces)
            for record in waiting[:ready]:
                if start_ns <= record.log_time_ns < stop_ns:
                    yield record
            del waiting[:ready]

    def _read(self, piece: _Piece, topics: Collection[str] | None) -> list[BagRecord]:
        """Messages of a chunk or run, in the order of the file; schemas and channels in it are taken up."""
        data: Buffer = self._data
        at, stop = piece.begin, piece.end
        if piece.uncompressed_size >= 0:
            try:
                data = _content(data[piece.begin : piece.end], piece)
            except _DAMAGE as error:
                self._complain(f"the chunk at byte {piece.begin} is left out: {error}")
                return []
            at, stop = 0, len(data)

        def damaged(begin: int, end: int) -> None:
            if not piece.is_cut:
                self._complain(f"damaged: {end - begin} bytes of the chunk at byte {piece.begin} are left out")

        records: list[BagRecord] = []
        targets: dict[int, tuple[str, str] | None] = {}
        for opcode, begin, end in frames(data, at, stop, damaged):
            if end > stop:
                break
            if opcode == Opcode.MESSAGE:
                channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(data, begin)
                if channel not in targets:
                    targets[channel] = self._target(channel, topics)
                target = targets[channel]
                if target is not None:
                    body = data[begin + _MESSAGE.size : end]
                    records.append(BagRecord(*target, log_time, publish_time, body, sequence))
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._take(opcode, data[begin:end])
        return records

    def _target(self, channel_id: int, topics: Collection[str] | None) -> tuple[str, str] | None:
        """Topic and type of a channel; None when its messages are not wanted."""
        channel = self._channels.get(channel_id)
        if channel is None:
            self._complain(f"messages of channel {channel_id}, which is not defined, are left out")
            return None
        if topics is not None and channel.topic not in topics:
            return None
        schema = self._schemas.get(channel.schema_id)
        return channel.topic, schema.name if schema else ""


def _content(data: bytes, piece: _Piece) -> bytes:
    """Records of a chunk; of one that is cut off what is left.

    Raises
    ------
    ValueError, RuntimeError, ZstdError
        The chunk is damaged, too large, or its compression is not known.
    """
    size = piece.uncompressed_size
    if max(len(data), size) > MAX_CHUNK_BYTES:
        raise ValueError(f"it is larger than the {MAX_CHUNK_BYTES} bytes that are accepted")
    # One byte more than the chunk announces shows that it is damaged; nothing expands further.
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
