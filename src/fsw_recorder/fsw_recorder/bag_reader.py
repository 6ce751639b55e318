"""Opens bags of any kind and state: rosbag2 directories, single files, cut or damaged recordings."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, NamedTuple

import zstandard

from fsw_recorder.bag_metadata import BagMetadata, OfferedQos, parse_qos, read_metadata
from fsw_recorder.errors import BagError
from fsw_recorder.mcap_scan import Attachment, Channel, McapScan, messages_in_time, scan_mcap
from fsw_recorder.message_decoder import DecodeHook, SchemaDecoder, installed_decoder
from fsw_recorder.sqlite_bag import SqliteBag
from fsw_recorder.tick_gaps import TickCounter, TickGaps

FOREVER_NS = 2**64
MAX_DECOMPRESSED_FILE_BYTES = 16 * 1024**3
MAX_MESSAGE_BYTES = 256 * 1024 * 1024
SUFFIXES = (".mcap", ".mcap.zstd", ".db3", ".db3.zstd")


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
class TopicInfo:
    """What the bag says of one topic."""

    name: str
    type_name: str
    encoding: str = "cdr"
    type_hash: str = ""
    schema_encoding: str = ""
    schema_text: str = ""
    qos: list[OfferedQos] = field(default_factory=list)
    count: int = 0


@dataclass(slots=True)
class BagInfo:
    """Summary of a bag, counted from its messages, not believed from its metadata."""

    path: Path
    storage: str
    files: list[str]
    size_bytes: int
    message_count: int
    start_ns: int
    end_ns: int
    topics: list[TopicInfo]
    attachments: list[Attachment]
    custom_data: dict[str, str]
    ros_distro: str
    problems: list[str]
    #: ticks missing per topic, of the topics of a weld
    tick_gaps: dict[str, TickGaps] = field(default_factory=dict)

    @property
    def duration_s(self) -> float:
        """From the first message to the last [s]."""
        return (self.end_ns - self.start_ns) * 1e-9 if self.message_count else 0.0


class BagReader:
    """Reads one bag; use as a context manager.

    Parameters
    ----------
    path : Path or str
        A rosbag2 directory (with or without ``metadata.yaml``) or one storage file: ``.mcap``, ``.mcap.zstd``,
        ``.db3``, ``.db3.zstd``.
    decode : DecodeHook, optional
        ``(type name, bytes) -> message``; by default the installed message classes, and where those are missing or
        fail, the definition inside the bag.

    Raises
    ------
    BagError
        There is no bag at ``path``, or nothing of it can be read.

    Notes
    -----
    A recording that was never finished (kill -9, power failure, full disk) is read up to its end, a damaged chunk is
    skipped; `problems` says so.
    """

    def __init__(self, path: Path | str, decode: DecodeHook | None = None) -> None:
        self.path = Path(path)
        self.problems: list[str] = []
        self.metadata: BagMetadata | None = None
        self._decode = decode if decode is not None else installed_decoder()
        self._schema_decoder = SchemaDecoder()
        self._stack = ExitStack()
        self._parts: list[_McapPart | SqliteBag] = []
        self._topics: dict[str, TopicInfo] = {}
        try:
            self._open()
        except BaseException:
            self.close()
            raise

    def _open(self) -> None:
        self.files = self._find_files()
        failures: list[str] = []
        for file in self.files:
            try:
                self._parts.append(self._open_file(file))
            except BagError as error:
                failures.append(str(error))
            except OSError as error:
                failures.append(f"{file}: cannot be read: {error.strerror or error}")
        if not self._parts:
            raise BagError("; ".join(failures))
        self.problems += failures

    def _find_files(self) -> list[Path]:
        try:
            is_folder, is_file = self.path.is_dir(), self.path.is_file()
        except (OSError, ValueError) as error:
            raise BagError(f"{self.path}: cannot be read: {error}") from None
        if is_file:
            if not self.path.name.endswith(SUFFIXES):
                raise BagError(f"{self.path}: not a bag, which is a folder or a file ending in {', '.join(SUFFIXES)}")
            return [self.path]
        if not is_folder:
            raise BagError(f"{self.path}: there is no such bag")
        try:
            present = {file.name: file for file in self.path.iterdir() if file.name.endswith(SUFFIXES)}
        except OSError as error:
            raise BagError(f"{self.path}: cannot be read: {error.strerror}") from None
        try:
            self.metadata = read_metadata(self.path)
        except BagError as error:
            if not present:
                raise
            self.problems.append(f"{error}; the files of the folder are read instead")
        listed: list[str] = []
        if self.metadata is None:
            if present and not self.problems:
                self.problems.append(f"{self.path}: metadata.yaml is missing; the files of the folder are read instead")
        else:
            listed = [Path(name).name for name in self.metadata.stored_paths]
            self.problems += [f"{self.path}: {name} is missing" for name in listed if name not in present]
        for name in [name for name in present if name.removesuffix(".zstd") in present and name.endswith(".zstd")]:
            if name not in listed:
                del present[name]  # the compressor was stopped half-way; the file it started from is still there
        order = [name for name in listed if name in present]
        order += sorted((name for name in present if name not in listed), key=_natural)
        if not order:
            raise BagError(f"{self.path}: no bag in this folder (no file that ends in {', '.join(SUFFIXES)})")
        return [present[name] for name in order]

    def _open_file(self, file: Path) -> _McapPart | SqliteBag:
        stream: BinaryIO = self._stack.enter_context(file.open("rb"))
        name = file.name
        if name.endswith(".zstd"):
            stream = self._decompressed(stream, file)
            name = name.removesuffix(".zstd")
        if name.endswith(".db3"):
            source = Path(stream.name) if name != file.name else file
            part = SqliteBag(source, file.name)
            self._stack.callback(part.close)
            return part
        return _McapPart(scan_mcap(stream, str(file)), stream)

    def _decompressed(self, stream: BinaryIO, file: Path) -> BinaryIO:
        target = self._stack.enter_context(tempfile.NamedTemporaryFile(prefix="fsw_bag_", suffix=".db3"))  # noqa: SIM115
        written = 0
        try:
            with zstandard.ZstdDecompressor(max_window_size=2**27).stream_reader(stream, closefd=False) as source:
                while block := source.read(1 << 20):
                    written += len(block)
                    if written > MAX_DECOMPRESSED_FILE_BYTES:
                        raise BagError(
                            f"{file}: larger than {MAX_DECOMPRESSED_FILE_BYTES} bytes uncompressed, not read"
                        )
                    target.write(block)
        except zstandard.ZstdError as error:
            if not written:
                raise BagError(f"{file}: not a zstd file, or damaged: {error}") from None
            self.problems.append(f"{file}: zstd stream damaged after {written} bytes: {error}")
        except OSError as error:
            raise BagError(f"{file}: cannot be decompressed into {tempfile.gettempdir()}: {error.strerror}") from None
        target.flush()
        return target  # type: ignore[return-value]

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
        per_message = self.metadata is not None and self.metadata.compression_mode == "message"
        for position, part in enumerate(self._parts):
            for count, record in enumerate(part.records(topics, start_ns, stop_ns)):
                if per_message:
                    record = record._replace(data=_decompress_message(record.data, record.topic))
                yield record
                if progress is not None and count % 8192 == 0:
                    progress((position + part.fraction()) / len(self._parts))
            for problem in part.problems():
                if problem not in self.problems:
                    self.problems.append(problem)
        if progress is not None:
            progress(1.0)

    def topics(self) -> dict[str, TopicInfo]:
        """Topics with their types, definitions, QoS and number of messages (counted: reads the bag once)."""
        if not self._topics:
            self.info()
        return self._topics

    def known_topics(self) -> list[TopicInfo]:
        """Topics met so far (all of them once the bag was read), without counts."""
        topics: dict[str, TopicInfo] = {}
        for part in self._parts:
            for topic in part.topics():
                topics.setdefault(topic.name, topic)
        return list(topics.values())

    def info(self, progress: Callable[[float], None] | None = None) -> BagInfo:
        """Summary of the bag; reads it once.

        Parameters
        ----------
        progress : callable, optional
            Called now and then with the fraction read, 0 to 1.
        """
        counts: dict[str, int] = {}
        ticks = TickCounter()
        start, end = FOREVER_NS, 0
        for record in self.records(progress=progress):
            ticks.note(record.topic, record.data)
            counts[record.topic] = counts.get(record.topic, 0) + 1
            if record.log_time_ns < start:
                start = record.log_time_ns
            if record.log_time_ns > end:
                end = record.log_time_ns
        topics = {topic.name: topic for topic in self.known_topics()}
        for name, topic in topics.items():
            topic.count = counts.get(name, 0)
        self._topics = topics
        total = sum(counts.values())
        return BagInfo(
            path=self.path,
            storage="sqlite3" if isinstance(self._parts[0], SqliteBag) else "mcap",
            files=[file.name for file in self.files],
            size_bytes=sum(file.stat().st_size for file in self.files),
            message_count=total,
            start_ns=start if total else 0,
            end_ns=end,
            topics=sorted(topics.values(), key=lambda topic: topic.name),
            attachments=self.attachments(),
            custom_data=dict(self.metadata.custom_data) if self.metadata else {},
            ros_distro=self.metadata.ros_distro if self.metadata else "",
            problems=list(self.problems),
            tick_gaps=ticks.gaps(),
        )

    def attachments(self) -> list[Attachment]:
        """Attachments of all files; of several with one name the first."""
        found: dict[str, Attachment] = {}
        for part in self._parts:
            if isinstance(part, _McapPart):
                for attachment in part.scan.attachments:
                    found.setdefault(attachment.name, attachment)
        return list(found.values())

    def decode(self, record: BagRecord) -> Any:
        """Message object of a record.

        Raises
        ------
        BagError
            The data is damaged, or no definition of its type can be found.
        """
        failure: object = None
        if self._decode is not None:
            try:
                return self._decode(record.type_name, record.data)
            except (MemoryError, Exception) as error:  # whatever the hook raises, the bag's own definition is next
                failure = error
        topic = self.topics().get(record.topic)
        if topic is not None and topic.schema_encoding == "ros2msg":
            return self._schema_decoder.decode(record.type_name, topic.schema_text, record.data)
        reason = f": {failure}" if failure else ": neither installed nor defined in the bag"
        raise BagError(f"{record.topic}: {record.type_name} cannot be decoded{reason}")

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

    def __init__(self, scan: McapScan, stream: BinaryIO) -> None:
        self.scan = scan
        self._stream = stream
        self._size = max(stream.seek(0, 2), 1)

    def problems(self) -> list[str]:
        return self.scan.problems

    def fraction(self) -> float:
        return min(self._stream.tell() / self._size, 1.0)

    def records(self, topics: Collection[str] | None, start_ns: int, stop_ns: int) -> Iterator[BagRecord]:
        scan = self.scan
        wanted: dict[int, tuple[str, str] | None] = {}
        seen: dict[int, Channel] = {}
        for log_time, channel_id, sequence, publish_time, data in messages_in_time(
            scan, self._stream, start_ns, stop_ns
        ):
            channel = scan.channels.get(channel_id)
            if channel is None:
                problem = f"{scan.name}: messages of channel {channel_id}, which is not defined, are left out"
                if problem not in scan.problems:
                    scan.problems.append(problem)
                continue
            if seen.get(channel_id) is not channel:
                seen[channel_id] = channel
                schema = scan.schemas.get(channel.schema_id)
                keep = topics is None or channel.topic in topics
                wanted[channel_id] = (channel.topic, schema.name if schema else "") if keep else None
            target = wanted[channel_id]
            if target is not None:
                yield BagRecord(target[0], target[1], log_time, publish_time, data, sequence)

    def topics(self) -> list[TopicInfo]:
        result: list[TopicInfo] = []
        for channel in self.scan.channels.values():
            schema = self.scan.schemas.get(channel.schema_id)
            result.append(
                TopicInfo(
                    name=channel.topic,
                    type_name=schema.name if schema else "",
                    encoding=channel.encoding,
                    type_hash=channel.metadata.get("topic_type_hash", ""),
                    schema_encoding=schema.encoding if schema else "",
                    schema_text=schema.text.decode("utf-8", "replace") if schema else "",
                    qos=parse_qos(channel.metadata.get("offered_qos_profiles", "")),
                )
            )
        return result


def _decompress_message(data: bytes, topic: str) -> bytes:
    try:
        if zstandard.get_frame_parameters(data).content_size > MAX_MESSAGE_BYTES:
            raise BagError(f"{topic}: a compressed message is larger than {MAX_MESSAGE_BYTES} bytes, not read")
        return zstandard.ZstdDecompressor(max_window_size=2**27).decompress(data)
    except zstandard.ZstdError as error:
        raise BagError(f"{topic}: a compressed message is damaged: {error}") from None


def _natural(name: str) -> list[tuple[int, str]]:
    """Key that sorts ``bag_10`` behind ``bag_9``."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]
