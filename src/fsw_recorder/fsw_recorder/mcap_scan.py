"""Reads MCAP files of any origin and in any state: whole, cut off, damaged or plain rubbish.

The data section is walked record by record, so neither the summary nor the footer is needed; the summary is used
to find chunks behind a damaged place and to know channels early. Every length is checked against what is left of
the file, and a chunk never expands beyond ``MAX_CHUNK_BYTES``, so damaged files cost neither time nor memory.
Layout of the records: https://mcap.dev/spec
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import BinaryIO

import zstandard

from fsw_recorder.errors import BagError

MAGIC = b"\x89MCAP0\r\n"
MAX_CHUNK_BYTES = 256 * 1024 * 1024
PLAIN_RUN_BYTES = 1024 * 1024

OP_HEADER, OP_FOOTER, OP_SCHEMA, OP_CHANNEL, OP_MESSAGE, OP_CHUNK = 1, 2, 3, 4, 5, 6
OP_CHUNK_INDEX, OP_ATTACHMENT, OP_METADATA, OP_DATA_END = 8, 9, 12, 15
_HIGHEST_KNOWN_OPCODE = 0x0F

_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK = struct.Struct("<QQQI")
_U16, _U32, _U64 = struct.Struct("<H"), struct.Struct("<I"), struct.Struct("<Q")


@dataclass(frozen=True, slots=True)
class Schema:
    """A message definition as the file holds it."""

    name: str
    encoding: str
    text: bytes


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic as the file holds it."""

    schema_id: int
    topic: str
    encoding: str
    metadata: dict[str, str]


@dataclass(frozen=True, slots=True)
class Piece:
    """A chunk, or a run of records outside chunks, that holds messages.

    ``offset`` and ``size`` are of the chunk's (compressed) data or of the run. ``cut`` means that the file ends
    inside.
    """

    offset: int
    size: int
    start_ns: int
    end_ns: int
    compression: str
    uncompressed_size: int
    crc: int
    cut: bool = False


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file inside the bag."""

    name: str
    media_type: str
    log_time_ns: int
    create_time_ns: int
    data: bytes


#: log_time_ns, channel_id, sequence, publish_time_ns, data
Message = tuple[int, int, int, int, bytes]


class _Fields:
    """Cursor over one record's body that never reads past its end."""

    def __init__(self, body: bytes) -> None:
        self._body = body
        self._at = 0

    def take(self, size: int) -> bytes:
        if size > len(self._body) - self._at:
            raise ValueError("a length points past the end of the record")
        self._at += size
        return self._body[self._at - size : self._at]

    def u16(self) -> int:
        return int(_U16.unpack(self.take(2))[0])

    def u32(self) -> int:
        return int(_U32.unpack(self.take(4))[0])

    def u64(self) -> int:
        return int(_U64.unpack(self.take(8))[0])

    def text(self) -> str:
        return self.take(self.u32()).decode("utf-8")

    def text_map(self) -> dict[str, str]:
        inner = _Fields(self.take(self.u32()))
        result: dict[str, str] = {}
        while inner._at < len(inner._body):
            key = inner.text()
            result[key] = inner.text()
        return result


@dataclass
class McapScan:
    """What one MCAP file holds.

    Attributes
    ----------
    name : str
        The file's name, for messages.
    profile, library : str
        Of the file's header.
    pieces : list[Piece]
        Chunks and runs in the order of the file.
    schemas, channels : dict
        By id, as far as they are known; `messages` adds those it meets.
    attachments : list[Attachment]
    metadata : list[tuple[str, dict[str, str]]]
        Name and contents of the file's metadata records.
    finished : bool
        The file was closed properly (data end, footer and closing magic are there).
    good_end : int
        Offset behind the last whole record of the data section.
    problems : list[str]
        What is wrong with the file.
    """

    name: str
    profile: str = ""
    library: str = ""
    pieces: list[Piece] = field(default_factory=list)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    attachments: list[Attachment] = field(default_factory=list)
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    finished: bool = False
    good_end: int = 0
    problems: list[str] = field(default_factory=list)

    def register(self, opcode: int, body: bytes) -> None:
        """Take up a schema or channel record."""
        fields = _Fields(body)
        if opcode == OP_SCHEMA:
            identity, name, encoding = fields.u16(), fields.text(), fields.text()
            self.schemas[identity] = Schema(name, encoding, fields.take(fields.u32()))
        else:
            identity, schema_id, topic, encoding = fields.u16(), fields.u16(), fields.text(), fields.text()
            self.channels[identity] = Channel(schema_id, topic, encoding, fields.text_map())


