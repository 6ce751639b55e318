"""Makes a bag of the chunks of a damaged one that are unchanged since their recording."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.records import Header
from mcap.writer import MCAP0_MAGIC as MAGIC

from fsw_recorder.bag_file import end_without_index
from fsw_recorder.bag_metadata import METADATA_NAME, FileSummary, metadata_text
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.errors import BagError
from fsw_recorder.manifest import MANIFEST_NAME, FileManifest, mapped, read_manifest
from fsw_recorder.manifest_check import check_file, proven_pieces
from fsw_recorder.mcap_file import McapFile
from fsw_recorder.signature import SUFFIX


@dataclass(frozen=True, slots=True)
class ProvenRecovery:
    """Result: numbers of proven and recorded chunks and attachments, and the losses."""

    proven: int
    recorded: int
    messages: int
    lost: list[str]


def recover_proven(
    source: Path,
    target: Path,
    evidence: tuple[str, ...] = (),
    progress: Callable[[float], None] | None = None,
) -> ProvenRecovery:
    """Copy the chunks and attachments whose hashes are in the manifest, unchanged, into a new bag.

    The manifest is copied as well and still proves them; readers find them without an index. The
    ``target`` must not exist. ``evidence`` are further files to copy if present, e.g. signatures.
    ``progress`` is called with the fraction done, 0 to 1.

    Raises
    ------
    BagError
        If there is no manifest, nothing is proven, or the new bag cannot be written.
    """
    manifest = read_manifest(source) if source.is_dir() else None
    if manifest is None:
        raise BagError(
            f"{source}: nothing can be proven without {MANIFEST_NAME}; recover without --proven"
        )
    files = [file for file in manifest.files if file.name.endswith(".mcap")]
    contents, proven, lost = {}, 0, []
    for number, listed in enumerate(files, 1):
        lost += [entry.line for entry in check_file(source / listed.name, listed)]
        if (source / listed.name).exists():
            contents[listed.name], count = _proven_file(source / listed.name, listed)
            proven += count
        if progress is not None:
            progress(number / len(files))
    if not proven:
        raise BagError(
            f"{source}: nothing is proven: {lost[0] if lost else 'no chunk is in its manifest'}"
        )
    try:
        target.mkdir(parents=True)
    except FileExistsError:
        raise BagError(
            f"{target}: exists already; nothing was recovered. Choose another folder"
        ) from None
    for name, data in contents.items():
        (target / name).write_bytes(data)
    for name in (MANIFEST_NAME, MANIFEST_NAME + SUFFIX, *evidence):
        if (source / name).exists():
            shutil.copyfile(source / name, target / name)
    recorded = sum(piece.kind != "other" for file in files for piece in file.pieces)
    return ProvenRecovery(
        proven, recorded, _write_metadata(target, manifest.custom_data, str(source)), lost
    )


def _proven_file(path: Path, listed: FileManifest) -> tuple[bytes, int]:
    data = mapped(path)
    proven = proven_pieces(data, listed)
    rows = [row for row in sorted(proven) if listed.pieces[row].kind != "other"]
    builder = RecordBuilder()
    Header(profile="ros2", library="fsw_recorder").write(builder)
    definitions = b""
    if data[: len(MAGIC)] == MAGIC:
        file = McapFile(path, lambda _: None)
        definitions = file.definitions()
        file.close()
    parts = (bytes(data[slice(*proven[row])]) for row in rows)
    return b"".join([MAGIC, builder.end(), definitions, *parts, end_without_index()]), len(rows)


def _write_metadata(folder: Path, custom_data: dict[str, str], source: str) -> int:
    with BagReader(folder) as reader:
        summaries = {path.name: FileSummary(path.name) for path in sorted(folder.glob("*.mcap"))}
        topics = list(reader.topics().values())
    messages = 0
    for name, summary in summaries.items():
        with BagReader(folder / name) as reader:
            for record in reader.records():
                summary.note(record.topic, record.log_time_ns)
        messages += summary.counts.total()
    text = metadata_text(
        list(summaries.values()), topics, {**custom_data, "recovered_from": source}
    )
    (folder / METADATA_NAME).write_text(text, encoding="utf-8")
    return messages
