"""What a bag writer is told and what it tells: topics, options, counters."""

from __future__ import annotations

from dataclasses import dataclass

from fsw_recorder.bag_metadata import OfferedQos


@dataclass(frozen=True, slots=True)
class RecordedTopic:
    """What a bag says of a topic.

    Attributes
    ----------
    name, type_name : str
        E.g. ``/fsw/depth`` and ``fsw_msgs/msg/ShoulderDepth``.
    definition : str
        ``ros2msg`` text with all nested definitions; empty when unknown.
    type_hash : str
        ``RIHS01_...``; empty when unknown.
    qos : tuple[OfferedQos, ...]
        Of the publishers.
    encoding, definition_encoding : str
        Of messages and definition; anything but the defaults only for copies of foreign bags.
    """

    name: str
    type_name: str
    definition: str = ""
    type_hash: str = ""
    qos: tuple[OfferedQos, ...] = (OfferedQos(),)
    encoding: str = "cdr"
    definition_encoding: str = "ros2msg"


@dataclass(frozen=True, slots=True)
class WriterOptions:
    """How a bag is written.

    Attributes
    ----------
    compression : str
        Of chunks: empty or ``zstd``.
    max_file_bytes : int
        A new file is begun beyond this size; 0: never.
    max_file_s : float
        A new file is begun when a message is this much younger than the file's first [s]; 0: never.
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
        Messages handed in while not paused, messages in files, messages that were not taken because memory was full
        or writing had failed.
    bytes : int
        Size of all files.
    pending_bytes : int
        Waiting to be written.
    files : int
        Begun so far.
    longest_write_s : float
        Longest time that handing a chunk over or syncing took [s].
    """

    received: int = 0
    written: int = 0
    dropped: int = 0
    bytes: int = 0
    pending_bytes: int = 0
    files: int = 0
    longest_write_s: float = 0.0
