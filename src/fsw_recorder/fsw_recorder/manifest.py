"""The manifest of a bag: SHA-256 of every file and piece, so that damage is located to the chunk.

The recorder hashes data as it writes them. A manifest can also be made afterwards for a bag
without one and is then marked so: earlier changes to the files are unknown. It also
states how far the system's clock could be trusted.
"""

from __future__ import annotations

import ctypes
import hashlib
import mmap
import os
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Literal

from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC as MAGIC
from pydantic import Field

from fsw_control.schema.files import open_regular, read_regular
from fsw_control.schema.models import Many, Model, json_content_of, validate
from fsw_recorder.errors import BagError
from fsw_recorder.mcap_frames import CHUNK_HEAD, Buffer, frames

MANIFEST_NAME = "manifest.json"
#: length of the pieces of a file without chunks
PIECE_BYTES = 1024 * 1024
PieceKind = Literal["chunk", "attachment", "other"]
When = Literal["while_recording", "afterwards"]
_KINDS: dict[int, PieceKind] = {Opcode.CHUNK: "chunk", Opcode.ATTACHMENT: "attachment"}

#: `struct timex` of Linux (64 bit) up to the status: modes, offset, frequency, largest and
#: estimated error, status
_TIMEX = struct.Struct("@IqqqqI")
_TIMEX_BYTES = 512
#: status bits, `<sys/timex.h>`
_UNSYNCHRONIZED, _IN_NANOSECONDS = 0x0040, 0x2000


class ClockState(Model):
    """State of the system's clock as reported by the kernel."""

    source: Literal["chrony", "ptp", "kernel", "unknown"]
    """kernel: adjtimex, to which chrony, ntpd and phc2sys report; others: older recorders"""
    synchronized: bool | None = None
    """none: unknown"""
    offset_s: float | None = None
    """estimated size of the offset from the source"""
    error_s: float | None = None
    """bound of the error, given by the source"""
    words: str
    """text for people"""


UNKNOWN = ClockState(source="unknown", words="the kernel does not report on its clock")


def clock_state() -> ClockState:
    """Ask the kernel."""
    timex = _adjtimex()
    if timex is None:
        return UNKNOWN
    _, offset, _, largest, estimated, status = _TIMEX.unpack_from(timex)
    if status & _UNSYNCHRONIZED:
        return ClockState(
            source="kernel", synchronized=False, words="the kernel's clock is not synchronized"
        )
    return ClockState(
        source="kernel",
        synchronized=True,
        offset_s=abs(offset) * (1e-9 if status & _IN_NANOSECONDS else 1e-6),
        error_s=largest * 1e-6,
        words=f"the kernel's clock is synchronized, error estimated as {estimated} µs",
    )


def _adjtimex() -> bytes | None:
    buffer = ctypes.create_string_buffer(_TIMEX_BYTES)
    with suppress(OSError, AttributeError):
        if ctypes.CDLL(None).adjtimex(buffer) >= 0:  # modes 0: only reads
            return buffer.raw
    return None


class Piece(Model):
    """A section of a file; it begins at the end of the previous one, the first at 0."""

    kind: PieceKind
    """chunk: including its message indexes; other: head, index, metadata, unchunked messages"""
    end: int
    """offset of its end"""
    sha256: str
    begin_ns: int | None = None
    """log time of the first message of a chunk"""
    end_ns: int | None = None
    """log time of its last message"""


class FileManifest(Model):
    """A file of the bag."""

    name: Annotated[str, Field(pattern=r"^[^/\\]*[^/\\.][^/\\]*$")]
    """of a file in the bag's folder, without a path"""
    bytes: int
    sha256: str
    hashed: When
    """afterwards: what happened to the file before is unknown"""
    pieces: Many[Piece]


