"""Opens bags of any kind and state: rosbag2 folders, single files, cut off or damaged recordings."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import zstandard
from mcap.records import Attachment
from rosbags.rosbag2 import Reader

from fsw_recorder.bag_metadata import BagMetadata, read_metadata
from fsw_recorder.definitions import Definitions
from fsw_recorder.errors import BagError
from fsw_recorder.interface_text import interface_definition
from fsw_recorder.mcap_file import McapFile
from fsw_recorder.qos import read_qos
from fsw_recorder.topic import RecordedTopic

FOREVER_NS = 2**64
SUFFIXES = (".mcap", ".mcap.zstd", ".db3", ".db3.zstd")
_MOST_FILE_BYTES = 16 * 1024**3
_MOST_MESSAGE_BYTES = 256 * 1024 * 1024
_WINDOW_BYTES = 2**27
_BLOCK_BYTES = 2**20
#: sqlite3 holds signed numbers
_MOST_SQLITE = 2**63 - 1
#: progress is told every so many messages
_PROGRESS_STEP = 8192


class BagRecord(NamedTuple):
    """One recorded message.

    Attributes
    ----------
    topic, type_name : str
        E.g. ``/fsw/depth`` and ``fsw_msgs/msg/ShoulderDepth``.
    log_time_ns, publish_time_ns : int
        When it was received and when it was published (the former twice where the storage has only one).
    data : bytes
        Serialized message (CDR with its 4-byte header).
    sequence : int
        Of the publisher, where known; else 0.
    """

    topic: str
    type_name: str
    log_time_ns: int
    publish_time_ns: int
    data: bytes
    sequence: int


@dataclass(slots=True)
class BagInfo:
    """Summary of a bag, counted from its messages, not believed from its metadata.

    Attributes
    ----------
    topics : list of RecordedTopic
        By name.
    counts : dict of str to int
        Messages by topic.
    start_ns, end_ns : int
        Log times of the first and the last message; 0 without messages.
    """

    path: Path
    storage: str
    files: list[str]
    size_bytes: int
    start_ns: int
    end_ns: int
    topics: list[RecordedTopic]
    counts: dict[str, int]
    attachments: list[Attachment]
    custom_data: dict[str, str] = field(default_factory=dict)
    ros_distro: str = ""
    problems: list[str] = field(default_factory=list)

    @property
    def message_count(self) -> int:
        """Number of messages."""
        return sum(self.counts.values())

    @property
    def duration_s(self) -> float:
        """From the first message to the last [s]."""
        return (self.end_ns - self.start_ns) * 1e-9


class BagReader:
    """Reads one bag; use as a context manager.

    Parameters
    ----------
    path : Path or str
        A rosbag2 folder (with or without ``metadata.yaml``) or one storage file: ``.mcap``, ``.mcap.zstd``, ``.db3``,
        ``.db3.zstd``.

    Attributes
    ----------
    problems : list of str
        What is wrong with the bag, as far as it was read: a recording that was never finished (kill -9, power failure,
        full disk) is read up to its end, damaged places are passed over.

    Raises
    ------
    BagError
        There is no bag at ``path``, or nothing of it can be read.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.problems: list[str] = []
        self.metadata = BagMetadata()
        self._definitions = Definitions()
        self._definition_of: dict[str, str] = {}
        self._stack = ExitStack()
        self._parts: list[_McapPart | _SqlitePart] = []
        self._info: BagInfo | None = None
        try:
            self.files = self._find_files()
            failures: list[str] = []
            for file in self.files:
                try:
                    self._parts.append(self._open_file(file))
                except (BagError, OSError) as error:
                    text = str(error) if isinstance(error, BagError) else f"{file}: cannot be read: {error.strerror}"
                    failures.append(text)
            if not self._parts:
                raise BagError("; ".join(failures))
            self.problems += failures
        except BaseException:
            self.close()
            raise

    def _find_files(self) -> list[Path]:
        try:
            is_folder, is_file = self.path.is_dir(), self.path.is_file()
            if is_file and self.path.name.endswith(SUFFIXES):
                return [self.path]
            if is_file:
                raise BagError(f"{self.path}: not a bag, which is a folder or a file ending in {', '.join(SUFFIXES)}")
            if not is_folder:
                raise BagError(f"{self.path}: there is no such bag")
            present = {file.name: file for file in self.path.iterdir() if file.name.endswith(SUFFIXES)}
        except (OSError, ValueError) as error:
            raise BagError(f"{self.path}: cannot be read: {error}") from None
        listed: list[str] = []
        try:
            metadata = read_metadata(self.path)
            if metadata is not None:
                self.metadata, listed = metadata, metadata.files
                self.problems += [f"{self.path}: {name} is missing" for name in listed if name not in present]
            elif present:
                self.problems.append(f"{self.path}: metadata.yaml is missing; the files of the folder are read instead")
        except BagError as error:
            if not present:
                raise
            self.problems.append(f"{error}; the files of the folder are read instead")
        for name in [name for name in present if name.endswith(".zstd") and name.removesuffix(".zstd") in present]:
            if name not in listed:
                del present[name]  # compressing was stopped half-way; the file it started from is still there
        order = [name for name in listed if name in present]
        order += sorted((name for name in present if name not in listed), key=_natural)
        if not order:
            raise BagError(f"{self.path}: no bag in this folder (no file that ends in {', '.join(SUFFIXES)})")
        return [present[name] for name in order]

    def _open_file(self, file: Path) -> _McapPart | _SqlitePart:
        source = self._decompressed(file) if file.name.endswith(".zstd") else file
        kind = _SqlitePart if file.name.removesuffix(".zstd").endswith(".db3") else _McapPart
        part = kind(source, str(file))
        self._stack.callback(part.close)
        return part

    def _decompressed(self, file: Path) -> Path:
        """A temporary copy of a compressed file; of a damaged one what comes before the damage."""
        target = self._stack.enter_context(tempfile.NamedTemporaryFile(prefix="fsw_bag_", suffix=".db3"))  # noqa: SIM115
        decompressor = zstandard.ZstdDecompressor(max_window_size=_WINDOW_BYTES)
        written = 0
        try:
            with file.open("rb") as stream, decompressor.stream_reader(stream) as source:
                while block := source.read(_BLOCK_BYTES):
                    written += len(block)
                    if written > _MOST_FILE_BYTES:
                        raise BagError(f"{file}: larger than {_MOST_FILE_BYTES} bytes uncompressed, not read")
                    target.write(block)
        except zstandard.ZstdError as error:
            if not written:
                raise BagError(f"{file}: not a zstd file, or damaged: {error}") from None
            self.problems.append(f"{file}: zstd stream damaged after {written} bytes: {error}")
        target.flush()
        return Path(target.name)

    # ------------------------------------------------------------------ reading

    def records(
        self,
        topics: Collection[str] | None = None,
        start_ns: int = 0,
        stop_ns: int = FOREVER_NS,
        progress: Callable[[float], None] | None = None,
    ) -> Iterator[BagRecord]:
        """Messages in order of log time (within each file of a split bag).

        Parameters
        ----------
        topics : collection of str, optional
            Only these.
        start_ns, stop_ns : int
            Only messages with ``start_ns`` <= log time < ``stop_ns``.
        progress : callable, optional
            Called now and then with the fraction read, 0 to 1.
        """
        per_message = self.metadata.compression_mode == "message"
        for position, part in enumerate(self._parts):
            for count, record in enumerate(part.records(topics, start_ns, stop_ns)):
                yield _decompressed_record(record) if per_message else record
                if progress is not None and count % _PROGRESS_STEP == 0:
                    progress((position + part.fraction) / len(self._parts))
            self.problems += [problem for problem in part.problems if problem not in self.problems]
        if progress is not None:
            progress(1.0)

    def info(
        self, progress: Callable[[float], None] | None = None, note: Callable[[BagRecord], object] | None = None
    ) -> BagInfo:
        """Summary of the bag; reads it once.

        Parameters
        ----------
        progress : callable, optional
            Called now and then with the fraction read, 0 to 1.
        note : callable, optional
            Called with every message.
        """
        counts: dict[str, int] = {}
        start, end = FOREVER_NS, 0
        for record in self.records(progress=progress):
            counts[record.topic] = counts.get(record.topic, 0) + 1
            start, end = min(start, record.log_time_ns), max(end, record.log_time_ns)
            if note is not None:
                note(record)
        self._info = BagInfo(
            path=self.path,
            storage=self._parts[0].storage,
            files=[file.name for file in self.files],
            size_bytes=sum(file.stat().st_size for file in self.files),
            start_ns=start if counts else 0,
            end_ns=end,
            topics=sorted(self.known_topics(), key=lambda topic: topic.name),
            counts=counts,
            attachments=self.attachments(),
            custom_data=dict(self.metadata.custom_data),
            ros_distro=self.metadata.ros_distro,
            problems=list(self.problems),
        )
        return self._info

    def topics(self) -> dict[str, RecordedTopic]:
        """Topics of the bag (reads it once, because a damaged file tells them only on the way)."""
        info = self._info or self.info()
        return {topic.name: topic for topic in info.topics}

    def counts(self) -> dict[str, int]:
        """Messages by topic (reads the bag once)."""
        return (self._info or self.info()).counts

    def known_topics(self) -> list[RecordedTopic]:
        """Topics met so far; all of them once the bag was read."""
        topics: dict[str, RecordedTopic] = {}
        for part in self._parts:
            for topic in part.topics():
                topics.setdefault(topic.name, topic)
        return list(topics.values())

    def attachments(self) -> list[Attachment]:
        """Files inside the bag; of several with one name the first."""
        found: dict[str, Attachment] = {}
        for part in self._parts:
            for attachment in part.attachments:
                found.setdefault(attachment.name, attachment)
        return list(found.values())

    def decode(self, record: BagRecord) -> Any:
        """Message of a record, with its fields as attributes.

        Raises
        ------
        BagError
            The data is damaged, or no definition of its type can be found.
        """
        if record.topic not in self._definition_of:
            self._definition_of |= {
                one.name: one.definition for one in self.known_topics() if one.definition_encoding == "ros2msg"
            }
        definition = self._definition_of.get(record.topic) or interface_definition(record.type_name)
        if not definition:
            raise BagError(f"{record.topic}: {record.type_name} is neither defined in the bag nor installed")
        return self._definitions.decode(record.type_name, definition, record.data)

    def close(self) -> None:
        """Close the files; reading is no longer possible."""
        self._parts.clear()
        self._stack.close()

    def __enter__(self) -> BagReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class _McapPart:
    """One MCAP file of a bag."""

    storage = "mcap"

    def __init__(self, path: Path, name: str) -> None:
        self._file = McapFile(path, name)
        self.problems, self.attachments = self._file.problems, self._file.attachments
        self.close = self._file.close

    @property
    def fraction(self) -> float:
        return self._file.fraction

    def records(self, topics: Collection[str] | None, start_ns: int, stop_ns: int) -> Iterator[BagRecord]:
        file = self._file
        wanted: dict[int, tuple[str, str] | None] = {}
        for log_time, channel_id, sequence, publish_time, data in file.messages(start_ns, stop_ns):
            if channel_id not in wanted:
                channel = file.channels.get(channel_id)
                if channel is None:
                    file.complain(f"messages of channel {channel_id}, which is not defined, are left out")
                    continue
                schema = file.schemas.get(channel.schema_id)
                keep = topics is None or channel.topic in topics
                wanted[channel_id] = (channel.topic, schema.name if schema else "") if keep else None
            target = wanted[channel_id]
            if target is not None:
                yield BagRecord(*target, log_time, publish_time, data, sequence)

    def topics(self) -> list[RecordedTopic]:
        result = []
        for channel in self._file.channels.values():
            schema = self._file.schemas.get(channel.schema_id)
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


