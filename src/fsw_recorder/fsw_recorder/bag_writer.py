"""Writes a rosbag2 MCAP bag in its own thread, so that recording never blocks receiving."""

from __future__ import annotations

import os
import shutil
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import IO

from fsw_recorder.bag_file import CHUNK_BYTES, BagFile
from fsw_recorder.bag_metadata import METADATA_NAME, FileSummary, metadata_text
from fsw_recorder.errors import BagError
from fsw_recorder.manifest import (
    MANIFEST_NAME,
    FileManifest,
    Manifest,
    clock_state,
    hashed,
    sha256,
)
from fsw_recorder.signature import Purpose, load_private, sign, signature_path
from fsw_recorder.topic import RecordedTopic

__all__ = ["BagWriter", "RecordedTopic", "WriterOptions"]

#: times in an MCAP file are unsigned
_END_OF_TIME_NS = 2**64
#: share of the chunk period after which a chunk is committed, so that a late wake-up does not
#: exceed it
_EARLY = 0.9

#: space kept free on the disk for what closes a bag: the end of its file, metadata and manifest
_RESERVED_BYTES = 256 * 1024

#: topic, log time, publish time, sequence, data
Queued = tuple[str, int, int, int, bytes]
#: what else the writing thread has to do, and whether it was done
Request = tuple[Callable[[], None], Future[bool]]


@dataclass(frozen=True, slots=True)
class WriterOptions:
    """How a bag is written: the recorder's parameters of the same names (``parameters.py``)."""

    compression: str = ""
    max_bag_size: int = 0  # bytes
    max_bag_duration: float = 0.0  # s
    chunk_period: float = 0.4  # s; after that messages survive kill -9
    sync_period: float = 1.0  # s
    max_cache_size: int = 256 * 1024 * 1024  # bytes
    manifest: bool = False
    signing_key: str = ""  # path


