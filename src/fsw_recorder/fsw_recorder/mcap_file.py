"""Reads MCAP files in any state: whole, cut off or damaged.

The libraries cannot do that: ``mcap`` and ``rosbags`` give up at the first damaged record, and ``mcap`` takes ten times
as long for a weld. So the frames of the records (one byte of type, eight of length) are walked here, over a memory map
of the file; what stands inside a frame is left to ``mcap``. A frame whose neighbour makes no sense is searched for the
next place from which frames follow each other again, so that damage costs only the records it hits.

Every length is checked against what is left of the file, and a chunk never expands beyond ``MAX_CHUNK_BYTES``: damaged
files cost neither time nor memory. Layout of the records: https://mcap.dev/spec
"""

from __future__ import annotations

import mmap
import re
import struct
import zlib
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Schema
from mcap.writer import MCAP0_MAGIC as MAGIC

from fsw_recorder.errors import BagError

MAX_CHUNK_BYTES = 256 * 1024 * 1024
#: most messages that wait for earlier ones in chunks that overlap in time
_MOST_WAITING = 1_000_000
#: largest run of messages outside chunks that is sorted at once
_RUN_BYTES = 1024 * 1024
#: consecutive frames that a place behind damage needs to count as good
_CHAIN = 3
_BITE_BYTES = 4096

_FRAME = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK = struct.Struct("<QQQI")
_HEAD = _FRAME.size
#: least length of every type of record in the data section, with all texts empty; and of all types
_LEAST = {1: 8, 3: 14, 4: 16, 5: 22, 6: 40, 7: 6, 9: 36, 12: 8, 15: 4}
_LEAST_OF_ALL = dict.fromkeys(range(1, 16), 0) | _LEAST
_NEVER = 2**64
#: a frame of the data section with a length that is possible
_CANDIDATE = re.compile(rb"(?=[\x03-\x07\x09\x0c\x0f].{4}\0{4})", re.DOTALL)
_DAMAGE = (ValueError, struct.error, McapError, MemoryError)

Buffer = bytes | mmap.mmap
#: log time, channel, sequence, publish time, data
Message = tuple[int, int, int, int, bytes]


class Piece(NamedTuple):
    """A chunk's compressed data, or a run of records outside chunks, with the log times it covers."""

    start_ns: int
    end_ns: int
    begin: int
    end: int
    compression: str = ""
    uncompressed_size: int = -1
    crc: int = 0
    cut: bool = False


