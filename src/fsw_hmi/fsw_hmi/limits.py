"""Limits and scales as the page draws them, and values and safe stops against them.

The page draws the result and judges nothing itself; ``fsw_analysis.judgement`` judges the weld as
a whole.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum
from math import isfinite, nan
from typing import Any, Literal, NamedTuple

import numpy as np

from fsw_analysis.kpi import DEAD_BAND_DEPTH_MM, DEAD_BAND_TEMPERATURE_C
from fsw_analysis.rule_book import Bounds, RuleBook
from fsw_analysis.weld_signals import FloatArray, TextArray
from fsw_control.ranges import (
    COMMAND_FORCE_KN,
    COMMAND_SPEED_RPM,
    REFERENCE_DEPTH_MM,
    REFERENCE_TEMPERATURE_C,
    SET_POINT_INTERLOCKS,
    WELD_RATE_DEPTH_MM_PER_S,
    WELD_RATE_TEMPERATURE_C_PER_S,
)
from fsw_control.schema.ranges import Range
from fsw_control.sensors import SENSORS

#: a violation, as the page gets it
Flag = dict[str, Any]
Kind = Literal["trip", "essential", "warn", "quality", "error", "deviation"]
#: by kind: level and words
_WORDS: dict[Kind, tuple[str, str]] = {
    "trip": ("high", "beyond trip"),
    "essential": ("high", "beyond its essential limit"),
    "warn": ("medium", "warning"),
    "quality": ("medium", "off quality"),
    "error": ("medium", "off its set-point"),
    "deviation": ("medium", "off its command"),
}


class _Quantity(NamedTuple):
    """What the page draws as a bar."""

    scale: Range
    interlocks: tuple[str, str] = ("", "")  #: the supervisor's below and above
    dead_band: float | None = None
    #: variable of the rule book that is the distance from the programme's set-point
    error: str = ""
    deviation: float | None = None  #: of a drive from its command without an alarm (chosen)


#: scales of torque and power, chosen
_QUANTITIES = {
    "depth_mm": _Quantity(
        *(REFERENCE_DEPTH_MM, SET_POINT_INTERLOCKS["depth_mm"]),
        *(DEAD_BAND_DEPTH_MM, "depth_error_mm"),
    ),
    "temperature_c": _Quantity(
        *(REFERENCE_TEMPERATURE_C, SET_POINT_INTERLOCKS["temperature_c"]),
        *(DEAD_BAND_TEMPERATURE_C, "temperature_error_c"),
    ),
    "force_kn": _Quantity(COMMAND_FORCE_KN, ("", "force_high"), deviation=5.0),
    "speed_rpm": _Quantity(COMMAND_SPEED_RPM, deviation=20.0),
    "torque_nm": _Quantity(Range(300.0, 1700.0, "N m"), ("torque_low", "torque_high")),
    "power_kw": _Quantity(Range(20.0, 70.0, "kW"), ("", "power_high")),
}
#: variable of each quantity that has a set-point
ERRORS = {name: row.error for name, row in _QUANTITIES.items() if row.error}
_LEVELS = ("warn", "trip")
_SEVERITY: tuple[tuple[Kind, Kind], ...] = (("trip", "essential"), ("warn", "quality"))
#: smallest steps in which set-points are typed in, chosen
_STEPS = {"depth_mm": 0.01, "temperature_c": 0.1}
_NAMES = [name for row in _QUANTITIES.values() for name in row.interlocks if name]
_SAFE = ("safe_force_kn", "safe_rate_kn_per_s")
#: the supervisor's parameters that are used
PARAMETERS = (*(f"interlocks.{name}.{level}" for name in _NAMES for level in _LEVELS), *_SAFE)


def _interlocks(quantity: str, level: str, parameters: Mapping[str, Any]) -> list[float | None]:
    """Limits of the interlocks below and above a quantity; None: unknown, or no interlock."""
    names = _QUANTITIES[quantity].interlocks
    return [parameters.get(f"interlocks.{name}.{level}") for name in names]


def limits(parameters: Mapping[str, Any], book: RuleBook) -> dict[str, dict[str, Any]]:
    """Limits of every quantity for the page, in its protocol's words.

    ``parameters`` are the supervisor's, as far as they are known: ``interlocks.<name>.warn`` and
    ``.trip``; ``book`` is the rule book by which the weld is judged.
    """
    by_quantity: dict[str, dict[str, Any]] = {}
    for quantity, row in _QUANTITIES.items():
        own: dict[str, Any] = {
            level: _interlocks(quantity, level, parameters) for level in _LEVELS
        }
        own["kept"] = [
            {"low": limit.min, "high": limit.max, "of_aim": limit.variable != quantity}
            for _, limit in book.limits()
            if limit.variable in (quantity, row.error)
        ]
        own["others"] = [
            {"key": sensor.signal, "name": sensor.title}
            for sensor in SENSORS.values()
            if sensor.quantity.signal == quantity and not sensor.required
        ]
        own["deviation"] = row.deviation
        known = {key: value for key, value in own.items() if value not in (None, [], [None, None])}
        fixed = {"range": [row.scale.low, row.scale.high], "dead_band": row.dead_band}
        by_quantity[quantity] = fixed | known
    return by_quantity


def safe_state(parameters: Mapping[str, Any]) -> dict[str, float] | None:
    """Target and rate of a safe stop; None until the supervisor has reported them."""
    known = {name.removeprefix("safe_"): parameters[name] for name in _SAFE if name in parameters}
    return known if len(known) == len(_SAFE) else None


def reference(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Permitted set-points, as far as trips are known; ``parameters`` as in :func:`limits`."""
    permitted: dict[str, Any] = {
        "rate_depth_mm_per_s": WELD_RATE_DEPTH_MM_PER_S,
        "rate_temperature_c_per_s": WELD_RATE_TEMPERATURE_C_PER_S,
    }
    for quantity, step in _STEPS.items():
        allowed = _QUANTITIES[quantity].scale
        under, over = _interlocks(quantity, "trip", parameters)
        permitted[quantity] = [
            allowed.low if under is None else max(allowed.low, round(under + step, 6)),
            allowed.high if over is None else min(allowed.high, round(over - step, 6)),
        ]
    return permitted