class Manifest(Model):
    """Content of manifest.json."""

    format: Literal["fsw_bag_manifest"] = "fsw_bag_manifest"
    version: Literal[1] = 1
    bag: str
    """name of the folder"""
    custom_data: dict[str, str]
    """of metadata.yaml: canister, lid, tool, machine and others"""
    attachments_sha256: dict[str, str]
    """attached files: scenario, software versions, parameters of every node"""
    clock: ClockState
    """state of the system's clock at the end of the recording"""
    files: Many[FileManifest]

    def text(self) -> str:
        """Text of the file."""
        return self.model_dump_json(indent=1, exclude_none=True) + "\n"


def record_pieces(data: Buffer, at: int = 0, offset: int = 0) -> Iterator[Piece]:
    """Pieces of an MCAP file, or of complete records of one; damaged places are ``other``.

    The first record begins ``at``, and the data begin at ``offset`` in their file.
    """
    size = len(data)
    kind: PieceKind = "other"
    times: tuple[int | None, int | None] = (None, None)
    begin, end = 0, at

    def piece(stop: int) -> Piece:
        digest = sha256(data[begin:stop])
        return Piece(
            kind=kind, end=stop + offset, sha256=digest, begin_ns=times[0], end_ns=times[1]
        )

    for opcode, body, stop in frames(data, at, size):
        if opcode == Opcode.MESSAGE_INDEX and kind == "chunk":
            end = min(stop, size)
            continue
        new = _KINDS.get(opcode, "other")
        if end > begin and (new != "other" or kind != "other" or end - begin >= PIECE_BYTES):
            yield piece(end)
            begin, times = end, (None, None)
        kind, end = new, min(stop, size)
        if new == "chunk" and body + CHUNK_HEAD.size <= size:
            times = CHUNK_HEAD.unpack_from(data, body)[:2]
    if kind != "other" and end > begin:
        yield piece(end)
        begin = end
    if size > begin:
        kind, times = "other", (None, None)
        yield piece(size)


class FileHasher:
    """Hashes an MCAP file while it is written, by complete records."""

    def __init__(self) -> None:
        self.pieces: list[Piece] = []
        self.size = 0
        self._whole = hashlib.sha256()

    def add(self, data: bytes) -> None:
        """Add written data."""
        self._whole.update(data)
        self.pieces += record_pieces(data, 0 if self.size else len(MAGIC), self.size)
        self.size += len(data)

    def manifest(self, name: str) -> FileManifest:
        """Entry of the data written so far."""
        return FileManifest(
            name=name,
            bytes=self.size,
            sha256=self._whole.hexdigest(),
            hashed="while_recording",
            pieces=tuple(self.pieces),
        )


def sha256(data: Buffer) -> str:
    """SHA-256 of bytes in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def file_pieces(data: Buffer) -> Iterator[Piece]:
    """Pieces of any file in its present state."""
    if data[: len(MAGIC)] == MAGIC:
        yield from record_pieces(data, len(MAGIC))
        return
    for offset in range(0, len(data), PIECE_BYTES):
        piece = data[offset : offset + PIECE_BYTES]
        yield Piece(kind="other", end=offset + len(piece), sha256=sha256(piece))


def mapped(path: Path) -> Buffer:
    """Map a file's content into memory."""
    with open_regular(path) as stream:
        if os.fstat(stream.fileno()).st_size == 0:
            return b""
        return mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)


def hashed(name: str, data: Buffer, when: When) -> FileManifest:
    """Entry of a complete file."""
    return FileManifest(
        name=name,
        bytes=len(data),
        sha256=sha256(data),
        hashed=when,
        pieces=tuple(file_pieces(data)),
    )


def read_manifest(folder: Path) -> Manifest | None:
    """Read the manifest of a bag; None if it has none.

    Raises
    ------
    BagError
        If it cannot be read, or is not a manifest.
    """
    path = folder / MANIFEST_NAME
    try:
        text = read_regular(path).decode()
        return validate(Manifest, json_content_of(text, str(path)), str(path))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise BagError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise BagError(str(error)) from None