def scan_mcap(stream: BinaryIO, name: str) -> McapScan:
    """Walk over a file's records without decompressing anything.

    Parameters
    ----------
    stream : BinaryIO
        Seekable file.
    name : str
        The file's name, for messages.

    Raises
    ------
    BagError
        Nothing of the file can be used (empty, not MCAP, another profile's encoding is fine).
    """
    scan = McapScan(name)
    size = stream.seek(0, 2)
    stream.seek(0)
    magic = stream.read(8)
    if not magic:
        raise BagError(f"{name}: the file is empty")
    if magic != MAGIC:
        raise BagError(f"{name}: not an MCAP file (its first bytes are {magic.hex(' ')})")
    scan.good_end = 8
    try:
        _walk(scan, stream, size)
    except (ValueError, struct.error) as error:
        scan.problems.append(f"{name}: damaged at byte {scan.good_end} of {size}: {error}")
    _read_summary(scan, stream, size)
    if not scan.finished and not scan.problems:
        scan.problems.append(f"{name}: not finished (recorder killed or disk full?); read up to byte {scan.good_end}")
    return scan


def _walk(scan: McapScan, stream: BinaryIO, size: int) -> None:
    run_start = run_from = run_to = 0
    run_open = False

    def close_run(end: int) -> None:
        nonlocal run_open
        if run_open:
            scan.pieces.append(Piece(run_start, end - run_start, run_from, run_to, "", end - run_start, 0))
        run_open = False

    while True:
        at = scan.good_end
        stream.seek(at)
        head = stream.read(9 + 22)
        if len(head) < 9:
            close_run(at)
            return
        opcode, length = _RECORD.unpack_from(head)
        end = at + 9 + length
        if opcode == 0 or (opcode > _HIGHEST_KNOWN_OPCODE and opcode < 0x80):
            close_run(at)
            raise ValueError(f"record type {opcode:#04x} does not exist")
        if end > size:
            close_run(at)
            if opcode == OP_CHUNK:
                _add_chunk(scan, stream, at, length, size)
            return
        if opcode == OP_MESSAGE:
            if length < 22:
                raise ValueError("message record too short")
            log_time = _MESSAGE.unpack_from(head, 9)[2]
            if not run_open:
                run_open, run_start, run_from, run_to = True, at, log_time, log_time
            run_from, run_to = min(run_from, log_time), max(run_to, log_time)
            if end - run_start > PLAIN_RUN_BYTES:
                close_run(end)
        elif opcode == OP_CHUNK:
            close_run(at)
            _add_chunk(scan, stream, at, length, size)
        elif opcode in (OP_SCHEMA, OP_CHANNEL):
            scan.register(opcode, _body(stream, at, length))
        elif opcode == OP_HEADER:
            fields = _Fields(_body(stream, at, length))
            scan.profile, scan.library = fields.text(), fields.text()
        elif opcode == OP_ATTACHMENT:
            close_run(at)
            _add_attachment(scan, _body(stream, at, length))
        elif opcode == OP_METADATA:
            fields = _Fields(_body(stream, at, length))
            scan.metadata.append((fields.text(), fields.text_map()))
        scan.good_end = end
        if opcode == OP_DATA_END:
            close_run(at)
            stream.seek(size - 8)
            scan.finished = size - 8 >= end and stream.read(8) == MAGIC
            return


def _body(stream: BinaryIO, at: int, length: int) -> bytes:
    if length > MAX_CHUNK_BYTES:
        raise ValueError(f"a record of {length} bytes is larger than the {MAX_CHUNK_BYTES} that are accepted")
    stream.seek(at + 9)
    return stream.read(length)


