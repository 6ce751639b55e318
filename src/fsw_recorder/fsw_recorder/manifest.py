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
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC as MAGIC
from pydantic import Field

from fsw_control.schema.files import open_regular, read_regular
from fsw_control.schema.models import Many, Model, json_content_of, validate
from fsw_recorder.bag_metadata import METADATA_NAME
from fsw_recorder.bag_reader import SUFFIXES
from fsw_recorder.errors import BagError
from fsw_recorder.findings import Code, Finding, Place, finding, summary
from fsw_recorder.mcap_file import CHUNK_HEAD, Buffer, frames

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


def check_files(folder: Path, manifest: Manifest) -> list[Finding]:
    """Differences between a bag and its manifest; other files, e.g. the record, do not count."""
    problems = [
        entry for listed in manifest.files for entry in check_file(folder / listed.name, listed)
    ]
    return problems + [finding(Code.UNLISTED, path.name) for path in unlisted(folder, manifest)]


def not_as_recorded(bag: Path) -> str:
    """How a bag differs from its manifest, in words; empty if it does not, or has none."""
    try:
        manifest = read_manifest(bag) if bag.is_dir() else None
    except BagError as error:
        return str(error)
    problems = check_files(bag, manifest) if manifest else []
    return f"not as {MANIFEST_NAME} has it: {summary(problems)}" if problems else ""


def is_read(name: str) -> bool:
    """Whether a reader uses this file of a bag: metadata, messages, the log of an sqlite file."""
    return name == METADATA_NAME or name.removesuffix("-wal").endswith(SUFFIXES)


def unlisted(folder: Path, manifest: Manifest) -> list[Path]:
    """Files that a reader would use but that are not in the manifest."""
    names = {listed.name for listed in manifest.files}
    return sorted(
        path for path in folder.iterdir() if is_read(path.name) and path.name not in names
    )


def check_file(path: Path, listed: FileManifest) -> list[Finding]:
    """Differences between a file and its manifest; consecutive lost pieces are one finding."""
    pieces = tuple(range(len(listed.pieces)))
    try:
        data = mapped(path)
    except FileNotFoundError:
        return [Finding(code=Code.MISSING, file=listed.name, pieces=pieces)]
    except OSError as error:
        return [finding(Code.UNREADABLE, listed.name, reason=error.strerror)]
    if len(data) == listed.bytes and sha256(data) == listed.sha256:
        return []
    sizes = {} if len(data) == listed.bytes else {"bytes": len(data), "listed_bytes": listed.bytes}

    def finding_of(code: Code, rows: Sequence[int] = (), place: Place | None = None) -> Finding:
        return Finding(code=code, file=listed.name, data=sizes, pieces=tuple(rows), place=place)

    unchanged = _unchanged(data, listed)
    lost = [row for row in pieces if row not in unchanged]
    if not lost:
        return [finding_of(Code.REORDERED)]
    chunks = {row for row in pieces if listed.pieces[row].kind == "chunk"}
    if chunks and not chunks & unchanged:
        return [finding_of(Code.OTHER_FILE, lost)]
    runs = [run.tolist() for run in np.split(lost, np.flatnonzero(np.diff(lost) > 1) + 1)]
    places = [place_of(listed.pieces, rows) if len(pieces) > 1 else None for rows in runs]
    return [finding_of(Code.CHANGED, *entry) for entry in zip(runs, places, strict=True)]


def _unchanged(data: Buffer, listed: FileManifest) -> set[int]:
    """Rows of the manifest's pieces that are in a file, at their place or moved."""
    begins = [0, *(piece.end for piece in listed.pieces)]
    rows = {
        row
        for row, (begin, piece) in enumerate(zip(begins, listed.pieces, strict=False))
        if piece.end <= len(data) and sha256(data[begin : piece.end]) == piece.sha256
    }
    if len(rows) < len(listed.pieces):  # data behind a removed or inserted part has moved
        present = {piece.sha256 for piece in file_pieces(data)}
        rows |= {row for row, piece in enumerate(listed.pieces) if piece.sha256 in present}
    return rows


def place_of(pieces: Sequence[Piece], rows: Sequence[int]) -> Place:
    """Location of consecutive pieces."""
    start_ns = next((piece.begin_ns for piece in pieces if piece.begin_ns is not None), 0)
    lost = [pieces[row] for row in rows]
    begins = [piece.begin_ns for piece in lost if piece.begin_ns is not None]
    ends = [piece.end_ns for piece in lost if piece.end_ns is not None]
    return Place(
        parts=tuple(_kinds(pieces, rows)),
        begin=pieces[rows[0] - 1].end if rows[0] else 0,
        end=pieces[rows[-1]].end,
        begin_s=(min(begins) - start_ns) * 1e-9 if begins and ends else None,
        end_s=(max(ends) - start_ns) * 1e-9 if begins and ends else None,
    )


def _kinds(pieces: Sequence[Piece], rows: Sequence[int]) -> Iterator[str]:
    for kind in ("chunk", "attachment"):
        numbers = [
            sum(piece.kind == kind for piece in pieces[: row + 1])
            for row in rows
            if pieces[row].kind == kind
        ]
        if numbers:
            yield (
                f"{kind} {numbers[0]}"
                if len(numbers) == 1
                else f"{kind}s {numbers[0]} to {numbers[-1]}"
            )
    if any(pieces[row].kind == "other" for row in rows):
        yield "other records"