def variables(
    values: Mapping[str, float], progress: Mapping[str, Any] | None = None
) -> dict[str, float]:
    """Values of a row, and errors from the programme's set-points or else those in force."""
    own = programme_aims(progress)
    every = dict(values)
    for quantity, error in ERRORS.items():
        aim = own.get(quantity, values.get(f"reference_{quantity}", nan))
        every[error] = values.get(quantity, nan) - aim
    return every


def programme_aims(progress: Mapping[str, Any] | None) -> dict[str, float]:
    """Set-points of depth and temperature that the programme reports; none at depth 0."""
    if not progress or not progress.get("depth_mm"):
        return {}
    aims = {name: progress.get(name) for name in ERRORS}
    return {name: float(aim) for name, aim in aims.items() if aim is not None}


def worst(violations: Mapping[str, Sequence[Flag]]) -> dict[str, Flag]:
    """Of each quantity, the worst of its violations as of :func:`outside_now`."""
    return {quantity: flags_of[0] for quantity, flags_of in violations.items()}


def flags(
    columns: Mapping[str, FloatArray],
    phases: TextArray,
    book: RuleBook,
    limits: Mapping[str, Mapping[str, Any]],
) -> list[dict[str, Flag]]:
    """As :func:`outside`, of each quantity the worst."""
    return [worst(row) for row in outside(columns, phases, book, limits)]


