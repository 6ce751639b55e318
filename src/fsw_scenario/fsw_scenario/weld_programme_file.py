"""The phases of a whole weld in a scenario file, and what they amount to: durations, and set-points over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Self

from pydantic import model_validator

from fsw_control.contract import Reference
from fsw_control.ranges import WELD_RATE_DEPTH_MM_PER_S, WELD_RATE_TEMPERATURE_C_PER_S, Range
from fsw_control.schema import Many, Model, problem
from fsw_plant.event_schema import DURATION_S, TIME_S
from fsw_scenario.scenario import ANGLE_DEG, SetPointEntry
from fsw_scenario.weld_programme import MM_PER_DEG, PHASES, TRAVERSE_MM_PER_MIN, Phase, PhaseName

_LENGTH_MM = Range(0.0, 10_000.0, "mm")
#: unit, largest step (chosen) and largest rate of the set-points
LIMITS = {
    "depth_mm": ("mm", 0.2, WELD_RATE_DEPTH_MM_PER_S),
    "temperature_c": ("degC", 10.0, WELD_RATE_TEMPERATURE_C_PER_S),
}


class PhaseSetPoint(SetPointEntry):
    """New set-points in a phase; one left out stays."""

    at_s: Annotated[float, TIME_S] = 0.0
    """time from the phase's beginning"""


class PhaseEntry(Model):
    """A part of the weld: with travel from an angle of the path to another, or of a duration."""

    name: PhaseName
    """in this order; one may be left out"""
    duration_s: Annotated[float, DURATION_S] | None = None
    """of a phase without travel"""
    to_deg: Annotated[float, ANGLE_DEG] | None = None
    """of one with travel: where it ends"""
    from_deg: Annotated[float, ANGLE_DEG] | None = None
    """where the phase before ends, which is the default"""
    length_mm: Annotated[float, _LENGTH_MM] | None = None
    """of the path; default: the arc on the canister, and not less"""
    speed_mm_per_min: Annotated[float, Range(10.0, 300.0, "mm/min")] = TRAVERSE_MM_PER_MIN
    set_points: Many[PhaseSetPoint] = ()

    @model_validator(mode="after")
    def _check_travel(self) -> Self:
        moving = [key for key in ("from_deg", "length_mm", "speed_mm_per_min") if key in self.model_fields_set]
        if self.to_deg is None and moving:
            raise ValueError(f"has {', '.join(moving)} but no to_deg")
        if self.to_deg is None and self.duration_s is None:
            raise ValueError("lacks duration_s (without travel) or to_deg")
        if self.to_deg is not None and self.duration_s is not None:
            raise ValueError("has duration_s and to_deg; the duration of a path follows from its speed")
        return self


def phases_of(entries: Sequence[PhaseEntry]) -> tuple[Phase, ...]:
    """The phases one after the other; for a validator, whose error says at which of ``phases`` something is wrong."""
    phases: list[Phase] = []
    for i, entry in enumerate(entries):
        at = ("phases", i)
        if phases and PHASES.index(entry.name) <= PHASES.index(phases[-1].name):
            raise problem(f"{entry.name} cannot follow {phases[-1].name}; the order is {', '.join(PHASES)}", *at)
        here_deg = phases[-1].to_deg if phases else 0.0
        if entry.to_deg is None:
            phases.append(Phase(entry.name, entry.duration_s or 0.0, here_deg, here_deg))
            continue
        if entry.from_deg not in (None, here_deg):
            raise problem(f"= {entry.from_deg:g} jumps: the phase before ends at {here_deg:g} deg", *at, "from_deg")
        _check(entry.to_deg, Range(here_deg, ANGLE_DEG.high, "deg"), *at, "to_deg")
        arc_mm = (entry.to_deg - here_deg) * MM_PER_DEG
        length_mm = arc_mm if entry.length_mm is None else entry.length_mm
        _check(length_mm, Range(arc_mm, _LENGTH_MM.high, "mm"), *at, "length_mm")
        if length_mm <= 0.0:
            raise problem("has a path without length; give duration_s for a phase without travel", *at)
        duration_s = length_mm / entry.speed_mm_per_min * 60.0
        phases.append(Phase(entry.name, duration_s, here_deg, entry.to_deg, length_mm))
    return tuple(phases)


def set_points_of(
    entries: Sequence[PhaseEntry], phases: Sequence[Phase], start: Reference
) -> list[tuple[float, PhaseSetPoint]]:
    """The set-points of phases with their times from the weld's begin; ``start`` is in force before the first."""
    found: list[tuple[float, PhaseSetPoint]] = []
    present = {name: getattr(start, name) for name in LIMITS}
    begin_s = 0.0
    for i, (entry, phase) in enumerate(zip(entries, phases, strict=True)):
        free_s = 0.0
        for k, one in enumerate(entry.set_points):
            at = ("phases", i, "set_points", k)
            left_s = phase.duration_s - one.at_s
            _check(one.at_s, Range(0.0, phase.duration_s, f"s, the duration of {phase.name}"), *at, "at_s")
            _check(one.over_s, Range(0.0, left_s, "s, what is left of the phase"), *at, "over_s")
            if one.at_s < free_s:
                raise problem(f"= {one.at_s:g} is before the end of the set-point before it, {free_s:g} s", *at, "at_s")
            free_s = one.at_s + one.over_s
            for name, (unit, step, rate) in LIMITS.items():
                value = getattr(one, name)
                if value is None:
                    continue
                change, allowed = abs(value - present[name]), max(step, rate * one.over_s)
                if change > allowed + 1e-9:
                    text = f"= {value:g} jumps by {change:g} {unit}, more than {allowed:g}"
                    raise problem(f"{text}; give over_s: {change / rate:g} or more", *at, name)
                present[name] = value
            found.append((begin_s + one.at_s, one))
        begin_s += phase.duration_s
    return found


def _check(value: float, allowed: Range, *path: str | int) -> None:
    if complaint := allowed.complaint(value):
        raise problem(f"= {complaint}", *path)
