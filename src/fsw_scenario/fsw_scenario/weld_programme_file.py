"""Results of the phases of a whole weld: durations, and set-points over time.

All errors are for a validator of the scenario and give the place in its ``phases``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import sqrt

from fsw_control.contract import Reference
from fsw_control.ranges import WELD_RATE_DEPTH_MM_PER_S, WELD_RATE_TEMPERATURE_C_PER_S
from fsw_control.schema.models import problem
from fsw_control.schema.ranges import Range
from fsw_plant.tool_path import Waypoint
from fsw_scenario.weld_programme import (
    ANGLE_DEG,
    LENGTH_MM,
    MM_PER_DEG,
    PHASES,
    Phase,
    PhaseSetPoint,
)

#: unit, largest step (chosen) and largest rate of the set-points
LIMITS = {
    "depth_mm": ("mm", 0.2, WELD_RATE_DEPTH_MM_PER_S),
    "temperature_c": ("degC", 10.0, WELD_RATE_TEMPERATURE_C_PER_S),
}


def joined(entries: Sequence[Phase]) -> tuple[Phase, ...]:
    """The phases in sequence, with all omitted values filled in."""
    if not entries:
        raise problem(f"is empty; some of {', '.join(PHASES)}", "phases")
    phases: list[Phase] = []
    for i, entry in enumerate(entries):
        at = ("phases", i)
        if phases and PHASES.index(entry.name) <= PHASES.index(phases[-1].name):
            raise problem(
                f"{entry.name} cannot follow {phases[-1].name}; the order is {', '.join(PHASES)}",
                *at,
            )
        here_deg = phases[-1].to_deg if phases else 0.0
        keys = entry.model_fields_set
        if "to_deg" not in keys:
            phases.append(entry.model_copy(update={"from_deg": here_deg, "to_deg": here_deg}))
            continue
        if "from_deg" in keys and entry.from_deg != here_deg:
            raise problem(
                f"= {entry.from_deg:g} jumps: the previous phase ends at {here_deg:g} deg",
                *at,
                "from_deg",
            )
        _check(entry.to_deg, Range(here_deg, ANGLE_DEG.high, "deg"), *at, "to_deg")
        arc_mm = (entry.to_deg - here_deg) * MM_PER_DEG
        length_mm = entry.length_mm if "length_mm" in keys else arc_mm
        _check(length_mm, Range(arc_mm, LENGTH_MM.high, "mm"), *at, "length_mm")
        if length_mm <= 0.0:
            raise problem(
                "has a path without length; give duration_s for a phase without travel", *at
            )
        duration_s = length_mm / entry.speed_mm_per_min * 60.0
        complete = {"from_deg": here_deg, "length_mm": length_mm, "duration_s": duration_s}
        phases.append(entry.model_copy(update=complete))
    return tuple(phases)


def tool_path(phases: Sequence[Phase]) -> tuple[Waypoint, ...]:
    """Positions of the tool at the ends of the phases.

    If the path of ``downward`` or ``parking`` is longer than its arc, the excess leads down to the
    joint line or up.
    """
    climb = {"downward": -1.0, "parking": 1.0}
    points, time_s, arc_mm, axial_mm = [(0.0, 0.0, 0.0)], 0.0, 0.0, 0.0
    line_mm = 0.0  # the joint line, seen from the start
    for phase in phases:
        arc = (phase.to_deg - phase.from_deg) * MM_PER_DEG
        time_s, arc_mm = time_s + phase.duration_s, arc_mm + arc
        axial_mm += climb.get(phase.name, 0.0) * sqrt(max(phase.length_mm**2 - arc**2, 0.0))
        line_mm = axial_mm if phase.name == "downward" else line_mm
        points.append((time_s, arc_mm, axial_mm))
    # rounded, as in the text of the scenario
    return tuple(
        Waypoint(at_s=round(at_s, 3), arc_mm=round(arc, 3), axial_mm=round(axial - line_mm, 3))
        for at_s, arc, axial in points
    )


def set_points(phases: Sequence[Phase], start: Reference) -> Iterator[tuple[float, PhaseSetPoint]]:
    """Set-points of phases with times from the weld's start; ``start`` precedes the first."""
    present = {name: getattr(start, name) for name in LIMITS}
    begin_s = 0.0
    for i, phase in enumerate(phases):
        free_s = 0.0
        for k, point in enumerate(phase.set_points):
            at = ("phases", i, "set_points", k)
            left_s = phase.duration_s - point.at_s
            _check(
                point.at_s,
                Range(0.0, phase.duration_s, f"s, the duration of {phase.name}"),
                *at,
                "at_s",
            )
            _check(point.over_s, Range(0.0, left_s, "s, the rest of the phase"), *at, "over_s")
            if point.at_s < free_s:
                raise problem(
                    f"= {point.at_s:g} is before the end of the previous set-point, {free_s:g} s",
                    *at,
                    "at_s",
                )
            free_s = point.at_s + point.over_s
            for name, (unit, step, rate) in LIMITS.items():
                value = getattr(point, name)
                if value is None:
                    continue
                change, allowed = abs(value - present[name]), max(step, rate * point.over_s)
                if change > allowed + 1e-9:
                    text = f"= {value:g} jumps by {change:g} {unit}, more than {allowed:g}"
                    raise problem(f"{text}; give over_s: {change / rate:g} or more", *at, name)
                present[name] = value
            yield begin_s + point.at_s, point
        begin_s += phase.duration_s


def _check(value: float, allowed: Range, *path: str | int) -> None:
    if complaint := allowed.complaint(value):
        raise problem(f"= {complaint}", *path)
