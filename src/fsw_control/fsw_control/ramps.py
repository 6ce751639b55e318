"""Ramps of the set-points at the permitted rates, as they are sent ahead and announced."""

from __future__ import annotations

from math import ceil

from fsw_control.contract import Reference
from fsw_control.ranges import WELD_RATE_DEPTH_MM_PER_S, WELD_RATE_TEMPERATURE_C_PER_S
from fsw_control.units import NANOSECONDS
from fsw_control.weld import TICK_S

_TICK_NS = round(TICK_S * NANOSECONDS)
#: most set-points of a ramp: with the one before it, no more than half of what the topic keeps
_MOST = 499
#: tread of the stair that is announced
_TREAD_S = 1.0

#: in order, the time in ns from which each holds
Programme = list[tuple[int, Reference]]


def duration_s(start: Reference, goal: Reference) -> float:
    """How long a ramp takes at the rates that are allowed."""
    return max(
        abs(goal.depth_mm - start.depth_mm) / WELD_RATE_DEPTH_MM_PER_S,
        abs(goal.temperature_c - start.temperature_c) / WELD_RATE_TEMPERATURE_C_PER_S,
    )


def ramp(start: Reference, goal: Reference, begin_ns: int) -> Programme:
    """The set-points of a ramp: one per tick, or as many ticks apart as a long one needs. The last one is the goal."""
    ticks = ceil(duration_s(start, goal) / TICK_S)
    step = max(1, ceil(ticks / _MOST))
    return [
        (begin_ns + min(tick, ticks) * _TICK_NS, _between(start, goal, min(1.0, tick / ticks)))
        for tick in range(step, ticks + step, step)
    ]


def stair(start: Reference, goal: Reference, begin_ns: int) -> Programme:
    """What is announced of a ramp: treads with the values in their middle, so that few set-points reach far ahead."""
    whole_s = duration_s(start, goal)
    treads = ceil(whole_s / _TREAD_S)
    plan = [
        (begin_ns + round(k * _TREAD_S * NANOSECONDS), _between(start, goal, min(1.0, (k + 0.5) * _TREAD_S / whole_s)))
        for k in range(treads)
    ]
    return [*plan, (begin_ns + round(treads * _TREAD_S * NANOSECONDS), goal)]


def _between(start: Reference, goal: Reference, share: float) -> Reference:
    if share >= 1.0:
        return goal
    return Reference(
        start.depth_mm + share * (goal.depth_mm - start.depth_mm),
        start.temperature_c + share * (goal.temperature_c - start.temperature_c),
    )