class BagWriter:
    """Writes a bag folder: ``<folder>_0.mcap``, … and at the end ``metadata.yaml``.

    Raises
    ------
    BagError
        If the folder exists or cannot be created (parents are).
    InputError
        If the key that signs the manifest cannot be used.
    """

    def __init__(
        self,
        folder: Path,
        options: WriterOptions | None = None,
        custom_data: Mapping[str, str] | None = None,
    ) -> None:
        self.options = options or WriterOptions()
        self.folder = Path(os.path.abspath(folder))
        self.custom_data = dict(custom_data or {})
        self.error: BagError | None = (
            None  #: why writing has failed. What was committed until then stays readable
        )
        self.is_paused = False  #: messages are ignored while it is set
        self._files = _Files(self.folder, self.options, self.custom_data)
        self._queue: deque[Queued | Request] = deque()
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._closing = self._ended = False
        self._received = self._dropped = 0
        self._put_bytes = self._taken_bytes = 0
        self._thread = threading.Thread(target=self._run, name="bag_writer", daemon=True)
        self._thread.start()

    def add_topic(self, topic: RecordedTopic) -> None:
        """Register a topic; its first description stays, because readers match channels by it."""
        self._files.topics.setdefault(topic.name, topic)

    def write(
        self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int, sequence: int = 0
    ) -> bool:
        """Queue a message; never blocks on the disk and never raises.

        Returns False if it will not be in the bag: paused, memory full, no receive time, or
        writing has failed. A publish time that an MCAP file cannot hold (a source may claim
        anything) is replaced by the log time.
        """
        if self.is_paused:
            return False
        if not 0 <= publish_time_ns < _END_OF_TIME_NS:
            publish_time_ns = log_time_ns
        with self._lock:
            self._received += 1
            pending = self._put_bytes - self._taken_bytes
            refused = (
                self.error is not None or self._closing or not 0 <= log_time_ns < _END_OF_TIME_NS
            )
            if refused or pending + len(data) > self.options.max_cache_size:
                self._dropped += 1
                return False
            self._put_bytes += len(data)
            self._queue.append((topic, log_time_ns, publish_time_ns, sequence & 0xFFFFFFFF, data))
        if pending > CHUNK_BYTES and not self._wake.is_set():
            self._wake.set()
        return True

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a file to the bag."""
        now = time.time_ns()
        self._put(lambda: self._files.attach(now, name, media_type, data))

    def split(self) -> Future[bool]:
        """Start a new file with the next message; the future as of `flushed`."""
        return self._put(self._files.split)

    def statistics(self) -> dict[str, int]:
        """Counters since the start.

        ``received``, ``written`` and ``dropped`` are messages: queued while not paused, in files,
        and rejected.
        """
        with self._lock:
            files = self._files.summaries
            return {
                "received": self._received,
                "written": sum(file.counts.total() for file in files),
                "dropped": self._dropped,
                "files": len(files),
                "bytes": sum(file.size_bytes for file in files),
                "pending_bytes": self._put_bytes - self._taken_bytes,
            }

    def flushed(self) -> Future[bool]:
        """Future: True once all messages so far are with the operating system, False if never."""
        return self._put(self._files.commit)

    def flush(self, timeout_s: float = 10.0) -> bool:
        """Wait until all messages so far are with the operating system; False if they are not."""
        try:
            return self.flushed().result(timeout_s)
        except TimeoutError:
            return False

    def close(self) -> None:
        """Write all queued messages, finish the file, write ``metadata.yaml``; idempotent."""
        self._closing = True
        self._wake.set()
        self._thread.join()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _put(self, action: Callable[[], None]) -> Future[bool]:
        done: Future[bool] = Future()
        with self._lock:
            if self._ended:
                done.set_result(False)
            else:
                self._queue.append((action, done))
        self._wake.set()
        return done

    # ------------------------------------------------------- the writing thread

    def _run(self) -> None:
        try:
            while not self._closing:
                self._wake.wait(_EARLY * self.options.chunk_period)
                self._wake.clear()
                self._work()
            self._work()
            self._files.finish()
        except Exception as error:  # a dead thread would look like a recording one
            self._fail(error)
        finally:
            self._files.close()
            with self._lock:
                self._ended = True
            self._refuse_rest()

    def _work(self) -> None:
        while self._queue:
            # it stays queued until it is done, so that a failure does not lose a future
            item = self._queue[0]
            if len(item) == 2:
                action, done = item
                action()
                done.set_result(True)
            else:
                self._files.write(*item)
                self._taken_bytes += len(item[-1])
            self._queue.popleft()
        self._files.commit()
        self._files.sync()

    def _refuse_rest(self) -> None:
        while self._queue:
            item = self._queue.popleft()
            if len(item) == 2:
                item[1].set_result(False)

    def _fail(self, error: Exception) -> None:
        """Stop recording, leave the committed data as an intact bag, and keep the reason."""
        if not isinstance(error, BagError):
            reason = getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
            error = BagError(f"{self.folder}: writing failed: {reason}")
        self._files.close_off()
        with self._lock:
            self.error = error
            written = sum(file.counts.total() for file in self._files.summaries)
            self._dropped = max(self._dropped, self._received - written)


class _Files:
    """The files of a bag, written by one thread; `summaries` cover all committed data."""

    def __init__(self, folder: Path, options: WriterOptions, custom_data: dict[str, str]) -> None:
        self.topics: dict[str, RecordedTopic] = {}
        self.summaries: tuple[FileSummary, ...] = ()
        self._manifests: list[FileManifest] = []
        self._attachments: dict[str, str] = {}
        self._folder, self._options, self._custom_data = folder, options, custom_data
        self._file: BagFile | None = None
        self._key = (
            load_private(Path(options.signing_key).expanduser()) if options.signing_key else None
        )
        self._last_sync = time.monotonic()
        with ExitStack() as undo:  # a bag that cannot begin leaves nothing
            self._descriptor = _make_folder(folder)
            undo.callback(shutil.rmtree, folder, ignore_errors=True)
            undo.callback(self.close)
            try:
                self._reserve = undo.enter_context(_reserved(folder))
                self.current()
            except OSError as error:
                raise BagError(f"{folder}: cannot be written: {error.strerror}") from None
            undo.pop_all()

    def current(self) -> BagFile:
        """The file being written; opened on demand."""
        if self._file is None:
            name = f"{self._folder.name}_{len(self.summaries)}.mcap"
            self._file = BagFile(name, self._descriptor, self._options.compression)
            self.summaries += (self._file.committed,)
        return self._file

    def write(
        self, name: str, log_time_ns: int, publish_time_ns: int, sequence: int, data: bytes
    ) -> None:
        longest_ns = self._options.max_bag_duration * 1e9
        if longest_ns and log_time_ns - self.current().added.start_ns > longest_ns:
            self.split()
        topic = self.topics.setdefault(name, RecordedTopic(name, "", qos=()))
        if self.current().add_message(topic, data, log_time_ns, publish_time_ns, sequence):
            self.commit()

    def attach(self, time_ns: int, name: str, media_type: str, data: bytes) -> None:
        self.current().attach(time_ns, name, media_type, data)
        self._attachments.setdefault(name, sha256(data))

    def commit(self) -> None:
        """Pass all messages to the operating system."""
        file = self._file
        if file is None:
            return
        file.commit()
        self.summaries = (*self.summaries[:-1], file.committed)
        if not file.is_at(self._folder / file.committed.path):
            self._finish_file()
            raise BagError(
                f"{self._folder}: the bag folder was moved or deleted while recording; "
                "recording ends here. A moved folder holds a readable bag"
            )
        if self._options.max_bag_size and file.committed.size_bytes >= self._options.max_bag_size:
            self.split()

    def sync(self) -> None:
        """Flush committed data to disk when due."""
        now = time.monotonic()
        if self._file is not None and 0.0 < self._options.sync_period <= now - self._last_sync:
            self._file.sync()
            self._last_sync = now

    def split(self) -> None:
        """Finish the file if it has messages."""
        if self._file is not None and self._file.added.counts:
            self._finish_file()

    def _finish_file(self) -> None:
        if self._file is not None:
            self._file.commit()
            self.summaries = (*self.summaries[:-1], self._file.committed)
            self._file.finish(self._metadata(whole=False))
            self._manifests.append(self._file.manifest())
            self._file = None
            self._write_manifest()

    def finish(self) -> None:
        """Finish the bag."""
        self._reserve.close()
        self._finish_file()
        self._write_metadata()

    def close_off(self) -> None:
        """Leave the committed data as an intact bag, whatever has failed."""
        self._reserve.close()  # of a full disk
        if self._file is not None:
            with suppress(OSError):
                self._file.close_off()
            self._manifests.append(self._file.manifest())
        self._file = None
        with suppress(Exception):
            self._write_metadata()

    def close(self) -> None:
        """Close the folder."""
        os.close(self._descriptor)

    def _metadata(self, whole: bool = True) -> str:
        return metadata_text(self.summaries, list(self.topics.values()), self._custom_data, whole)

    def _write_metadata(self) -> None:
        text = self._metadata()
        self._replace(METADATA_NAME, text)
        self._write_manifest(hashed(METADATA_NAME, text.encode(), "while_recording"))

    def _write_manifest(self, *last: FileManifest) -> None:
        """Write the hashes of the closed files; with the ``last`` one, signed."""
        if self._options.manifest:
            manifest = Manifest(
                bag=self._folder.name,
                custom_data=self._custom_data,
                attachments_sha256=self._attachments,
                clock=clock_state(),
                files=(*self._manifests, *last),
            )
            text = manifest.text()
            self._replace(MANIFEST_NAME, text)
            if last and self._key is not None:
                signed = sign(
                    text.encode(), MANIFEST_NAME, Purpose.MANIFEST, self._key, datetime.now(UTC)
                )
                self._replace(signature_path(Path(MANIFEST_NAME)).name, signed)

    def _replace(self, name: str, text: str) -> None:
        temporary, here = f".{name}.new", self._descriptor
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644, dir_fd=here)
        try:
            with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
                stream.write(text)
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(temporary, name, src_dir_fd=here, dst_dir_fd=here)
        except OSError:
            os.unlink(temporary, dir_fd=here)
            raise
        os.fsync(here)


def _make_folder(folder: Path) -> int:
    """Create the folder of a bag and open it."""
    try:
        folder.mkdir(parents=True)
        return os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except FileExistsError:
        raise taken(folder) from None
    except OSError as error:
        raise BagError(
            f"{folder}: cannot be made: {error.strerror}. Choose a folder you may write to"
        ) from None


def _reserved(folder: Path) -> IO[bytes]:
    """A file without a name that keeps the space; none where the disk cannot do that."""
    file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115  # open as long as the bag
    with suppress(OSError):
        os.posix_fallocate(file.fileno(), 0, _RESERVED_BYTES)
    return file


def taken(folder: Path) -> BagError:
    """Error for a bag whose folder exists already."""
    return BagError(
        f"{folder}: exists already; nothing was recorded. Choose another folder or remove this one"
    )
