"""Reads the phases of a whole weld from a scenario and checks every entry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fsw_control import weld
from fsw_plant.event_schema import Place
from fsw_scenario import ranges
from fsw_scenario.ranges import Range
from fsw_scenario.scenario import ReferenceEvent
from fsw_scenario.weld_programme import MM_PER_DEG, PHASES, TRAVERSE_MM_PER_MIN, Phase, time_at

_PATH_KEYS = ("from_deg", "to_deg", "length_mm", "speed_mm_per_min")
_LIMITS = {
    "depth_mm": ("mm", ranges.WELD_STEP_DEPTH_MM, ranges.WELD_RATE_DEPTH_MM_PER_S),
    "temperature_c": ("degC", ranges.WELD_STEP_TEMPERATURE_C, ranges.WELD_RATE_TEMPERATURE_C_PER_S),
}


def read_phases(
    at: Place, content: Mapping[str, Any], plant: Mapping[str, Any]
) -> tuple[tuple[Phase, ...], tuple[ReferenceEvent, ...]]:
    """Phases of a scenario and their set-points, with times from the weld's begin.

    ``plant`` has the plant's parameters that differ from their defaults, for the set-points at the start.
    """
    phases: list[Phase] = []
    events: list[ReferenceEvent] = []
    present = {
        "depth_mm": float(plant.get("start.depth_mm", weld.DEPTH_MM)),
        "temperature_c": float(plant.get("start.temperature_c", weld.TEMPERATURE_C)),
    }
    begin_s = 0.0
    for i, entry in enumerate(at.list(content, "phases")):
        place = at.inside(f"phases[{i}]")
        phase = _phase(place.mapping(entry), place, phases[-1] if phases else None)
        free_s = 0.0
        for k, one in enumerate(place.list(entry, "set_points")):
            inner = place.inside(f"set_points[{k}]")
            event = _set_point(inner.mapping(one), inner, phase, free_s, present)
            free_s = event.at_s + event.over_s
            events.append(ReferenceEvent(begin_s + event.at_s, event.depth_mm, event.temperature_c, event.over_s))
        phases.append(phase)
        begin_s += phase.duration_s
    if not phases:
        raise at.inside("phases").error(f"is empty; some of {', '.join(PHASES)}")
    return tuple(phases), tuple(events)


def place_events(at: Place, content: Mapping[str, Any], phases: Sequence[Phase]) -> None:
    """Give every event with an angle, ``at_deg``, the time at which the tool first passes there instead."""
    allowed = Range(phases[0].from_deg, phases[-1].to_deg, "deg, the end of the path")
    for i, entry in enumerate(at.list(content, "events")):
        if isinstance(entry, dict) and "at_deg" in entry:
            place = at.inside(f"events[{i}]")
            if "at_s" in entry:
                raise place.error("has at_s and at_deg; give one of them")
            angle_deg = place.number(entry, "at_deg", allowed)
            del entry["at_deg"]
            entry["at_s"] = round(time_at(phases, angle_deg), 1)


def _phase(entry: dict[str, Any], at: Place, before: Phase | None) -> Phase:
    at.keys(entry, ("name", "duration_s", *_PATH_KEYS, "set_points"), required=("name",))
    name = at.choice(entry, "name", PHASES)
    if before is not None and PHASES.index(name) <= PHASES.index(before.name):
        raise at.error(f"{name} cannot follow {before.name}; the order is {', '.join(PHASES)}")
    here_deg = 0.0 if before is None else before.to_deg
    if "to_deg" not in entry:
        if moving := [key for key in _PATH_KEYS if key in entry]:
            raise at.error(f"has {', '.join(moving)} but no to_deg")
        return Phase(name, at.number(entry, "duration_s", ranges.DURATION_S), here_deg, here_deg)
    if "duration_s" in entry:
        raise at.error("has duration_s and to_deg; the duration of a path follows from its speed")
    from_deg = at.number(entry, "from_deg", ranges.WELD_ANGLE_DEG, here_deg)
    if from_deg != here_deg:
        raise at.inside("from_deg").error(f"= {from_deg:g} jumps: the phase before ends at {here_deg:g} deg")
    to_deg = at.number(entry, "to_deg", Range(from_deg, ranges.WELD_ANGLE_DEG.high, ranges.WELD_ANGLE_DEG.unit))
    arc_mm = (to_deg - from_deg) * MM_PER_DEG
    length_mm = at.number(entry, "length_mm", Range(arc_mm, ranges.WELD_LENGTH_MM.high, "mm"), arc_mm)
    if length_mm <= 0.0:
        raise at.error("has a path without length; give duration_s for a phase without travel")
    speed = at.number(entry, "speed_mm_per_min", ranges.WELD_SPEED_MM_PER_MIN, TRAVERSE_MM_PER_MIN)
    return Phase(name, length_mm / speed * 60.0, from_deg, to_deg, length_mm)


def _set_point(
    entry: dict[str, Any], at: Place, phase: Phase, free_s: float, present: dict[str, float]
) -> ReferenceEvent:
    """One set-point, with its time from the phase's begin; moves ``present`` on."""
    at.keys(entry, ("at_s", "depth_mm", "temperature_c", "over_s"))
    at_s = at.number(entry, "at_s", Range(0.0, phase.duration_s, f"s, the duration of {phase.name}"), 0.0)
    over_s = at.number(entry, "over_s", Range(0.0, phase.duration_s - at_s, "s, what is left of the phase"), 0.0)
    if at_s < free_s:
        raise at.inside("at_s").error(f"= {at_s:g} is before the end of the set-point before it, {free_s:g} s")
    values = {
        "depth_mm": at.optional(entry, "depth_mm", ranges.REFERENCE_DEPTH_MM),
        "temperature_c": at.optional(entry, "temperature_c", ranges.REFERENCE_TEMPERATURE_C),
    }
    for name, value in values.items():
        unit, step, rate = _LIMITS[name]
        if value is None:
            continue
        change, allowed = abs(value - present[name]), max(step, rate * over_s)
        if change > allowed + 1e-9:
            raise at.inside(name).error(
                f"= {value:g} jumps by {change:g} {unit}, more than {allowed:g}; give over_s: {change / rate:g} or more"
            )
        present[name] = value
    if set(values.values()) == {None}:
        raise at.error("needs depth_mm or temperature_c")
    return ReferenceEvent(at_s, values["depth_mm"], values["temperature_c"], over_s)
