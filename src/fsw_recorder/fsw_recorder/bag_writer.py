"""Writes a rosbag2 MCAP bag from a thread of its own, so that recording never blocks the receive path."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from fsw_recorder.bag_metadata import METADATA_NAME, BagMetadata, FileSummary, TopicSummary, qos_text
from fsw_recorder.errors import BagError
from fsw_recorder.mcap_output import COMPRESSIONS, McapOutput
from fsw_recorder.writer_options import RecordedTopic, WriterOptions, WriterStatistics

__all__ = ["BagWriter", "RecordedTopic", "WriterOptions", "WriterStatistics"]

#: topic, log time, publish time, sequence, data
Queued = tuple[str, int, int, int, bytes]


@dataclass(slots=True)
class _OpenFile:
    output: McapOutput
    summary: FileSummary
    channels: dict[str, int] = field(default_factory=dict)
    schemas: dict[tuple[str, str], int] = field(default_factory=dict)


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
        Called once, from the writing thread, when writing fails. What is written until then stays readable.

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
        if self.options.compression not in COMPRESSIONS:
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
        self._put_bytes = self._taken_bytes = self._done_bytes = 0
        self._topics: dict[str, RecordedTopic] = {}
        self._used_topics: set[str] = set()
        self._files: list[FileSummary] = []
        self._file: _OpenFile | None = None
        self._finished_counts: dict[str, int] = {}
        self._finished_bytes = self._synced_bytes = 0
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

        Returns
        -------
        bool
            False when it will not be in the bag: paused, memory full, or writing has failed.
        """
        if self.is_paused:
            return False
        with self._lock:
            self._statistics.received += 1
            pending = self._put_bytes - self._taken_bytes
            if self.error is not None or self._closing or pending + len(data) > self.options.max_pending_bytes:
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
        self._put(lambda: self._current().output.add_attachment(name, media_type, now, data))

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
            current = self._statistics
            return WriterStatistics(
                received=current.received,
                written=current.written,
                dropped=current.dropped,
                bytes=current.bytes,
                pending_bytes=self._put_bytes - self._taken_bytes,
                files=len(self._files),
                longest_write_s=current.longest_write_s,
            )

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
            self._end()
        except OSError as error:
            self._fail(f"{self.folder}: writing failed: {error.strerror or error}")
        except BagError as error:
            self._fail(str(error))
        finally:
            if self._file is not None:
                self._file.output.close()
            with suppress(OSError):
                os.close(self._folder_descriptor)

    def _work(self) -> None:
        queue = self._queue
        while queue:
            item = queue.popleft()
            if not isinstance(item, tuple):
                item()
                continue
            self._done_bytes += len(item[4])
            if self.options.snapshot:
                self._keep(item)
            else:
                self._write_message(item)
            self._taken_bytes = self._done_bytes
        now = time.monotonic()
        if now - self._last_commit >= 0.9 * self.options.chunk_period_s:
            self._commit()
            self._last_commit = now
            written = self._finished_bytes + self._current().output.size
            due = self.options.sync_period_s and now - self._last_sync >= self.options.sync_period_s
            if due and written != self._synced_bytes:
                self._timed(self._current().output.sync)
                self._last_sync, self._synced_bytes = now, written

    def _write_message(self, item: Queued) -> None:
        topic, log_time, publish_time, sequence, data = item
        file = self._current()
        limit_s = self.options.max_file_s
        if limit_s and log_time - file.output.first_ns > limit_s * 1e9:
            self._split()
            file = self._current()
        channel = file.channels.get(topic)
        if channel is None:
            channel = self._add_channel(file, topic)
        file.output.add_message(channel, sequence, log_time, publish_time, data)
        if file.output.chunk_size >= self.options.chunk_bytes:
            self._commit()

    def _add_channel(self, file: _OpenFile, topic: str) -> int:
        known = self._topics.setdefault(topic, RecordedTopic(topic, "", qos=()))
        self._used_topics.add(topic)
        key = (known.type_name, known.definition)
        schema = file.schemas.get(key)
        if schema is None:
            encoding = known.definition_encoding if known.definition else ""
            schema = file.schemas[key] = file.output.add_schema(known.type_name, encoding, known.definition)
        metadata = {"offered_qos_profiles": qos_text(known.qos), "topic_type_hash": known.type_hash}
        file.channels[topic] = file.output.add_channel(topic, schema, known.encoding, metadata)
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

    def _timed(self, action: Callable[[], None]) -> None:
        started = time.monotonic()
        action()
        elapsed = time.monotonic() - started
        if elapsed > self._statistics.longest_write_s:
            self._statistics.longest_write_s = elapsed

    def _commit(self) -> None:
        file = self._current()
        self._timed(file.output.commit)
        if not file.output.same_file(str(self.folder / file.summary.path)):
            raise BagError(
                f"{self.folder}: the bag folder was moved or deleted while recording; recording ends here. "
                "A moved folder holds a readable bag"
            )
        self._count(file)
        if self.options.max_file_bytes and file.output.size >= self.options.max_file_bytes:
            self._split()

    def _count(self, file: _OpenFile) -> None:
        file.summary.message_count = file.output.message_count
        file.summary.start_ns, file.summary.end_ns = file.output.span_ns
        self._statistics.written = sum(one.message_count for one in self._files)
        self._statistics.bytes = self._finished_bytes + file.output.size

    # ------------------------------------------------------- files

    def _make_folder(self) -> int:
        try:
            if not self.folder.parent.is_dir():
                self.folder.parent.mkdir(parents=True)
        except OSError as error:
            raise BagError(
                f"{self.folder.parent}: cannot be made: {error.strerror}. Choose a folder you may write to"
            ) from None
        try:
            self.folder.mkdir()
            return os.open(self.folder, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0))
        except FileExistsError:
            raise BagError(
                f"{self.folder}: exists already; nothing was recorded. Choose another folder or remove this one"
            ) from None
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
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_CLOEXEC", 0)
        descriptor = os.open(name, flags, 0o644, dir_fd=self._folder_descriptor)
        try:
            output = McapOutput(descriptor, self.options.compression)
        except OSError:
            os.close(descriptor)
            raise
        self._file = _OpenFile(output, FileSummary(name))
        self._files.append(self._file.summary)

    def _split(self) -> None:
        file = self._file
        if file is None or not file.channels:
            return
        self._finish_file(file)
        self._finished_bytes += file.output.size
        for topic, channel in file.channels.items():
            count = file.output.counts.get(channel, 0)
            self._finished_counts[topic] = self._finished_counts.get(topic, 0) + count
        file.output.close()
        self._file = None

    def _finish_file(self, file: _OpenFile) -> None:
        file.output.commit()
        self._count(file)
        file.output.add_metadata("rosbag2", {"serialized_metadata": self._metadata().inner_text()})
        file.output.finish()
        self._count(file)

    def _metadata(self) -> BagMetadata:
        counts = dict(self._finished_counts)
        if self._file is not None:
            for topic, channel in self._file.channels.items():
                counts[topic] = counts.get(topic, 0) + self._file.output.counts.get(channel, 0)
        topics = [
            TopicSummary(one.name, one.type_name, one.type_hash, list(one.qos), counts.get(one.name, 0))
            for one in self._topics.values()
        ]
        return BagMetadata(files=self._files, topics=topics, custom_data=self.custom_data)

    def _end(self) -> None:
        if self._file is not None:
            self._finish_file(self._file)
        self._write_metadata()

    def _write_metadata(self) -> None:
        temporary = f".{METADATA_NAME}.new"
        here = self._folder_descriptor
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644, dir_fd=here)
        with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
            stream.write(self._metadata().document())
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, METADATA_NAME, src_dir_fd=here, dst_dir_fd=here)
        os.fsync(here)

    def _fail(self, text: str) -> None:
        """Stop recording, leave behind what is written, readable, and tell why."""
        self.error = BagError(text)
        with suppress(OSError):
            if self._file is not None:
                self._finish_file(self._file)
        with suppress(OSError):
            self._write_metadata()
        with self._lock:
            unwritten = self._statistics.received - self._statistics.dropped - self._statistics.written
            self._statistics.dropped += max(unwritten, 0)
            self._queue.clear()
        if self._on_error is not None:
            self._on_error(self.error)
