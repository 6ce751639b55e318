"""Writes a rosbag2 MCAP bag from a thread of its own, so that recording never blocks the receive path."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.records import DataEnd, Footer
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer

from fsw_recorder.bag_metadata import METADATA_NAME, FileSummary, bag_information, information_text
from fsw_recorder.errors import BagError
from fsw_recorder.qos import qos_text
from fsw_recorder.topic import RecordedTopic

__all__ = ["BagWriter", "RecordedTopic", "WriterOptions", "WriterStatistics"]

_COMPRESSIONS = {"": CompressionType.NONE, "zstd": CompressionType.ZSTD}
#: times of an MCAP file are unsigned
_END_OF_TIME_NS = 2**64
#: bytes of a message record besides its data
_MESSAGE_HEAD_BYTES = 31
#: a chunk is committed a little before its period is over, so that a late wake-up does not exceed it
_EARLY = 0.9

#: topic, log time, publish time, sequence, data
Queued = tuple[str, int, int, int, bytes]


@dataclass(frozen=True, slots=True)
class WriterOptions:
    """How a bag is written.

    Attributes
    ----------
    compression : str
        Of chunks: empty or ``zstd``.
    max_file_bytes : int
        A new file is started beyond this size; 0: never.
    max_file_s : float
        A new file is started when a message is this much younger than the file's first [s]; 0: never.
    chunk_period_s : float
        Messages are handed to the operating system at least this often [s]; what is handed over survives kill -9.
    chunk_bytes : int
        Size at which a chunk is written before its time.
    sync_period_s : float
        What is handed over is forced to the disk this often [s], so that it survives a power failure; 0: only when a
        file is finished.
    max_pending_bytes : int
        Memory for messages that the disk has not taken yet; beyond it messages are dropped and counted. In snapshot
        mode: memory for the messages that a snapshot writes.
    snapshot : bool
        Keep the latest messages in memory and write them only on `BagWriter.take_snapshot`.
    """

    compression: str = ""
    max_file_bytes: int = 0
    max_file_s: float = 0.0
    chunk_period_s: float = 0.4
    chunk_bytes: int = 1024 * 1024
    sync_period_s: float = 1.0
    max_pending_bytes: int = 256 * 1024 * 1024
    snapshot: bool = False


@dataclass(slots=True)
class WriterStatistics:
    """Counters since the start.

    Attributes
    ----------
    received, written, dropped : int
        Messages handed in while not paused, messages in files, and messages that were refused: memory was full, their
        receive time is no time, or writing has failed.
    bytes : int
        Size of all files.
    pending_bytes : int
        Waiting to be written.
    files : int
        Begun so far.
    """

    received: int = 0
    written: int = 0
    dropped: int = 0
    bytes: int = 0
    pending_bytes: int = 0
    files: int = 0


class _Committed:
    """The stream that ``mcap`` writes to: everything reaches the file in one write per `flush`, or not at all.

    When a write fails (disk full, ...) the file is cut back to what was there before, so it never ends inside a record.
    """

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self.size = 0
        self._waiting = bytearray()

    def write(self, data: bytes) -> None:
        self._waiting += data

    def tell(self) -> int:
        return self.size + len(self._waiting)

    def rewind(self) -> None:
        """Forget what is waiting."""
        self._waiting.clear()

    def flush(self) -> None:
        view = memoryview(bytes(self._waiting))
        self._waiting.clear()
        total = len(view)
        try:
            while view:
                view = view[os.write(self.descriptor, view) :]
        except OSError:
            with suppress(OSError):
                os.ftruncate(self.descriptor, self.size)
            raise
        self.size += total


@dataclass(slots=True)
class _OpenFile:
    """One MCAP file that is being written; ``counts`` and ``summary`` show what is committed."""

    stream: _Committed
    mcap: Writer
    summary: FileSummary
    channels: dict[str, int] = field(default_factory=dict)
    schemas: dict[tuple[str, str], int] = field(default_factory=dict)
    waiting: dict[str, int] = field(default_factory=dict)
    waiting_bytes: int = 0
    first_ns: int = _END_OF_TIME_NS
    last_ns: int = 0
    counts: dict[str, int] = field(default_factory=dict)

    def commit(self) -> None:
        self.mcap.flush()
        for topic, count in self.waiting.items():
            self.counts[topic] = self.counts.get(topic, 0) + count
        self.waiting.clear()
        self.waiting_bytes = 0
        self.summary.message_count = sum(self.counts.values())
        if self.counts:
            self.summary.start_ns, self.summary.end_ns = self.first_ns, self.last_ns


class BagWriter:
    """Writes one bag folder: ``<folder>/<folder>_0.mcap``, … and, when closed, ``metadata.yaml``.

    Parameters
    ----------
    folder : Path
        Must not exist; its parents are created.
    options : WriterOptions
    custom_data : mapping of str to str, optional
        For ``metadata.yaml``.
    on_error : callable, optional
        Called once, from the writing thread, when writing fails for whatever reason. What was committed until then
        stays readable.

    Raises
    ------
    BagError
        The folder exists or cannot be made.
    """

    def __init__(
        self,
        folder: Path,
        options: WriterOptions | None = None,
        custom_data: Mapping[str, str] | None = None,
        on_error: Callable[[BagError], None] | None = None,
    ) -> None:
        self.options = options or WriterOptions()
        if self.options.compression not in _COMPRESSIONS:
            raise BagError(f"compression '{self.options.compression}' is not known; use 'zstd' or nothing")
        self.folder = Path(os.path.abspath(folder))
        self.custom_data = dict(custom_data or {})
        self.error: BagError | None = None
        self.is_paused = False
        self._on_error = on_error
        self._queue: deque[Queued | Callable[[], None]] = deque()
        self._ring: deque[Queued] = deque()
        self._ring_bytes = 0
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._closing = False
        self._statistics = WriterStatistics()
        self._put_bytes = self._taken_bytes = 0
        self._topics: dict[str, RecordedTopic] = {}
        self._used_topics: set[str] = set()
        self._files: list[_OpenFile] = []
        self._file: _OpenFile | None = None
        self._last_commit = self._last_sync = time.monotonic()
        self._folder_descriptor = self._make_folder()
        try:
            self._begin_file()
        except OSError as error:
            os.close(self._folder_descriptor)
            raise BagError(f"{self.folder}: cannot be written: {error.strerror}") from None
        self._thread = threading.Thread(target=self._run, name="bag_writer", daemon=True)
        self._thread.start()

    # ------------------------------------------------------- called from the receive path

    def add_topic(self, topic: RecordedTopic) -> None:
        """Make a topic known; after its first message its entry stays as it is."""
        self._put(lambda: self._take_topic(topic))

    def write(self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int, sequence: int = 0) -> bool:
        """Hand in a message; never blocks on the disk and never raises.

        A publish time that no MCAP file can hold (a source may claim anything) is replaced by the log time.

        Returns
        -------
        bool
            False when it will not be in the bag: paused, memory full, no receive time, or writing has failed.
        """
        if self.is_paused:
            return False
        if not 0 <= publish_time_ns < _END_OF_TIME_NS:
            publish_time_ns = log_time_ns
        with self._lock:
            self._statistics.received += 1
            pending = self._put_bytes - self._taken_bytes
            refused = self.error is not None or self._closing or not 0 <= log_time_ns < _END_OF_TIME_NS
            if refused or pending + len(data) > self.options.max_pending_bytes:
                self._statistics.dropped += 1
                return False
            self._put_bytes += len(data)
            self._queue.append((topic, log_time_ns, publish_time_ns, sequence & 0xFFFFFFFF, data))
        if pending > self.options.chunk_bytes and not self._wake.is_set():
            self._wake.set()
        return True

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Put a file into the bag."""
        now = time.time_ns()

        def add() -> None:
            file = self._current()
            file.mcap.add_attachment(now, now, name, media_type, data)
            file.stream.flush()

        self._put(add)

    def pause(self) -> None:
        """Ignore messages from now on."""
        self.is_paused = True

    def resume(self) -> None:
        """Take messages again."""
        self.is_paused = False

    def split(self) -> None:
        """Begin a new file with the next message."""
        self._put(self._split)

    def take_snapshot(self) -> None:
        """In snapshot mode: write the messages in memory to the bag and forget them.

        Raises
        ------
        BagError
            The writer is not in snapshot mode.
        """
        if not self.options.snapshot:
            raise BagError("a snapshot needs snapshot mode; this recorder writes everything already")
        self._put(self._write_ring)

    def statistics(self) -> WriterStatistics:
        """Counters since the start."""
        with self._lock:
            return replace(self._statistics, pending_bytes=self._put_bytes - self._taken_bytes, files=len(self._files))

    def flush(self, timeout_s: float = 10.0) -> bool:
        """Wait until everything handed in so far is handed to the operating system; False on timeout or error."""
        done = threading.Event()

        def mark() -> None:
            self._commit()
            done.set()

        self._put(mark)
        deadline = time.monotonic() + timeout_s
        while not done.wait(0.02):
            if not self._thread.is_alive() or time.monotonic() > deadline:
                return False
        return self.error is None

    def close(self) -> None:
        """Write what is waiting, finish the file and write ``metadata.yaml``; harmless when repeated."""
        self._closing = True
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _put(self, action: Callable[[], None]) -> None:
        self._queue.append(action)
        self._wake.set()

    # ------------------------------------------------------- the writing thread

    def _run(self) -> None:
        try:
            while not self._closing:
                self._wake.wait(self.options.chunk_period_s / 2)
                self._wake.clear()
                self._work()
            self._work()
            self._finish_file()
            self._write_metadata()
        except OSError as error:
            self._close_off()
            self._fail(f"{self.folder}: writing failed: {error.strerror or error}")
        except BagError as error:
            with suppress(Exception):  # a folder that was moved holds a whole bag
                self._finish_file()
            self._fail(str(error))
        except Exception as error:  # a thread that dies unnoticed would look like a recording one
            self._close_off()
            self._fail(f"{self.folder}: writing failed: {type(error).__name__}: {error}")
        finally:
            with suppress(OSError):
                if self._file is not None:
                    os.close(self._file.stream.descriptor)
                os.close(self._folder_descriptor)

    def _work(self) -> None:
        while self._queue:
            item = self._queue.popleft()
            if not isinstance(item, tuple):
                item()
                continue
            if self.options.snapshot:
                self._keep(item)
            else:
                self._write_message(item)
            self._taken_bytes += len(item[4])
        now = time.monotonic()
        if now - self._last_commit >= _EARLY * self.options.chunk_period_s:
            self._commit()
            self._last_commit = now
            if self.options.sync_period_s and now - self._last_sync >= self.options.sync_period_s:
                os.fdatasync(self._current().stream.descriptor)
                self._last_sync = now

    def _write_message(self, item: Queued) -> None:
        topic, log_time, publish_time, sequence, data = item
        file = self._current()
        if self.options.max_file_s and log_time - file.first_ns > self.options.max_file_s * 1e9:
            self._split()
            file = self._current()
        channel = file.channels.get(topic)
        if channel is None:
            channel = self._add_channel(file, topic)
        file.mcap.add_message(channel, log_time, data, publish_time, sequence)
        file.waiting[topic] = file.waiting.get(topic, 0) + 1
        file.waiting_bytes += _MESSAGE_HEAD_BYTES + len(data)
        file.first_ns, file.last_ns = min(file.first_ns, log_time), max(file.last_ns, log_time)
        if file.waiting_bytes >= self.options.chunk_bytes:
            self._commit()

    def _add_channel(self, file: _OpenFile, topic: str) -> int:
        known = self._topics.setdefault(topic, RecordedTopic(topic, "", qos=()))
        self._used_topics.add(topic)
        key = (known.type_name, known.definition)
        schema = file.schemas.get(key)
        if schema is None:
            encoding = known.definition_encoding if known.definition else ""
            schema = file.mcap.register_schema(known.type_name, encoding, known.definition.encode())
            file.schemas[key] = schema
        metadata = {"offered_qos_profiles": qos_text(known.qos), "topic_type_hash": known.type_hash}
        file.channels[topic] = file.mcap.register_channel(topic, known.encoding, schema, metadata)
        return file.channels[topic]

    def _take_topic(self, topic: RecordedTopic) -> None:
        # Readers match a file's channels with metadata.yaml by type and QoS, so these may not change on the way.
        if topic.name not in self._used_topics:
            self._topics[topic.name] = topic

    def _keep(self, item: Queued) -> None:
        self._ring.append(item)
        self._ring_bytes += len(item[4])
        while self._ring_bytes > self.options.max_pending_bytes:
            self._ring_bytes -= len(self._ring.popleft()[4])

    def _write_ring(self) -> None:
        for item in self._ring:
            self._write_message(item)
        self._ring.clear()
        self._ring_bytes = 0
        self._commit()

    def _commit(self) -> None:
        file = self._current()
        file.commit()
        self._count()
        if not self._is_in_place(file):
            raise BagError(
                f"{self.folder}: the bag folder was moved or deleted while recording; recording ends here. "
                "A moved folder holds a readable bag"
            )
        if self.options.max_file_bytes and file.stream.size >= self.options.max_file_bytes:
            self._split()

    def _count(self) -> None:
        self._statistics.written = sum(one.summary.message_count for one in self._files)
        self._statistics.bytes = sum(one.stream.size for one in self._files)

    # ------------------------------------------------------- files

    def _make_folder(self) -> int:
        try:
            self.folder.parent.mkdir(parents=True, exist_ok=True)
            self.folder.mkdir()
            return os.open(self.folder, os.O_RDONLY | os.O_DIRECTORY)
        except FileExistsError:
            if self.folder.exists():
                raise BagError(
                    f"{self.folder}: exists already; nothing was recorded. Choose another folder or remove this one"
                ) from None
            raise BagError(f"{self.folder.parent}: cannot be made: a file is in the way") from None
        except OSError as error:
            raise BagError(
                f"{self.folder}: cannot be made: {error.strerror}. Choose a folder you may write to"
            ) from None

    def _current(self) -> _OpenFile:
        if self._file is None:
            self._begin_file()
        assert self._file is not None
        return self._file

    def _begin_file(self) -> None:
        name = f"{self.folder.name}_{len(self._files)}.mcap"
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | os.O_APPEND
        stream = _Committed(os.open(name, flags, 0o644, dir_fd=self._folder_descriptor))
        try:
            mcap = Writer(
                stream,  # type: ignore[arg-type]  # it calls write, tell and flush
                chunk_size=2 * self.options.chunk_bytes,
                compression=_COMPRESSIONS[self.options.compression],
            )
            mcap.start("ros2", "fsw_recorder")
            stream.flush()
        except OSError:
            os.close(stream.descriptor)
            raise
        self._file = _OpenFile(stream, mcap, FileSummary(name))
        self._files.append(self._file)

    def _is_in_place(self, file: _OpenFile) -> bool:
        """Whether the file's path still leads to the file that is written."""
        try:
            there, here = os.stat(self.folder / file.summary.path), os.fstat(file.stream.descriptor)
        except OSError:
            return False
        return (there.st_dev, there.st_ino) == (here.st_dev, here.st_ino)

    def _split(self) -> None:
        if self._file is not None and self._file.channels:
            self._finish_file()

    def _finish_file(self) -> None:
        file = self._file
        if file is None:
            return
        file.commit()
        file.mcap.add_metadata("rosbag2", {"serialized_metadata": information_text(self._information(), whole=False)})
        file.mcap.finish()
        file.stream.flush()
        os.fsync(file.stream.descriptor)
        self._count()
        self._file = None
        os.close(file.stream.descriptor)

    def _close_off(self) -> None:
        """End a file without a summary behind what is committed, so that every reader takes it for whole."""
        if self._file is None:
            return
        builder = RecordBuilder()
        DataEnd(0).write(builder)
        Footer(summary_start=0, summary_offset_start=0, summary_crc=0).write(builder)
        with suppress(OSError):
            self._file.stream.rewind()
            self._file.stream.write(builder.end() + MCAP0_MAGIC)
            self._file.stream.flush()

    def _information(self) -> dict[str, Any]:
        counts = {name: sum(file.counts.get(name, 0) for file in self._files) for name in self._topics}
        topics = [(topic, counts[name]) for name, topic in self._topics.items()]
        return bag_information([file.summary for file in self._files], topics, self.custom_data)

    def _write_metadata(self) -> None:
        temporary, here = f".{METADATA_NAME}.new", self._folder_descriptor
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644, dir_fd=here)
        with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
            stream.write(information_text(self._information()))
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, METADATA_NAME, src_dir_fd=here, dst_dir_fd=here)
        os.fsync(here)

    def _fail(self, text: str) -> None:
        """Stop recording, leave behind what is committed, and tell why."""
        with self._lock:
            self.error = BagError(text)
            unwritten = self._statistics.received - self._statistics.dropped - self._statistics.written
            self._statistics.dropped += max(unwritten, 0)
            self._queue.clear()
        with suppress(Exception):
            self._write_metadata()
        if self._on_error is not None:
            self._on_error(self.error)
