"""Stamps of a weld's messages, read from their bytes."""

from __future__ import annotations

import re
import struct

from fsw_control.sensors import SENSORS
from fsw_control.units import NANOSECONDS

_SENSORS = "|".join(row.topic for row in SENSORS.values())
_TICKING = re.compile(
    rf"(/.*)?/({_SENSORS}|fsw/(drives|command|plant/truth|[^/]+/(proposal|status|prediction)))"
)
#: end of a stamp in the message's bytes, including the encapsulation header
_STAMP_END = 12


def is_ticking(topic: str) -> bool:
    """Whether the topic has a message per tick of the weld, in any namespace."""
    return _TICKING.fullmatch(topic) is not None


def stamp_ns(data: bytes) -> int | None:
    """Stamp of a serialized message that begins with a header or a time; None if it has none.

    The stamp is the first field: ``int32`` seconds and ``uint32`` nanoseconds after the four
    bytes of the encapsulation header.
    """
    if len(data) < _STAMP_END or not data[1] & 1:  # big-endian is not decoded
        return None
    seconds, nanoseconds = struct.unpack_from("<iI", data, 4)
    return int(seconds) * NANOSECONDS + int(nanoseconds)