def outside(
    columns: Mapping[str, FloatArray],
    phases: TextArray,
    book: RuleBook,
    limits: Mapping[str, Mapping[str, Any]],
) -> list[dict[str, list[Flag]]]:
    """Violations of each quantity at each moment, the worst first: level, words, and the limit.

    Empty if none.

    Parameters
    ----------
    columns : mapping of str to array
        As of :func:`variables`, and the commands.
    phases : array of str
        Of the programme; empty where it is not known.
    book : RuleBook
        By which the weld is judged.
    limits : mapping
        As of :func:`limits`.
    """
    flags_of_row: list[dict[str, list[Flag]]] = [{} for _ in range(phases.size)]
    for quantity in _QUANTITIES:
        for kind, bounds in _tests(quantity, book, limits.get(quantity, {})):
            values = columns.get(bounds.variable)
            if kind == "deviation":
                values = columns[quantity] - columns[f"command_{quantity}"]
            if values is None:
                continue
            known = np.isin(phases.astype(str), [*bounds.phases, ""]) | (not bounds.phases)
            level, words = _WORDS[kind]
            limit = {
                "kind": kind,
                "variable": bounds.variable,
                "min": bounds.min,
                "max": bounds.max,
            }
            for side, violated in (
                ("low", False if bounds.min is None else values < bounds.min),
                ("high", False if bounds.max is None else values > bounds.max),
            ):
                flag = {"level": level, "text": f"{words}, {side}", **limit}
                for row in np.flatnonzero(known & violated):
                    flags_of_row[row].setdefault(quantity, []).append(flag)
    return flags_of_row


def outside_now(
    values: Mapping[str, float],
    progress: Mapping[str, Any] | None,
    book: RuleBook,
    limits: Mapping[str, Mapping[str, Any]],
) -> dict[str, list[Flag]]:
    """As :func:`outside`, of one row."""
    columns = {name: np.array([value]) for name, value in variables(values, progress).items()}
    phase = str((progress or {}).get("phase", ""))
    return outside(columns, np.array([phase], object), book, limits)[0]


def _tests(quantity: str, book: RuleBook, own: Mapping[str, Any]) -> Iterator[tuple[Kind, Bounds]]:
    """Bounds of a quantity, in order of severity."""
    error = _QUANTITIES[quantity].error
    for level, kind in _SEVERITY:
        if level in own:
            low, high = own[level]
            yield level, Bounds(variable=quantity, min=low, max=high)
        for kind_of, limit in book.limits():
            if kind_of == kind and limit.variable in (quantity, error):
                yield "error" if kind == "quality" and limit.variable == error else kind, limit
    if "deviation" in own:
        most = own["deviation"]
        yield "deviation", Bounds(variable=quantity, min=-most, max=most)


#: tolerated lag of the force behind its ramp [s], and distance from it [kN] (chosen)
_LATE_S = 2.0
_NEAR_KN = 1.0


class StopKind(StrEnum):
    """State of a safe stop."""

    FALLING = "falling"
    SAFE = "safe"
    NOT_FALLING = "not_falling"
    UNKNOWN = "unknown"  # neither ramp nor force can be compared


class StopProgress:
    """Follows one safe stop after the other, tick by tick."""

    def __init__(self) -> None:
        self._began: tuple[float, float] | None = None  # time and force

    def at(
        self, stopped: bool, values: Mapping[str, float], safe: Mapping[str, float] | None
    ) -> dict[str, Any] | None:
        """State at a tick, ready for JSON; None without a safe stop.

        Parameters
        ----------
        stopped : bool
            Whether the supervisor reports a safe stop.
        values : mapping of str to float
            Of the tick, with ``time_s`` and ``force_kn``.
        safe : mapping of str to float or None
            ``force_kn`` at which the ramp ends and its ``rate_kn_per_s``; None while they are not
            known.
        """
        time_s, force_kn = values.get("time_s", nan), values.get("force_kn", nan)
        measured = isfinite(time_s) and isfinite(force_kn)
        if not stopped:
            self._began = None
        elif measured and self._began is None:
            self._began = time_s, force_kn
        if self._began is None:
            return None
        if safe is None or not measured:
            return {"kind": StopKind.UNKNOWN}
        began_s, began_kn = self._began
        end_kn, rate = safe["force_kn"], safe["rate_kn_per_s"]
        due_kn = max(end_kn, began_kn - rate * max(0.0, time_s - began_s - _LATE_S)) + _NEAR_KN
        kind = StopKind.NOT_FALLING if force_kn > due_kn else StopKind.FALLING
        return {
            "kind": StopKind.SAFE if force_kn <= end_kn + _NEAR_KN else kind,
            "share": round(
                min(1.0, max(0.0, (began_kn - force_kn) / max(began_kn - end_kn, _NEAR_KN))), 4
            ),
            "safe_kn": end_kn,
            "due_kn": round(due_kn, 3),
            "left_s": round(max(0.0, (force_kn - end_kn) / rate), 1),
        }
