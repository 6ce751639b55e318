"""One recorded message."""

from __future__ import annotations

from typing import NamedTuple


class BagRecord(NamedTuple):
    """One recorded message.

    `log_time_ns` is when it was received, `publish_time_ns` when it was published (the former, where the storage has
    only one). `data` is CDR with its header of four bytes. `sequence` is the publisher's, where known; else 0.
    """

    topic: str
    type_name: str
    log_time_ns: int
    publish_time_ns: int
    data: bytes
    sequence: int
