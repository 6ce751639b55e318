"""One recorded message."""

from __future__ import annotations

from typing import NamedTuple


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
