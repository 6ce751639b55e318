"""Makes an intact bag from another: of all that is readable, or of what is proven unchanged."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.records import Header
from mcap.writer import MCAP0_MAGIC as MAGIC

from fsw_recorder.bag_file import end_without_index
from fsw_recorder.bag_metadata import METADATA_NAME, FileSummary, metadata_text
from fsw_recorder.bag_reader import FOREVER_NS, BagReader, BagRecord
from fsw_recorder.bag_writer import BagWriter, WriterOptions
from fsw_recorder.errors import BagError
from fsw_recorder.manifest import MANIFEST_NAME, FileManifest, mapped, read_manifest
from fsw_recorder.manifest_check import check_file, proven_pieces
from fsw_recorder.mcap_file import McapFile
from fsw_recorder.signature import SUFFIX
from fsw_recorder.topic import TopicSelection

#: data passed to the writer between waits for the disk, plus this much for every message
_BATCH_BYTES, _MESSAGE_BYTES = 16 * 1024 * 1024, 1000
#: time limit for writing them
_PATIENCE_S = 600.0


@dataclass(frozen=True, slots=True)
class Recovery:
    """Result: numbers of copied messages and topics, and problems of the bag."""

    messages: int
    topics: int
    problems: list[str]


def recover(
    source: Path | str,
    target: Path,
    options: WriterOptions | None = None,
    progress: Callable[[float], None] | None = None,
    selection: TopicSelection | None = None,
    keep_attachment: Callable[[str], bool] = lambda _: True,
    stop_ns: int = FOREVER_NS,
) -> Recovery:
    """Copy all readable messages and attachments of a bag into a new bag.

    Topics, types, definitions, QoS, times, sequence numbers and bytes are kept; this also converts
    any readable bag (split, compressed, sqlite3) into an MCAP bag. The new folder must not exist.
    ``selection``, ``keep_attachment`` and ``stop_ns`` restrict it to topics, to attachments by
    name, and to messages received before a time. ``progress`` is called now and then with the
    fraction done, 0 to 1.

    Raises
    ------
    BagError
        If nothing can be read, or the new bag cannot be written.
    """
    with BagReader(source) as reader:
        topics = {
            name: topic
            for name, topic in reader.topics().items()
            if selection is None or selection.takes(name)
        }
        custom = {**reader.metadata.custom_data, "recovered_from": str(source)}
        with BagWriter(target, options, custom) as writer:
            for topic in topics.values():
                writer.add_topic(topic)
            for attachment in reader.attachments():
                if keep_attachment(attachment.name):
                    writer.attach(attachment.name, attachment.media_type, attachment.data)
            return copy(
                reader.records(topics, stop_ns=stop_ns, progress=progress), writer, reader.problems
            )


def copy(
    records: Iterable[BagRecord], writer: BagWriter, problems: Sequence[str] = ()
) -> Recovery:
    """Write records to a bag at the speed of the disk and close it; a `BagError` if incomplete."""
    topics: set[str] = set()
    waiting = 0
    for record in records:
        topics.add(record.topic)
        waiting += len(record.data) + _MESSAGE_BYTES
        if waiting > _BATCH_BYTES:
            waiting = 0
            writer.flush(_PATIENCE_S)
        if not writer.write(
            record.topic, record.data, record.log_time_ns, record.publish_time_ns, record.sequence
        ):
            break
    writer.close()
    if writer.error is not None:
        raise writer.error
    written = writer.statistics()
    if written["dropped"]:
        raise BagError(
            f"{writer.folder}: incomplete: the disk did not accept a message of {record.topic}"
        )
    return Recovery(written["written"], len(topics), list(problems))


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