class McapFile:
    """One MCAP file, walked over when it is opened; chunks are decompressed only when they are read.

    Parameters
    ----------
    path : Path
        The file.
    name : str
        What it is called in messages.

    Attributes
    ----------
    schemas, channels : dict of int to Schema or Channel
        As far as they are known; `messages` adds those inside chunks.
    attachments : list of Attachment
    problems : list of str
        What is wrong with the file, so far.
    fraction : float
        Part of the file that `messages` has read, 0 to 1.

    Raises
    ------
    BagError
        Nothing of the file can be used.
    OSError
        It cannot be read.
    """

    def __init__(self, path: Path, name: str) -> None:
        self.name = name
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.attachments: list[Attachment] = []
        self.problems: list[str] = []
        self.fraction = 0.0
        self._pieces: list[Piece] = []
        with path.open("rb") as stream:
            if not stream.seek(0, 2):
                raise BagError(f"{name}: the file is empty")
            stream.seek(0)
            magic = stream.read(len(MAGIC))
            if magic != MAGIC:
                raise BagError(f"{name}: not an MCAP file (its first bytes are {magic.hex(' ')})")
            self._data = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        self._scan()

    def close(self) -> None:
        """Let go of the file."""
        self._data.close()

    def complain(self, text: str) -> None:
        """Note a problem, once."""
        if f"{self.name}: {text}" not in self.problems:
            self.problems.append(f"{self.name}: {text}")

    # ------------------------------------------------------------------ the whole file

    def _scan(self) -> None:
        size, summary = len(self._data), self._summary_start()
        run: list[int] = []  # begin, end, first and last log time
        finished = False

        def end_run() -> None:
            if run:
                self._pieces.append(Piece(run[2], run[3], run[0], run[1]))
                run.clear()

        at = len(MAGIC)
        for opcode, begin, end in frames(self._data, at, summary or size, self._damaged):
            at = min(end, size)
            if opcode == Opcode.MESSAGE:
                if end > size:
                    break
                log_time = _MESSAGE.unpack_from(self._data, begin)[2]
                if run and (run[1] != begin - _HEAD or end - run[0] > _RUN_BYTES):
                    end_run()
                if run:
                    run[1:] = [end, min(run[2], log_time), max(run[3], log_time)]
                else:
                    run[:] = [begin - _HEAD, end, log_time, log_time]
            elif opcode == Opcode.CHUNK:
                piece = self._chunk(begin, end)
                if piece is not None:
                    self._pieces.append(piece)
            elif end <= size:
                self._take(opcode, self._data[begin:end])
            if opcode == Opcode.DATA_END:
                finished = self._data[-len(MAGIC) :] == MAGIC
                break
        end_run()
        if summary:
            for opcode, begin, end in frames(self._data, summary, size, lambda *_: None, _LEAST_OF_ALL):
                if opcode in (Opcode.SCHEMA, Opcode.CHANNEL) and end <= size:
                    self._take(opcode, self._data[begin:end], repeated=True)
        if not finished and not self.problems:
            self.complain(f"not finished (recorder killed or disk full?); read up to byte {at}")

    def _summary_start(self) -> int:
        """Where the summary begins; 0 if the file has none (it was cut off, or never finished)."""
        size = len(self._data)
        foot = size - len(MAGIC) - 20
        if foot < _HEAD or self._data[foot - _HEAD : foot] != _FRAME.pack(Opcode.FOOTER, 20):
            return 0
        start = int.from_bytes(self._data[foot : foot + 8], "little")
        return start if len(MAGIC) <= start < foot else 0

    def _damaged(self, begin: int, end: int) -> None:
        self.complain(f"damaged: bytes {begin} to {end} are left out")

    def _take(self, opcode: int, body: bytes, repeated: bool = False) -> None:
        """Take up what is not a message; a copy in the summary only where the original is missing."""
        stream = ReadDataStream(BytesIO(body))
        try:
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                if not (repeated and schema.id in self.schemas):
                    self.schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(stream)
                if not (repeated and channel.id in self.channels):
                    self.channels[channel.id] = channel
            elif opcode == Opcode.ATTACHMENT:
                attachment = Attachment.read(stream)
                if zlib.crc32(body[:-4]) != int.from_bytes(body[-4:], "little") != 0:
                    raise ValueError(f"attachment '{attachment.name}' has a wrong checksum")
                self.attachments.append(attachment)
        except _DAMAGE as error:
            self.complain(f"a record of kind {Opcode(opcode).name.lower()} is damaged and left out: {error}")

    def _chunk(self, begin: int, end: int) -> Piece | None:
        size = len(self._data)
        try:
            start, stop, uncompressed, crc = _CHUNK.unpack_from(self._data, begin)
            at = begin + _CHUNK.size
            length = int.from_bytes(self._data[at : at + 4], "little")
            compression = self._data[at + 4 : at + 4 + length].decode() if length <= 64 else "?"
            at += 4 + length
            data_end = at + 8 + int.from_bytes(self._data[at : at + 8], "little")
        except _DAMAGE:
            return None  # cut off in its head
        if data_end > end:
            self.complain(f"damaged: the chunk at byte {begin} is larger than its record")
            return None
        return Piece(start, stop, at + 8, min(data_end, size), compression, uncompressed, crc, data_end > size)

    # ------------------------------------------------------------------ messages

    def messages(self, start_ns: int, stop_ns: int) -> Iterator[Message]:
        """Messages with ``start_ns`` <= log time < ``stop_ns`` by log time; equal times keep the file's order."""
        pieces = sorted(self._pieces, key=lambda piece: piece.start_ns)
        if not self.channels and (pieces != self._pieces or start_ns):
            for piece in self._pieces:  # channels inside chunks must be known before those chunks are read
                self._piece_messages(piece)
        pieces = [one for one in pieces if one.cut or (one.end_ns >= start_ns and one.start_ns < stop_ns)]
        waiting: list[Message] = []
        for position, piece in enumerate(pieces):
            waiting += self._piece_messages(piece)
            waiting.sort(key=_log_time)
            later = pieces[position + 1].start_ns if position + 1 < len(pieces) else None
            ready = len(waiting)
            if later is not None and ready < _MOST_WAITING:
                ready = bisect_left(waiting, later, key=_log_time)
            self.fraction = (position + 1) / len(pieces)
            for message in waiting[:ready]:
                if start_ns <= message[0] < stop_ns:
                    yield message
            del waiting[:ready]

    def _piece_messages(self, piece: Piece) -> list[Message]:
        """Messages of a chunk or run, in the order of the file; schemas and channels in it are taken up."""
        data: Buffer = self._data
        at, stop = piece.begin, piece.end
        if piece.uncompressed_size >= 0:
            try:
                data = uncompressed(data[piece.begin : piece.end], piece)
            except _DAMAGE as error:
                self.complain(f"the chunk at byte {piece.begin} is left out: {error}")
                return []
            at, stop = 0, len(data)

        def damaged(begin: int, end: int) -> None:
            if not piece.cut:
                self.complain(f"damaged: {end - begin} bytes of the chunk at byte {piece.begin} are left out")

        messages: list[Message] = []
        unpack = _MESSAGE.unpack_from
        for opcode, begin, end in frames(data, at, stop, damaged):
            if end > stop:
                break
            if opcode == Opcode.MESSAGE:
                channel, sequence, log_time, publish_time = unpack(data, begin)
                messages.append((log_time, channel, sequence, publish_time, data[begin + _MESSAGE.size : end]))
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._take(opcode, data[begin:end])
        return messages


