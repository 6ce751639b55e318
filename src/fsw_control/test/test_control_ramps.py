"""Ramps as they are sent ahead and announced."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_control.contract import Reference
from fsw_control.ramps import ReferencePlan, duration_s, ramp, ramp_plan
from fsw_control.ranges import (
    REFERENCE_DEPTH_MM,
    REFERENCE_TEMPERATURE_C,
    WELD_RATE_DEPTH_MM_PER_S,
    WELD_RATE_TEMPERATURE_C_PER_S,
)
from fsw_control.references import ReferenceQueue
from fsw_control.topics_ros import LATCHED
from fsw_control.units import NANOSECONDS

START_NS = 1_700_000_000 * NANOSECONDS
references = st.builds(
    Reference,
    st.floats(REFERENCE_DEPTH_MM.low, REFERENCE_DEPTH_MM.high),
    st.floats(REFERENCE_TEMPERATURE_C.low, REFERENCE_TEMPERATURE_C.high),
)


def test_ramp_is_as_fast_as_its_slower_part():
    assert duration_s(Reference(2.66, 816.0), Reference(2.70, 826.0)) == pytest.approx(10.0)
    assert duration_s(Reference(2.66, 816.0), Reference(2.96, 826.0)) == pytest.approx(15.0)


@given(references, references)
def test_ramp_reaches_its_goal_within_the_rate_limit(start, goal):
    if start == goal:
        return
    points = ramp(start, goal, START_NS)
    assert points[-1][1] == goal
    assert 2 * (len(points) + 1) <= LATCHED.depth
    for (before_ns, before), (after_ns, after) in pairwise([(START_NS, start), *points]):
        step_s = (after_ns - before_ns) / NANOSECONDS
        assert step_s > 0.0
        assert abs(after.depth_mm - before.depth_mm) <= WELD_RATE_DEPTH_MM_PER_S * step_s + 1e-9
        assert (
            abs(after.temperature_c - before.temperature_c)
            <= WELD_RATE_TEMPERATURE_C_PER_S * step_s + 1e-9
        )


@given(references, references)
def test_stair_has_treads_of_a_second_and_never_leaves_the_ramp(start, goal):
    if start == goal:
        return
    plan = ramp_plan(start, goal, START_NS)
    assert plan[-1][1] == goal
    *gaps, last = [
        after - before for (before, _), (after, _) in pairwise([(START_NS, start), *plan])
    ]
    assert set(gaps[1:]) <= {NANOSECONDS} and 0 < last <= NANOSECONDS
    low, high = sorted((start.temperature_c, goal.temperature_c))
    assert all(low <= set_points.temperature_c <= high for _, set_points in plan)
    assert ReferencePlan(plan).after(START_NS - 1, start)


def test_set_points_by_hand_void_the_rest_of_a_ramp():
    queue = ReferenceQueue()
    start, goal, other = Reference(2.66, 816.0), Reference(2.66, 826.0), Reference(2.5, 800.0)
    for number, (stamp_ns, set_points) in enumerate([(0, start), *ramp(start, goal, START_NS)]):
        queue.add(stamp_ns, set_points, START_NS + number)
    middle_ns = START_NS + 5 * NANOSECONDS
    assert queue.at(middle_ns).temperature_c == pytest.approx(821.0)
    queue.add(0, other, middle_ns)
    assert queue.at(middle_ns + 1) == other
    assert queue.at(START_NS + 60 * NANOSECONDS) == other
