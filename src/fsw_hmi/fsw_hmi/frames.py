"""Frames to the page as text: short numbers, NaN as null; the known heat as a band."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterable, Mapping
from math import isfinite
from typing import Any

import numpy as np

from fsw_control.heat_plan import HeatPlan
from fsw_control.sensors import OPTIONAL, SENSORS
from fsw_control.units import NANOSECONDS
from fsw_model.heat_profile import CORRELATION_MM

#: order of the values in a row
COLUMNS = (
    *("time_s", "depth_mm", "temperature_c", "torque_nm", "force_kn", "speed_rpm", "power_kw"),
    *("reference_depth_mm", "reference_temperature_c", "command_force_kn", "command_speed_rpm"),
    *("latency_ms", "solve_ms", "angle_deg", *(SENSORS[name].signal for name in OPTIONAL)),
)

_SAME = ("depth_mm", "torque_nm", "temperature_c", "angle_deg")
#: by column: the signal of a weld (``fsw_analysis.weld_signals``)
SIGNALS = {name: name for name in (*_SAME, "reference_depth_mm", "reference_temperature_c")}
SIGNALS |= {"command_force_kn": "force_kn", "command_speed_rpm": "speed_rpm"}

#: distance of two places of the band (chosen: finer than what the heat is known for)
_STEP_DEG = 2.0
#: content of the frame without known heat
NO_HEAT: dict[str, Any] = {"type": "", "angle_deg": [], "heat_kw": [], "deviation_kw": []}


def heat_band(plan: HeatPlan | None) -> dict[str, Any]:
    """Heat and its standard deviation by angle; a plan that controllers refuse has none.

    What the plan lacks forgets over the correlation length, so that within it the variance of its
    change grows by twice its square.
    """
    if plan is None or plan.problem or not plan.angle_deg[-1] > plan.angle_deg[0]:
        return NO_HEAT
    turned_deg = np.maximum.accumulate(plan.angle_deg)
    angle_deg = np.arange(turned_deg[0], turned_deg[-1] + 1e-9, _STEP_DEG)
    travel_mm = np.interp(angle_deg, turned_deg, plan.travel_mm)
    half_mm = 0.5 * CORRELATION_MM
    low_mm = np.maximum(travel_mm - half_mm, plan.travel_mm[0])
    high_mm = np.minimum(travel_mm + half_mm, plan.travel_mm[-1])
    low, high = (np.interp(at, plan.travel_mm, plan.variance_kw2) for at in (low_mm, high_mm))
    per_mm = (high - low) / np.maximum(high_mm - low_mm, 1e-9)
    return {
        "type": readable(plan.type, 100),
        "angle_deg": [short(value) for value in angle_deg.tolist()],
        "heat_kw": [short(kw) for kw in np.interp(angle_deg, turned_deg, plan.heat_kw).tolist()],
        "deviation_kw": [short(value) for value in np.sqrt(per_mm * half_mm).tolist()],
    }


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
    text = "".join(letter if letter.isprintable() else "?" for letter in text[: 2 * longest])
    text = _EPOCH.sub(
        lambda match: time.strftime("%H:%M:%S UTC", time.gmtime(float(match[0].rstrip(" s")))),
        text,
    )
    return text if len(text) <= longest else f"{text[: longest - 1]}…"
