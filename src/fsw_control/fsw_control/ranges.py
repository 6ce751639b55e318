"""Permitted ranges of set-points and manual commands, and set-points out of reach."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from fsw_control import weld
from fsw_control.coded import Fact, Worded, several
from fsw_control.contract import Reference
from fsw_control.schema.ranges import Range

#: set-points, chosen about the paper's operating point
REFERENCE_DEPTH_MM = Range(1.5, 4.0, "mm")
REFERENCE_TEMPERATURE_C = Range(750.0, 950.0, "degC")
#: the supervisor's low and high interlocks of the quantities with a set-point
SET_POINT_INTERLOCKS = {
    "depth_mm": ("depth_low", "depth_high"),
    "temperature_c": ("temperature_low", "temperature_high"),
}
#: largest rates of a ramp of the set-points, chosen
WELD_RATE_DEPTH_MM_PER_S, WELD_RATE_TEMPERATURE_C_PER_S = 0.02, 1.0
#: manual commands, up to the limits of the drives
COMMAND_FORCE_KN = Range(weld.FORCE_MIN_KN, weld.FORCE_MAX_KN, "kN")
COMMAND_SPEED_RPM = Range(weld.SPEED_MIN_RPM, weld.SPEED_MAX_RPM, "rpm")


class Forbidden(Worded):
    """Why set-points are not permitted."""

    OUT_OF_RANGE = "{quantity}: {value:g} is outside {low:g} to {high:g} {unit}"
    FALLING = "plan of set-points refused: their stamps do not rise"
    WOULD_TRIP = (
        "{quantity} {value:g} {unit} would trip the interlock: "
        "not {side} {trip:g} {unit}, nor at it"
    )


def set_point_problem(depth_mm: float, temperature_c: float) -> Fact | None:
    """Why set-points are not permitted; None if they are."""
    depth = "depth", depth_mm, REFERENCE_DEPTH_MM
    temperature = "temperature", temperature_c, REFERENCE_TEMPERATURE_C
    # rounded as in the conversion to SI
    return several(
        [
            Fact(Forbidden.OUT_OF_RANGE, {"quantity": name, "value": value, **asdict(allowed)})
            for name, value, allowed in (depth, temperature)
            if not allowed.low <= round(value, 9) <= allowed.high
        ]
    )


def beyond_trip(
    depth_mm: float, temperature_c: float, parameters: Mapping[str, Any]
) -> Fact | None:
    """Why set-points would trip an interlock; None if not, or if the trips are unknown.

    Parameters
    ----------
    depth_mm, temperature_c : float
    parameters : mapping of str to number
        Known parameters of the supervisor: ``interlocks.<name>.trip``.
    """
    values = {
        "depth_mm": ("depth", depth_mm, "mm"),
        "temperature_c": ("temperature", temperature_c, "°C"),
    }
    for quantity, interlocks in SET_POINT_INTERLOCKS.items():
        name, value, unit = values[quantity]
        for interlock, sign, side in zip(interlocks, (-1.0, 1.0), ("below", "above"), strict=True):
            trip = parameters.get(f"interlocks.{interlock}.trip")
            if trip is not None and sign * (value - trip) >= 0.0:
                data = {"quantity": name, "value": value, "unit": unit, "side": side, "trip": trip}
                return Fact(Forbidden.WOULD_TRIP, data)
    return None


#: differences below these values are within the noise of the estimates (chosen)
_NEAR_MM, _NEAR_C = 0.005, 0.5


def attainable_of(quantities: Mapping[str, float]) -> Reference | None:
    """Attainable set-points among a controller's quantities; None if it reports none."""
    values = [quantities.get(name) for name in ("attainable_depth_mm", "attainable_temperature_c")]
    return None if values[0] is None or values[1] is None else Reference(values[0], values[1])


class OutOfReach(Worded):
    """Set-points out of reach, and the active bound."""

    TEMPERATURE = "{asked_c:.0f} °C asked, {attainable_c:.0f} °C attainable"
    DEPTH = "{asked_mm:.2f} mm asked, {attainable_mm:.2f} mm attainable"
    UPPER = "upper_bound", "{parts}: speed at its upper bound"
    LOWER = "lower_bound", "{parts}: speed at its lower bound"


def out_of_reach(due: Reference, attainable: Reference) -> Fact | None:
    """How attainable set-points differ from those in force; None if they do not.

    Parameters
    ----------
    due, attainable : Reference
        The set-points in force, and those that the controller tracks instead.
    """
    depth_mm = attainable.depth_mm - due.depth_mm
    temperature_c = attainable.temperature_c - due.temperature_c
    parts = []
    if abs(temperature_c) > _NEAR_C:
        pair = {"asked_c": due.temperature_c, "attainable_c": attainable.temperature_c}
        parts.append(Fact(OutOfReach.TEMPERATURE, pair))
    if abs(depth_mm) > _NEAR_MM:
        pair = {"asked_mm": due.depth_mm, "attainable_mm": attainable.depth_mm}
        parts.append(Fact(OutOfReach.DEPTH, pair))
    if not parts:
        return None
    bound = OutOfReach.UPPER if wants_heat(due, attainable) else OutOfReach.LOWER
    return Fact.of(bound, parts=tuple(parts))


def wants_heat(due: Reference, attainable: Reference) -> bool:
    """Whether the set-points need more heat than the highest spindle speed can give."""
    return attainable.temperature_c < due.temperature_c or attainable.depth_mm > due.depth_mm
