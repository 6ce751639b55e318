"""Set-points out of reach: what a controller tracks instead, and how that is reported."""

from __future__ import annotations

from collections.abc import Mapping

from fsw_control.coded import Fact, Worded
from fsw_control.contract import Reference

#: differences below these values are within the noise of the estimates (chosen)
_NEAR_MM, _NEAR_C = 0.005, 0.5


def attainable_of(quantities: Mapping[str, float]) -> Reference | None:
    """Attainable set-points among a controller's quantities; None if it reports none."""
    values = [quantities.get(name) for name in ("attainable_depth_mm", "attainable_temperature_c")]
    return None if values[0] is None or values[1] is None else Reference(values[0], values[1])


class OutOfReach(Worded):
    """Set-points out of reach, and the active bound."""

    TEMPERATURE = "temperature", "{asked_c:.0f} °C asked, {attainable_c:.0f} °C attainable"
    DEPTH = "depth", "{asked_mm:.2f} mm asked, {attainable_mm:.2f} mm attainable"
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
