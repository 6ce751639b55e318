"""What a scenario means at each tick: the set-points, the open-loop manipulated variables, the selected controller."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from math import pi, sin

from fsw_control.contract import Command, Reference
from fsw_control.weld import TICK_S
from fsw_scenario.scenario import Scenario, tick_of

#: 1 s: a controller is given eight set-points ahead, which is past the dead time; steps of longer treads show in the
#: power (total variation of the spindle speed in a ramp with 1, 2, 4 s: 83, 154, 239 rpm)
_TREAD_TICKS = 10


def references(scenario: Scenario, start: Reference) -> dict[int, Reference]:
    """Changes of the set-points by tick; key 0 holds what is in force from the start.

    Parameters
    ----------
    scenario : Scenario
    start : Reference
        In force before the first reference event.

    Returns
    -------
    dict of int to Reference
        In order of ticks, always with tick 0; a tick that is not a key keeps the last reference.
    """
    events = [(event.at_s, event.reference) for event in scenario.events if event.reference is not None]
    begins = [tick_of(at_s) for at_s, _ in events]
    changes: dict[int, Reference] = {0: start}
    depth_mm, temperature_c = start.depth_mm, start.temperature_c
    for i, (at_s, event) in enumerate(events):
        end = begins[i + 1] if i + 1 < len(events) else scenario.n_ticks + 1
        from_depth, from_temperature = depth_mm, temperature_c
        to_depth = from_depth if event.depth_mm is None else event.depth_mm
        to_temperature = from_temperature if event.temperature_c is None else event.temperature_c
        ramp_end = tick_of(at_s + event.over_s)
        for tick in range(begins[i], end):
            since_s = tick * TICK_S - at_s
            if tick < ramp_end:
                share = max(0.0, since_s / event.over_s)
                depth_mm = from_depth + share * (to_depth - from_depth)
                temperature_c = from_temperature + share * (to_temperature - from_temperature)
                changes[tick] = Reference(depth_mm, temperature_c)
                continue
            depth_mm, temperature_c = to_depth, to_temperature
            if event.sine is None:
                changes[tick] = Reference(depth_mm, temperature_c)
                break
            swing = sin(2.0 * pi * (since_s - event.over_s) / event.sine.period_s)
            changes[tick] = Reference(
                depth_mm + event.sine.depth_mm * swing, temperature_c + event.sine.temperature_c * swing
            )
    return {0: changes[0]} | {tick: new for (_, old), (tick, new) in pairwise(changes.items()) if new != old}


def announced(changes: Iterable[tuple[int, Reference]]) -> list[tuple[int, Reference]]:
    """What is announced of changes of the set-points, in order of ticks.

    Steps are announced as they are. A ramp or sine, which changes at every tick, is announced as a stair with the
    values in the middle of its treads, so that the few set-points that a controller is given reach further ahead.
    """
    plan: list[tuple[int, Reference]] = []
    course: list[tuple[int, Reference]] = []
    for change in [*changes, None]:
        if course and (change is None or change[0] != course[-1][0] + 1):
            treads = range(0, len(course) - 1, _TREAD_TICKS)
            middles = (min(i + _TREAD_TICKS // 2, len(course) - 1) if len(course) > _TREAD_TICKS else i for i in treads)
            plan += [(course[i][0], course[k][1]) for i, k in zip(treads, middles, strict=True)]
            plan.append(course[-1])
            course = []
        if change is not None:
            course.append(change)
    return plan


def commands(scenario: Scenario, start: Command) -> dict[int, Command]:
    """Changes of the open-loop manipulated variables by tick; as :func:`references`."""
    changes = {0: start}
    present = start
    for event in scenario.events:
        if (new := event.command) is not None:
            present = Command(
                present.force_kn if new.force_kn is None else new.force_kn,
                present.speed_rpm if new.speed_rpm is None else new.speed_rpm,
            )
            changes[tick_of(event.at_s)] = present
    return changes


def switches(scenario: Scenario) -> dict[int, str]:
    """Newly selected controller by tick."""
    return {tick_of(event.at_s): event.switch for event in scenario.events if event.switch is not None}
