"""Compares the files of a bag with its manifest: what is not as recorded, to the chunk."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby, pairwise
from pathlib import Path
from typing import NamedTuple

from fsw_recorder.bag_metadata import METADATA_NAME
from fsw_recorder.bag_reader import SUFFIXES
from fsw_recorder.manifest import FileManifest, Manifest, Piece, file_pieces, hashed, mapped, sha256
from fsw_recorder.mcap_frames import Buffer


class Finding(NamedTuple):
    """Something that is not as it was recorded; ``pieces`` are indices into those of the file's manifest."""

    file: str
    text: str
    pieces: tuple[int, ...] = ()

    @property
    def line(self) -> str:
        """In one line."""
        return f"{self.file}: {self.text}"


def check_files(folder: Path, manifest: Manifest) -> list[Finding]:
    """All that differs between the files of a bag and its manifest; other files, e.g. a weld's record, do not count.

    Raises
    ------
    OSError
        A file cannot be read.
    """
    found = [finding for listed in manifest.files for finding in check_file(folder / listed.name, listed)]
    return found + [Finding(path.name, "is not in the manifest") for path in unlisted(folder, manifest)]


def unlisted(folder: Path, manifest: Manifest) -> list[Path]:
    """Files that a reader of the bag would take although the manifest does not have them."""
    names = {listed.name for listed in manifest.files}
    return sorted(
        path
        for path in folder.iterdir()
        if (path.name.endswith(SUFFIXES) or path.name == METADATA_NAME) and path.name not in names
    )


def complete(folder: Path, manifest: Manifest) -> tuple[Manifest, list[str]]:
    """The manifest with the files that it lacks, hashed as they are now, and what there is to say about them."""
    more = [hashed(path.name, mapped(path), "afterwards") for path in unlisted(folder, manifest)]
    notes = [f"{one.name}: hashed afterwards; what had happened to it before is not known" for one in more]
    return manifest.changed(files=(*manifest.files, *more)) if more else manifest, notes


def check_file(path: Path, listed: FileManifest) -> list[Finding]:
    """What differs between a file and its manifest; consecutive pieces that are lost are one finding."""
    try:
        data = mapped(path)
    except FileNotFoundError:
        return [Finding(listed.name, "is missing", tuple(range(len(listed.pieces))))]
    if len(data) == listed.bytes and sha256(data) == listed.sha256:
        return []
    proven = proven_pieces(data, listed)
    lost = [row for row in range(len(listed.pieces)) if row not in proven]
    if not lost:
        return [Finding(listed.name, f"every piece is there, but not alone or in another order{_sizes(data, listed)}")]
    if not any(listed.pieces[row].kind == "chunk" for row in proven) and any(
        piece.kind == "chunk" for piece in listed.pieces
    ):
        text = f"is another file: none of its chunks is one that was recorded{_sizes(data, listed)}"
        return [Finding(listed.name, text, tuple(lost))]
    if len(listed.pieces) == 1:
        return [Finding(listed.name, f"is not what was recorded{_sizes(data, listed)}", (0,))]
    found = []
    for _, group in groupby(enumerate(lost), lambda one: one[1] - one[0]):
        rows = [row for _, row in group]
        text = f"{name_of(listed.pieces, rows)} not what was recorded{_sizes(data, listed)}"
        found.append(Finding(listed.name, text, tuple(rows)))
    return found


def proven_pieces(data: Buffer, listed: FileManifest) -> dict[int, tuple[int, int]]:
    """Pieces of the manifest that are in a file as they were recorded, with begin and end there, by index."""
    found: dict[int, tuple[int, int]] = {}
    begin = 0
    for row, piece in enumerate(listed.pieces):
        if piece.end <= len(data) and sha256(data[begin : piece.end]) == piece.sha256:
            found[row] = (begin, piece.end)
        begin = piece.end
    if len(found) < len(listed.pieces):  # what is behind something that was removed or put in is somewhere else
        ends = {0: ""} | {piece.end: piece.sha256 for piece in file_pieces(data)}
        moved = {ends[end]: (begin, end) for begin, end in pairwise(ends)}
        for row, piece in enumerate(listed.pieces):
            if row not in found and piece.sha256 in moved:
                found[row] = moved[piece.sha256]
    return found


def name_of(pieces: Sequence[Piece], rows: Sequence[int]) -> str:
    """Consecutive pieces in words, e.g. ``chunk 17 (bytes 1200 to 4800, 6.8 to 7.2 s after the file's begin) is``."""
    begin = pieces[rows[0] - 1].end if rows[0] else 0
    parts = list(_kinds(pieces, rows))
    start = next((piece.begin_ns for piece in pieces if piece.begin_ns is not None), None)
    begins = [piece.begin_ns for piece in (pieces[row] for row in rows) if piece.begin_ns is not None]
    ends = [piece.end_ns for piece in (pieces[row] for row in rows) if piece.end_ns is not None]
    when = ""
    if start is not None and begins and ends:
        when = f", {(min(begins) - start) * 1e-9:.1f} to {(max(ends) - start) * 1e-9:.1f} s after the first message"
    many = len(rows) > 1 or len(parts) > 1
    return f"{' and '.join(parts)} (bytes {begin} to {pieces[rows[-1]].end}{when}) {'are' if many else 'is'}"


def _kinds(pieces: Sequence[Piece], rows: Sequence[int]) -> Iterator[str]:
    for kind in ("chunk", "attachment", "other"):
        numbers = [sum(one.kind == kind for one in pieces[: row + 1]) for row in rows if pieces[row].kind == kind]
        if not numbers:
            continue
        if kind == "other":
            first, last = rows[0] == 0, rows[-1] == len(pieces) - 1
            yield (
                "the head" if first and not last else "the index at the end" if last and not first else "other records"
            )
        elif len(numbers) == 1:
            yield f"{kind} {numbers[0]}"
        else:
            yield f"{kind}s {numbers[0]} to {numbers[-1]}"


def _sizes(data: Buffer, listed: FileManifest) -> str:
    return "" if len(data) == listed.bytes else f"; the file has {len(data)} bytes in place of {listed.bytes}"
