"""Finds the records of an MCAP file or chunk, also beyond damage.

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
from collections.abc import Iterator

from mcap.opcode import Opcode

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