def frames(
    data: Buffer,
    at: int,
    stop: int,
    damaged: Callable[[int, int], None],
    least: Mapping[int, int] = _LEAST,
) -> Iterator[tuple[int, int, int]]:
    """Records between two offsets: type, begin and end of the body; the last may end behind ``stop`` (cut off).

    Parameters
    ----------
    data : bytes or mmap
        Of a file or a chunk.
    at, stop : int
        Where to begin and end.
    damaged : callable
        Called with begin and end of what is passed over.
    least : mapping of int to int
        Types that may occur, with the least length of each.
    """
    unpack = _FRAME.unpack_from
    while at + _HEAD <= stop:
        opcode, length = unpack(data, at)
        end = at + _HEAD + length
        possible = least.get(opcode, _NEVER) <= length
        if possible and end <= stop and (end + _HEAD > stop or _follows(data, end, stop, least)):
            yield opcode, at + _HEAD, end
            at = end
            continue
        # The length of this frame, or the head of the next one, is damaged; or the file is cut off inside this frame.
        trusted = possible and opcode == Opcode.CHUNK and _fits_chunk(data, at + _HEAD, length)
        further = _next_frame(data, end if trusted else at + 1, stop)
        if possible and (trusted or further is None or further >= end):
            yield opcode, at + _HEAD, end
            at = end
        if further is None:
            if at < stop:
                damaged(at, stop)
            return
        if further > at:
            damaged(at, further)
        at = max(at, further)


def _follows(data: Buffer, at: int, stop: int, least: Mapping[int, int]) -> bool:
    """Whether a frame begins here; its length must make sense, for a damaged one before it may end anywhere."""
    opcode, length = _FRAME.unpack_from(data, at)
    if least.get(opcode, _NEVER) > length:
        return False
    if at + _HEAD + length <= stop:
        return True
    whole_chunk = opcode == Opcode.CHUNK and _fits_chunk(data, at + _HEAD, length)
    return whole_chunk or _next_frame(data, at + 1, stop) is None  # cut off


def _fits_chunk(data: Buffer, begin: int, length: int) -> bool:
    """Whether the lengths inside a chunk add up to that of its record."""
    name = _CHUNK.size + 4 + int.from_bytes(data[begin + _CHUNK.size : begin + _CHUNK.size + 4], "little")
    return name + 8 + int.from_bytes(data[begin + name : begin + name + 8], "little") == length


def _next_frame(data: Buffer, at: int, stop: int) -> int | None:
    """First offset from ``at`` on where several frames follow each other; None if there is none."""
    for match in _CANDIDATE.finditer(data, min(at, stop), stop):
        if _chained(data, match.start(), stop):
            return match.start()
    return None


def _chained(data: Buffer, at: int, stop: int) -> bool:
    """Whether enough frames follow each other from ``at`` on, up to the very end if that is near."""
    for link in range(_CHAIN):
        if at + _HEAD > stop:
            return at == stop or link > 1
        opcode, length = _FRAME.unpack_from(data, at)
        if not _LEAST.get(opcode, _NEVER) <= length <= MAX_CHUNK_BYTES:
            return False
        at += _HEAD + length
        if at > stop:
            return link > 1
    return True


def uncompressed(data: bytes, piece: Piece) -> bytes:
    """Records of a chunk; of a cut one what is left.

    Raises
    ------
    ValueError
        The chunk is damaged, too large, or its compression is not known.
    """
    if max(len(data), piece.uncompressed_size) > MAX_CHUNK_BYTES:
        raise ValueError(f"it is larger than the {MAX_CHUNK_BYTES} bytes that are accepted")
    if piece.compression:
        makers = {
            "zstd": lambda: zstandard.ZstdDecompressor(max_window_size=2**27).decompressobj(),
            "lz4": lz4.frame.LZ4FrameDecompressor,
        }
        if piece.compression not in makers:
            raise ValueError(f"compression '{piece.compression[:20]}' is not known")
        decompressor = makers[piece.compression]()
        result = bytearray()
        try:
            # In small bites: what comes before a cut is kept, and nothing expands beyond what the chunk announces.
            for at in range(0, len(data), _BITE_BYTES):
                result += decompressor.decompress(data[at : at + _BITE_BYTES])
                if decompressor.eof or len(result) > piece.uncompressed_size:
                    break
        except (zstandard.ZstdError, RuntimeError, EOFError) as error:
            if not piece.cut:
                raise ValueError(f"{piece.compression}: {error}") from None
        data = bytes(result)
    if not piece.cut:
        if len(data) != piece.uncompressed_size:
            raise ValueError(f"it holds {len(data)} bytes, it should hold {piece.uncompressed_size}")
        if piece.crc and zlib.crc32(data) != piece.crc:
            raise ValueError("its checksum is wrong")
    return data


def _log_time(message: Message) -> int:
    return message[0]