class _SqlitePart:
    """One sqlite3 file of a bag, read by ``rosbags``."""

    storage = "sqlite3"

    def __init__(self, path: Path, name: str) -> None:
        self.problems: list[str] = []
        self.attachments: list[Attachment] = []
        self.fraction = 0.0
        self._name = name
        if not path.stat().st_size:
            raise BagError(f"{name}: the file is empty")
        try:
            self._reader: Any = Reader(path)
            self._reader.open()
            self._connections = list(self._reader.connections)
            if not all(isinstance(text, str) for one in self._connections for text in (one.topic, one.msgtype)):
                raise ValueError("its table of topics holds something else")
        except Exception as error:  # rosbags and apsw raise many kinds on damaged files
            raise BagError(f"{name}: not a sqlite3 bag, or damaged: {error}") from None

    def close(self) -> None:
        if self._reader.is_open:
            self._reader.close()

    def _complain(self, problem: str) -> None:
        if f"{self._name}: {problem}" not in self.problems:
            self.problems.append(f"{self._name}: {problem}")

    def records(self, topics: Collection[str] | None, start_ns: int, stop_ns: int) -> Iterator[BagRecord]:
        wanted = [one for one in self._connections if topics is None or one.topic in topics]
        total = max(int(self._reader.message_count), 1)
        count = 0
        source = self._reader.messages(wanted, min(start_ns, _MOST_SQLITE), min(stop_ns, _MOST_SQLITE))
        while wanted:
            try:
                connection, time_ns, data = next(source)
            except StopIteration:
                return
            except Exception as error:  # apsw raises many kinds on damaged pages
                self._complain(f"damaged after {count} messages: {error}")
                return
            count += 1
            self.fraction = min(count / total, 1.0)
            if not isinstance(time_ns, int) or not 0 <= time_ns <= _MOST_SQLITE or not isinstance(data, bytes):
                self._complain("damaged: rows that are no messages are left out")
                continue
            yield BagRecord(connection.topic, connection.msgtype, time_ns, time_ns, data, 0)

    def topics(self) -> list[RecordedTopic]:
        return [
            RecordedTopic(
                one.topic,
                one.msgtype,
                one.msgdef.data or "",
                one.digest,
                tuple(one.ext.offered_qos_profiles),
                one.ext.serialization_format,
                "ros2msg" if one.msgdef.data and one.msgdef.format.name == "MSG" else "",
            )
            for one in self._connections
        ]


def _decompressed_record(record: BagRecord) -> BagRecord:
    try:
        if zstandard.get_frame_parameters(record.data).content_size > _MOST_MESSAGE_BYTES:
            raise BagError(f"{record.topic}: a compressed message is larger than {_MOST_MESSAGE_BYTES} bytes, not read")
        data = zstandard.ZstdDecompressor(max_window_size=_WINDOW_BYTES).decompress(record.data)
    except zstandard.ZstdError as error:
        raise BagError(f"{record.topic}: a compressed message is damaged: {error}") from None
    return record._replace(data=data)


def _natural(name: str) -> list[tuple[int, str]]:
    """Key that sorts ``bag_10`` behind ``bag_9``."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]
