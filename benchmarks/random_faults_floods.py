"""Nonsense that a stranger on the network may send."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, nan
from typing import Any

from fsw_control import messages_ros as convert
from fsw_control.units import NANOSECONDS
from fsw_msgs.msg import ShoulderDepth, WeldCommand, WeldReference

#: marks what the benchmark itself must not take for the weld's
SOURCE = "flood"
_BAD = (nan, inf, -1e300, 1e12, 0.0, -5.0, 78.4e3, 42.0)
_OFFSETS_S = (0, 3600, -3600, 10**6)


def nonsense(newest_ns: int) -> dict[str, tuple[Any, str, Callable[[int], Any]]]:
    """By name, type and topic, and what makes message number k.

    ``newest_ns`` is the stamp of the newest tick.
    """

    def stamped(message: Any, number: int) -> Any:
        stamp_ns = newest_ns + _OFFSETS_S[number % 4] * NANOSECONDS
        message.header.stamp = convert.stamp_from_ns(max(0, stamp_ns))
        message.header.frame_id = SOURCE
        return message

    def commanded(number: int) -> WeldCommand:
        force_n, speed_rad_s = _BAD[number % 8], _BAD[(number // 8) % 8]
        message = WeldCommand(
            axial_force=force_n, spindle_speed=speed_rad_s, source=SOURCE, healthy=True
        )
        return stamped(message, number)

    def measured(number: int) -> ShoulderDepth:
        return stamped(ShoulderDepth(depth=_BAD[number % 8]), 1 + number % 3)

    def referred(number: int) -> WeldReference:
        return WeldReference(depth=_BAD[number % 8], temperature=_BAD[(number // 8) % 8])

    return {
        "depth": (ShoulderDepth, "fsw/depth", measured),
        "proposal": (WeldCommand, "fsw/nmpc/proposal", commanded),
        "command": (WeldCommand, "fsw/command", commanded),
        "reference": (WeldReference, "fsw/reference", referred),
    }
