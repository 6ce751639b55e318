"""Ramps of the set-points at the permitted rates, as sent ahead and as announced."""

from __future__ import annotations

from collections.abc import Iterable
from math import ceil

from fsw_control.contract import Reference
from fsw_control.ranges import WELD_RATE_DEPTH_MM_PER_S, WELD_RATE_TEMPERATURE_C_PER_S
from fsw_control.weld import TICK_NS, TICK_S

#: most set-points of a ramp: with the previous one, at most half of what the topic keeps
_MOST = 499
#: step length of the announced staircase, 1 s: a controller gets eight future set-points, which
#: reach past the dead time; longer steps show in the power (total variation of the spindle speed
#: in a ramp with 1, 2, 4 s: 83, 154, 239 rpm)
_TREAD_TICKS = 10

#: set-points in order, each with the tick or the time in ns from which it holds
Programme = list[tuple[int, Reference]]


def duration_s(start: Reference, goal: Reference) -> float:
    """Duration of a ramp at the permitted rates."""
    return max(
        abs(goal.depth_mm - start.depth_mm) / WELD_RATE_DEPTH_MM_PER_S,
        abs(goal.temperature_c - start.temperature_c) / WELD_RATE_TEMPERATURE_C_PER_S,
    )


def ramp(start: Reference, goal: Reference, begin_ns: int) -> Programme:
    """The set-points of a ramp, one per tick or less often if it is long; the last is the goal."""
    points = _by_tick(start, goal)
    step = ceil(len(points) / _MOST)
    return _timed([*points[step - 1 : -1 : step], points[-1]], begin_ns)


def ramp_plan(start: Reference, goal: Reference, begin_ns: int) -> Programme:
    """The set-points announced for a ramp, in place of one per tick."""
    return _timed(stair(_by_tick(start, goal)), begin_ns)


def stair(changes: Iterable[tuple[int, Reference]]) -> Programme:
    """The set-points announced for changes by tick, in order.

    Steps are announced as they are. A ramp or sine, which changes at every tick, is announced as
    a staircase with the values at the middle of its steps, so that the few future set-points that
    a controller gets reach further ahead.
    """
    plan: Programme = []
    course: Programme = []
    for change in [*changes, None]:
        if course and (change is None or change[0] != course[-1][0] + 1):
            treads = range(0, len(course) - 1, _TREAD_TICKS)
            middles = (
                min(i + _TREAD_TICKS // 2, len(course) - 1) if len(course) > _TREAD_TICKS else i
                for i in treads
            )
            plan += [(course[i][0], course[k][1]) for i, k in zip(treads, middles, strict=True)]
            plan.append(course[-1])
            course = []
        if change is not None:
            course.append(change)
    return plan


def _by_tick(start: Reference, goal: Reference) -> Programme:
    """A ramp by tick, which starts at tick 1."""
    ticks = ceil(duration_s(start, goal) / TICK_S)
    depth, temperature = goal.depth_mm - start.depth_mm, goal.temperature_c - start.temperature_c
    return [
        (
            tick,
            Reference(
                start.depth_mm + tick / ticks * depth,
                start.temperature_c + tick / ticks * temperature,
            ),
        )
        for tick in range(1, ticks)
    ] + [(ticks, goal)]


def _timed(points: Programme, begin_ns: int) -> Programme:
    return [(begin_ns + tick * TICK_NS, one) for tick, one in points]
