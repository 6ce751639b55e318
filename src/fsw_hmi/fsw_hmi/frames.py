"""Frames to the page as text: short numbers, NaN as null."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterable, Mapping
from math import isfinite
from typing import Any

from fsw_control.sensors import OPTIONAL, SENSORS
from fsw_control.units import NANOSECONDS

#: order of the values in a row
COLUMNS = (
    "time_s",
    "depth_mm",
    "temperature_c",
    "torque_nm",
    "force_kn",
    "speed_rpm",
    "power_kw",
    "reference_depth_mm",
    "reference_temperature_c",
    "command_force_kn",
    "command_speed_rpm",
    "latency_ms",
    "solve_ms",
    "angle_deg",
    *(SENSORS[name].signal for name in OPTIONAL),
)


def frame(kind: str, content: Mapping[str, Any]) -> str:
    """A frame as text; raises ValueError for a number that is not finite."""
    return json.dumps({"t": kind, **content}, separators=(",", ":"), allow_nan=False)


def row(stamp_ns: int, values: Iterable[float]) -> str:
    """A row of ticks: the time to the millisecond, the other values to five digits."""
    return f"[{stamp_ns / NANOSECONDS:.3f},{','.join(map(_number, values))}]"


def _number(value: float) -> str:
    return f"{value:.5g}" if isfinite(value) else "null"


def short(value: float) -> float | None:
    """Number with five digits; None for NaN."""
    return float(f"{value:.5g}") if isfinite(value) else None


#: seconds of the epoch from 2001 on, in a text
_EPOCH = re.compile(r"\b[1-9]\d{9}(?:\.\d+ s|\.\d+| s)\b")


def readable(text: str, longest: int = 200) -> str:
    """Text of another node for operators: short, printable, with clock times, °C for degC."""
    text = text.replace("degC", "°C")
    text = "".join(one if one.isprintable() else "?" for one in text[: 2 * longest])
    text = _EPOCH.sub(
        lambda found: time.strftime("%H:%M:%S UTC", time.gmtime(float(found[0].rstrip(" s")))),
        text,
    )
    return text if len(text) <= longest else f"{text[: longest - 1]}…"