def _add_attachment(scan: McapScan, body: bytes) -> None:
    fields = _Fields(body)
    log_time, create_time, name, media_type = fields.u64(), fields.u64(), fields.text(), fields.text()
    data = fields.take(fields.u64())
    crc = fields.u32()
    if crc and zlib.crc32(body[:-4]) != crc:
        scan.problems.append(f"{scan.name}: attachment '{name}' is damaged (checksum)")
        return
    scan.attachments.append(Attachment(name, media_type, log_time, create_time, data))


def _add_chunk(scan: McapScan, stream: BinaryIO, at: int, length: int, size: int) -> None:
    stream.seek(at + 9)
    head = _Fields(stream.read(min(length, 28 + 4 + 64 + 8)))
    start, end, uncompressed, crc = _CHUNK.unpack(head.take(28))
    compression = head.text()
    data_size = head.u64()
    data_at = at + 9 + 28 + 4 + len(compression.encode()) + 8
    if data_at + data_size > at + 9 + length:
        raise ValueError("a chunk is larger than its record")
    cut = data_at + data_size > size
    if cut:
        data_size = max(size - data_at, 0)
    scan.pieces.append(Piece(data_at, data_size, start, end, compression, uncompressed, crc, cut))


def _read_summary(scan: McapScan, stream: BinaryIO, size: int) -> None:
    """Take channels from the summary, and the chunks behind a damaged place."""
    if size < 8 + 37:
        return
    stream.seek(size - 37)
    tail = stream.read(37)
    if tail[29:] != MAGIC or tail[:9] != _RECORD.pack(OP_FOOTER, 20):
        return
    summary_start, _offsets_start, crc = struct.unpack_from("<QQI", tail, 9)
    if not 8 <= summary_start <= size - 37 or size - 37 - summary_start > MAX_CHUNK_BYTES:
        return
    stream.seek(summary_start)
    summary = stream.read(size - 37 - summary_start)
    if crc and zlib.crc32(tail[:25], zlib.crc32(summary)) != crc:
        scan.problems.append(f"{scan.name}: the summary at the end is damaged (checksum) and not used")
        return
    known = {piece.offset for piece in scan.pieces}
    lost: list[int] = []
    at = 0
    try:
        while at + 9 <= len(summary):
            opcode, length = _RECORD.unpack_from(summary, at)
            body = summary[at + 9 : at + 9 + length]
            if len(body) < length:
                return
            if opcode in (OP_SCHEMA, OP_CHANNEL):
                scan.register(opcode, body)
            elif opcode == OP_CHUNK_INDEX and not scan.finished:
                lost.append(int(_U64.unpack_from(body, 16)[0]))
            at += 9 + length
        for offset in lost:
            if scan.good_end <= offset < size - 9:
                stream.seek(offset)
                opcode, length = _RECORD.unpack(stream.read(9))
                if opcode == OP_CHUNK and offset + 9 + length <= size:
                    before = len(scan.pieces)
                    _add_chunk(scan, stream, offset, length, size)
                    if scan.pieces[before].offset in known:
                        scan.pieces.pop()
    except (ValueError, struct.error) as error:
        scan.problems.append(f"{scan.name}: the summary at the end is damaged: {error}")


def piece_data(scan: McapScan, stream: BinaryIO, piece: Piece) -> bytes:
    """Uncompressed records of a chunk or run; of a cut chunk what is left.

    Raises
    ------
    ValueError
        The chunk is damaged, too large, or its compression is unknown.
    """
    if max(piece.size, piece.uncompressed_size) > MAX_CHUNK_BYTES:
        raise ValueError(f"the chunk is larger than the {MAX_CHUNK_BYTES} bytes that are accepted")
    stream.seek(piece.offset)
    data = stream.read(piece.size)
    if piece.compression == "zstd":
        data = _unzstd(data, piece)
    elif piece.compression == "lz4":
        data = _unlz4(data, piece)
    elif piece.compression:
        raise ValueError(f"compression '{piece.compression[:20]}' is not known")
    if not piece.cut:
        if len(data) != piece.uncompressed_size:
            raise ValueError(f"the chunk holds {len(data)} bytes, it should hold {piece.uncompressed_size}")
        if piece.crc and zlib.crc32(data) != piece.crc:
            raise ValueError("the chunk's checksum is wrong")
    return data


