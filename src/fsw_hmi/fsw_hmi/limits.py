"""Limits and scales as the page draws them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fsw_analysis.kpi import DEAD_BAND_DEPTH_MM, DEAD_BAND_TEMPERATURE_C
from fsw_analysis.rule_book import RuleBook
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
from fsw_hmi.standing import QUANTITIES

#: scales, chosen
_TORQUE_NM, _POWER_KW = Range(300.0, 1700.0, "N m"), Range(20.0, 70.0, "kW")
#: by quantity: scale, dead band, and the supervisor's interlocks below and above
_QUANTITIES: dict[str, tuple[Range, float | None, str, str]] = {
    "depth_mm": (REFERENCE_DEPTH_MM, DEAD_BAND_DEPTH_MM, *SET_POINT_INTERLOCKS["depth_mm"]),
    "temperature_c": (
        *(REFERENCE_TEMPERATURE_C, DEAD_BAND_TEMPERATURE_C),
        *SET_POINT_INTERLOCKS["temperature_c"],
    ),
    "force_kn": (COMMAND_FORCE_KN, None, "", "force_high"),
    "speed_rpm": (COMMAND_SPEED_RPM, None, "", ""),
    "torque_nm": (_TORQUE_NM, None, "torque_low", "torque_high"),
    "power_kw": (_POWER_KW, None, "", "power_high"),
}
_LEVELS = ("warn", "trip")
#: smallest steps in which set-points are typed in, chosen
_STEPS = {"depth_mm": 0.01, "temperature_c": 0.1}
_NAMES = [name for entry in _QUANTITIES.values() for name in entry[2:] if name]
_SAFE = ("safe_force_kn", "safe_rate_kn_per_s")
#: the supervisor's parameters that are used
PARAMETERS = (*(f"interlocks.{name}.{level}" for name in _NAMES for level in _LEVELS), *_SAFE)


#: the page's parameters for the tolerated deviation of a drive from its command
DEVIATIONS = tuple(f"deviation_{quantity}" for quantity in ("force_kn", "speed_rpm"))


def _interlocks(quantity: str, level: str, parameters: Mapping[str, Any]) -> list[float | None]:
    """Limits of the interlocks below and above a quantity; None: unknown, or no interlock."""
    return [parameters.get(f"interlocks.{name}.{level}") for name in _QUANTITIES[quantity][2:]]


def limits(
    parameters: Mapping[str, Any], book: RuleBook, deviations: Mapping[str, float] | None = None
) -> dict[str, dict[str, Any]]:
    """Limits of every quantity for the page, in its protocol's words.

    ``parameters`` are the supervisor's, as far as they are known: ``interlocks.<name>.warn`` and
    ``.trip``; ``book`` is the rule book by which the weld is judged, and ``deviations`` go by the
    names in ``DEVIATIONS``.
    """
    by_quantity: dict[str, dict[str, Any]] = {}
    for quantity, (scale, dead_band, *_) in _QUANTITIES.items():
        by_quantity[quantity] = {"range": [scale.low, scale.high], "dead_band": dead_band}
        for level in _LEVELS:
            pair = _interlocks(quantity, level, parameters)
            if pair != [None, None]:
                by_quantity[quantity][level] = pair
        if deviations is not None and f"deviation_{quantity}" in deviations:
            by_quantity[quantity]["deviation"] = deviations[f"deviation_{quantity}"]
        kept = [
            {"low": limit.min, "high": limit.max, "of_aim": limit.variable != quantity}
            for _, limit in book.limits()
            if limit.variable in (quantity, QUANTITIES[quantity])
        ]
        if kept:
            by_quantity[quantity]["kept"] = kept
        rows = (row for row in SENSORS.values() if row.quantity.signal == quantity)
        others = [{"key": row.signal, "name": row.title} for row in rows if not row.required]
        if others:
            by_quantity[quantity]["others"] = others
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
        allowed = _QUANTITIES[quantity][0]
        under, over = _interlocks(quantity, "trip", parameters)
        permitted[quantity] = [
            allowed.low if under is None else max(allowed.low, round(under + step, 6)),
            allowed.high if over is None else min(allowed.high, round(over - step, 6)),
        ]
    return permitted
