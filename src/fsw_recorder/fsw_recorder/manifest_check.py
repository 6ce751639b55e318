"""Compares the files of a bag with its manifest and locates differences to the chunk."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

from fsw_recorder.bag_metadata import METADATA_NAME
from fsw_recorder.bag_reader import SUFFIXES
from fsw_recorder.errors import BagError
from fsw_recorder.findings import Code, Finding, Place, finding, summary
from fsw_recorder.manifest import (
    MANIFEST_NAME,
    FileManifest,
    Manifest,
    Piece,
    file_pieces,
    mapped,
    read_manifest,
    sha256,
)
from fsw_recorder.mcap_frames import Buffer


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
    unchanged = _unchanged(data, listed)
    lost = [row for row in pieces if row not in unchanged]
    if not lost:
        return [Finding(code=Code.REORDERED, file=listed.name, data=sizes)]
    chunks = {row for row in pieces if listed.pieces[row].kind == "chunk"}
    if chunks and not chunks & unchanged:
        return [Finding(code=Code.OTHER_FILE, file=listed.name, data=sizes, pieces=tuple(lost))]
    runs = [
        [row for _, row in run]
        for _, run in groupby(enumerate(lost), lambda entry: entry[1] - entry[0])
    ]
    return [
        Finding(
            code=Code.CHANGED,
            file=listed.name,
            data=sizes,
            pieces=tuple(rows),
            place=place_of(listed.pieces, rows) if len(pieces) > 1 else None,
        )
        for rows in runs
    ]


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
    begins = [
        piece.begin_ns for piece in (pieces[row] for row in rows) if piece.begin_ns is not None
    ]
    ends = [piece.end_ns for piece in (pieces[row] for row in rows) if piece.end_ns is not None]
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
