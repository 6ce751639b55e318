"""Set-points in advance: ramps, the staircase that announces them, the plan of those to come."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from math import ceil

from fsw_control.contract import Coming, Reference
from fsw_control.ranges import WELD_RATE_DEPTH_MM_PER_S, WELD_RATE_TEMPERATURE_C_PER_S
from fsw_control.units import NANOSECONDS
from fsw_control.weld import TICK_NS, TICK_S

#: largest number of future set-points passed to a controller
MOST_COMING = 8
#: longest step of a staircase by which a ramp or sine is announced
STAIR_S = 1.05
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
    depth_s = abs(goal.depth_mm - start.depth_mm) / WELD_RATE_DEPTH_MM_PER_S
    change_c = abs(goal.temperature_c - start.temperature_c)
    return max(depth_s, change_c / WELD_RATE_TEMPERATURE_C_PER_S)


def ramp(start: Reference, goal: Reference, begin_ns: int) -> Programme:
    """The set-points of a ramp, one per tick or less often if it is long; the last is the goal."""
    points = _by_tick(start, goal)
    step = ceil(len(points) / _MOST)
    return _timed([*points[step - 1 : -1 : step], points[-1]], begin_ns)


def ramp_plan(start: Reference, goal: Reference, begin_ns: int) -> Programme:
    """The set-points announced for a ramp, fewer than one per tick."""
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

    def at(share: float) -> Reference:
        return Reference(start.depth_mm + share * depth, start.temperature_c + share * temperature)

    return [*((tick, at(tick / ticks)) for tick in range(1, ticks)), (ticks, goal)]


def _timed(points: Programme, begin_ns: int) -> Programme:
    return [(begin_ns + tick * TICK_NS, point) for tick, point in points]


class ReferencePlan:
    """Set-points known in advance, each with the time in ns from which it will hold.

    A plan is used only while it agrees with the set-points in force. If an operator has set
    others, or the plan belongs to another weld, it has no future set-points.
    """

    def __init__(self, planned: Sequence[tuple[int, Reference]] = ()) -> None:
        self._stamps = [stamp_ns for stamp_ns, _ in planned]
        self._coming = [
            Coming(stamp_ns / NANOSECONDS, point.depth_mm, point.temperature_c)
            for stamp_ns, point in planned
        ]

    def after(self, tick_ns: int, present: Reference) -> tuple[Coming, ...]:
        """Return the next ones after a tick at which ``present`` is in force."""
        first = bisect_right(self._stamps, tick_ns)
        if first and not self._has_come(first - 1, present):
            return ()
        return tuple(self._coming[first : first + MOST_COMING])

    def _has_come(self, index: int, present: Reference) -> bool:
        """Whether ``present`` is as planned, or near a step of a ramp's or sine's staircase."""
        planned = self._coming[index]
        near = self._coming[max(index - 1, 0) : index + 2]
        near = [point for point in near if abs(point.at_s - planned.at_s) <= STAIR_S]
        return all(
            _within(getattr(present, name), [getattr(point, name) for point in near])
            for name in ("depth_mm", "temperature_c")
        )


def _within(value: float, planned: Sequence[float]) -> bool:
    """Whether a value lies among planned ones, or outside by at most their range."""
    low, high = min(planned), max(planned)
    slack = high - low + 1e-9
    return low - slack <= value <= high + slack
