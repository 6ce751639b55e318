"""Opens bags of any kind and state: rosbag2 folders, single files, truncated or damaged ones."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Attachment

from fsw_recorder.bag_metadata import METADATA_NAME, BagMetadata, read_metadata
from fsw_recorder.errors import BagError
from fsw_recorder.mcap_file import McapFile
from fsw_recorder.rosbags_file import COMPRESSED, RosbagsFile
from fsw_recorder.topic import BagRecord, RecordedTopic

__all__ = ["BagInfo", "BagReader", "BagRecord"]

FOREVER_NS = 2**64
#: receive times that mean unknown
UNKNOWN_NS = (0, FOREVER_NS - 1)
SUFFIXES = (".mcap", ".db3", f".mcap{COMPRESSED}", f".db3{COMPRESSED}")
#: progress is reported after this many messages
_PROGRESS_STEP = 8192


@dataclass(frozen=True, slots=True)
class BagInfo:
    """Messages of a bag, counted from themselves instead of its metadata.

    `counts` are messages by topic; `start_ns` and `end_ns` are the log times of the first and the
    last message with a known time (0 if none has).
    """

    counts: dict[str, int]
    start_ns: int
    end_ns: int

    @property
    def message_count(self) -> int:
        """Total number of messages."""
        return sum(self.counts.values())

    @property
    def duration_s(self) -> float:
        """Time from the first message to the last [s]."""
        return (self.end_ns - self.start_ns) * 1e-9


class BagReader:
    """Reads a bag; a context manager.

    A bag is a rosbag2 folder (with or without ``metadata.yaml``, which is required for compressed
    messages) or a single storage file, see ``SUFFIXES``.

    Raises
    ------
    BagError
        If there is no bag at ``path``, or nothing of it can be read.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        #: problems found so far; an unfinished recording (kill -9, power failure, full disk) is
        #: read up to its end, damaged places are skipped
        self.problems: list[str] = []
        self.metadata = BagMetadata()
        self._stack = ExitStack()
        self.storage = ""  #: kind of the storage
        self._parts: list[McapFile | RosbagsFile] = []
        self._info: BagInfo | None = None
        try:
            self._paths = self._find_files()
        except (OSError, ValueError) as error:
            raise BagError(f"{path}: cannot be read: {error}") from None
        failures: list[str] = []
        for file in self._paths:
            try:
                self._parts.append(self._open_file(file))
            except (BagError, OSError) as error:
                failures.append(str(error))
        if not self._parts:
            self.close()
            raise BagError("; ".join(failures))
        self.problems += failures
        self.storage = self._parts[0].storage
        for part in self._parts:  # the folder may have been lost, including its metadata
            self.metadata.custom_data = part.metadata.custom_data | self.metadata.custom_data
            self.metadata.ros_distro = self.metadata.ros_distro or part.metadata.ros_distro

    def _add_problem(self, problem: str) -> None:
        if problem not in self.problems:
            self.problems.append(problem)

    def _find_files(self) -> list[Path]:
        kinds = ", ".join(SUFFIXES)
        if self.path.is_file():
            if not self.path.name.endswith(SUFFIXES):
                raise BagError(
                    f"{self.path}: not a bag, which is a folder or a file ending in {kinds}"
                )
            return [self.path]
        if not self.path.is_dir():
            raise BagError(f"{self.path}: there is no such bag")
        try:
            self.metadata = read_metadata(self.path)
        except BagError as error:
            self._add_problem(f"{error}; the files of the folder are read instead")
        if self.metadata.messages_compressed:
            return [self.path]
        present = {
            file.name: file
            for file in self.path.iterdir()
            if file.name.endswith(SUFFIXES) and file.is_file()
        }
        if not present:
            raise BagError(f"{self.path}: no bag in this folder (no file that ends in {kinds})")
        listed = []
        for name in dict.fromkeys(self.metadata.files):
            names = (
                name,
                name + COMPRESSED,
                name.removesuffix(COMPRESSED),
            )  # compressed or decompressed since
            stored = next(filter(present.get, names), None)
            if stored is not None:
                listed.append(stored)
            else:
                self._add_problem(f"{self.path}: {name} is missing")
        if not listed:  # there is no metadata.yaml, or the files have been renamed
            return [present[name] for name in sorted(present, key=_natural)]
        for name in sorted(present.keys() - {*listed}, key=_natural):
            self._add_problem(f"{self.path}: {name} is not in {METADATA_NAME} and left out")
        return [present[name] for name in listed]

    def _open_file(self, file: Path) -> McapFile | RosbagsFile:
        if file.is_file() and file.name.endswith((".mcap", f".mcap{COMPRESSED}")):
            part: McapFile | RosbagsFile = McapFile(file, self._add_problem)
        else:
            part = RosbagsFile(
                file, self._add_problem, self.metadata.storage if file.is_dir() else "sqlite3"
            )
        self._stack.callback(part.close)
        return part

    def files(self) -> list[Path]:
        """The files to read, including write-ahead logs of sqlite3."""
        logs = (path.with_name(f"{path.name}-wal") for path in self.storage_files())
        return [*self.storage_files(), *(log for log in logs if log.is_file())]

    def storage_files(self) -> list[Path]:
        """The storage files; those listed in the metadata if messages are compressed."""
        return (
            [self.path / name for name in self.metadata.files]
            if self.metadata.messages_compressed
            else self._paths
        )

    def records(
        self,
        topics: Collection[str] | None = None,
        start_ns: int = 0,
        stop_ns: int = FOREVER_NS,
        progress: Callable[[float], None] | None = None,
    ) -> Iterator[BagRecord]:
        """Messages in order of log time (within each file of a split bag).

        Only those of ``topics`` (default: all) with ``start_ns`` <= log time < ``stop_ns``.
        ``progress`` is called now and then with the fraction read, 0 to 1.
        """
        for position, part in enumerate(self._parts):
            for count, record in enumerate(part.records(topics, start_ns, stop_ns)):
                yield record
                if progress is not None and count % _PROGRESS_STEP == 0:
                    progress((position + part.fraction) / len(self._parts))
        if progress is not None:
            progress(1.0)

    def info(
        self,
        progress: Callable[[float], None] | None = None,
        note: Callable[[BagRecord], object] | None = None,
    ) -> BagInfo:
        """Count the messages of the bag, which is read once, and again for ``note``.

        ``progress`` is called now and then with the fraction read, 0 to 1, and ``note`` with every
        message.
        """
        if self._info is not None and note is None:
            return self._info
        counts: Counter[str] = Counter()
        start, end, unknown = FOREVER_NS, 0, 0
        for record in self.records(progress=progress):
            counts[record.topic] += 1
            if record.log_time_ns in UNKNOWN_NS:
                unknown += 1
            else:
                start, end = min(start, record.log_time_ns), max(end, record.log_time_ns)
            if note is not None:
                note(record)
        if unknown:
            self._add_problem(f"{self.path}: {unknown} messages have no receive time")
        self._info = BagInfo(dict(counts), start if end else 0, end)
        return self._info

    def topics(self) -> dict[str, RecordedTopic]:
        """Topics by name; the first description of a topic counts."""
        topics: dict[str, RecordedTopic] = {}
        for part in self._parts:
            for topic in part.topics():
                topics.setdefault(topic.name, topic)
        return topics

    def attachments(self) -> list[Attachment]:
        """Attached files; the first one of a name counts."""
        attachments: dict[str, Attachment] = {}
        for part in self._parts:
            for attachment in part.attachments:
                attachments.setdefault(attachment.name, attachment)
        return list(attachments.values())

    def close(self) -> None:
        """Close the files; reading is then no longer possible."""
        self._parts.clear()
        self._stack.close()

    def __enter__(self) -> BagReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _natural(name: str) -> list[tuple[int, str]]:
    """Sort key that puts ``bag_10`` after ``bag_9``."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]