def _unzstd(data: bytes, piece: Piece) -> bytes:
    decompressor = zstandard.ZstdDecompressor(max_window_size=2**27).decompressobj()
    result = bytearray()
    try:
        # In small bites: what comes before a cut is kept, and nothing expands beyond what the chunk announces.
        for at in range(0, len(data), 4096):
            result += decompressor.decompress(data[at : at + 4096])
            if len(result) > piece.uncompressed_size:
                raise ValueError("the chunk is larger than it announces")
            if decompressor.eof:
                break
    except zstandard.ZstdError as error:
        if not piece.cut:
            raise ValueError(f"zstd: {error}") from None
    return bytes(result)


def _unlz4(data: bytes, piece: Piece) -> bytes:
    try:
        import lz4.frame  # type: ignore[import-untyped]
    except ImportError:
        raise ValueError("lz4 compression needs the Python package lz4") from None
    decompressor = lz4.frame.LZ4FrameDecompressor()
    try:
        result: bytes = decompressor.decompress(data, max_length=piece.uncompressed_size)
    except (RuntimeError, EOFError) as error:
        raise ValueError(f"lz4: {error}") from None
    return result


def piece_messages(scan: McapScan, stream: BinaryIO, piece: Piece) -> list[Message]:
    """Messages of a chunk or run, in the order of the file; schemas and channels it holds are registered.

    A damaged piece yields nothing and adds to ``scan.problems``.
    """
    try:
        data = piece_data(scan, stream, piece)
    except (ValueError, MemoryError) as error:
        _complain(scan, f"{scan.name}: chunk at byte {piece.offset} skipped: {error}")
        return []
    messages: list[Message] = []
    append = messages.append
    unpack_record, unpack_message = _RECORD.unpack_from, _MESSAGE.unpack_from
    at, stop = 0, len(data)
    try:
        while at + 9 <= stop:
            opcode, length = unpack_record(data, at)
            body = at + 9
            at = body + length
            if at > stop:
                if not piece.cut:
                    raise ValueError("a record points past the end of the chunk")
                break
            if opcode == OP_MESSAGE:
                if length < 22:
                    raise ValueError("message record too short")
                channel, sequence, log_time, publish_time = unpack_message(data, body)
                append((log_time, channel, sequence, publish_time, data[body + 22 : at]))
            elif opcode in (OP_SCHEMA, OP_CHANNEL):
                scan.register(opcode, data[body:at])
    except (ValueError, struct.error) as error:
        _complain(scan, f"{scan.name}: chunk at byte {piece.offset} read only in part: {error}")
    return messages


def _complain(scan: McapScan, text: str) -> None:
    if text not in scan.problems:
        scan.problems.append(text)


def messages_in_time(scan: McapScan, stream: BinaryIO, start_ns: int, stop_ns: int) -> Iterator[Message]:
    """Messages with ``start_ns`` <= log time < ``stop_ns`` in order of log time; equal times keep the file's order."""
    pieces = sorted(scan.pieces, key=lambda piece: piece.start_ns)
    if pieces != scan.pieces:
        # Channels must be known before their messages, whatever the order in which chunks are read.
        for piece in scan.pieces:
            if not scan.channels:
                piece_messages(scan, stream, piece)
    pending: list[Message] = []
    pieces = [piece for piece in pieces if piece.cut or (piece.end_ns >= start_ns and piece.start_ns < stop_ns)]
    for position, piece in enumerate(pieces):
        pending += piece_messages(scan, stream, piece)
        pending.sort(key=_log_time)
        horizon = pieces[position + 1].start_ns if position + 1 < len(pieces) else None
        if horizon is None or not pending or pending[-1][0] < horizon or len(pending) > 1_000_000:
            ready, pending = pending, []
        else:
            cut = _first_at_or_after(pending, horizon)
            ready, pending = pending[:cut], pending[cut:]
        for message in ready:
            if start_ns <= message[0] < stop_ns:
                yield message


def _log_time(message: Message) -> int:
    return message[0]


def _first_at_or_after(messages: list[Message], time_ns: int) -> int:
    low, high = 0, len(messages)
    while low < high:
        middle = (low + high) // 2
        if messages[middle][0] < time_ns:
            low = middle + 1
        else:
            high = middle
    return low
