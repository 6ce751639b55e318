"""Heat plans: read by time, refused where they cannot be of this weld, kept through holds."""

from dataclasses import replace
from math import inf, nan

import pytest

from fsw_control.heat_plan import HeatPlan, HeatPlanProblem, ReceivedHeat

PLAN = HeatPlan(
    at_s=[100.0, 110.0, 120.0],
    heat_kw=[1.0, 2.0, -1.0],
    variance_kw2=[0.0, 0.01, 0.04],
    model={"copper_lag_s": 11.0},
    travel_mm=[0.0, 0.0, 15.0],
    type="copper_lid",
    profile="a" * 64,
)


@pytest.fixture
def received():
    """A receiver that has taken a plan before the first measurement, and its refusals."""
    heat = ReceivedHeat(lambda problem: heat.refusals.append(problem))
    heat.refusals = []
    heat.receive(PLAN, None)
    assert heat.plan is PLAN
    return heat


def test_values_lie_on_lines_and_stay_constant_outside():
    assert [PLAN.heat(at_s) for at_s in (0.0, 105.0, 115.0, 200.0)] == [1.0, 1.5, 0.5, -1.0]
    assert PLAN.place(115.0) == 7.5
    assert PLAN.deviation(110.0, 120.0) == pytest.approx(0.03**0.5)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"heat_kw": [1.0, 2.0]}, HeatPlanProblem.LENGTHS),
        ({"travel_mm": []}, HeatPlanProblem.LENGTHS),
        (
            {"at_s": [1.0], "heat_kw": [1.0], "variance_kw2": [1.0], "travel_mm": [1.0]},
            HeatPlanProblem.LENGTHS,
        ),
        ({"heat_kw": [1.0, nan, 1.0]}, HeatPlanProblem.NOT_FINITE),
        ({"at_s": [1.0, 2.0, inf]}, HeatPlanProblem.NOT_FINITE),
        ({"model": {"copper_lag_s": nan}}, HeatPlanProblem.NOT_FINITE),
        ({"at_s": [100.0, 100.0, 120.0]}, HeatPlanProblem.ORDER),
        ({"travel_mm": [0.0, 5.0, 4.0]}, HeatPlanProblem.ORDER),
        ({"variance_kw2": [-0.1, 0.0, 0.1]}, HeatPlanProblem.VARIANCE),
        ({"variance_kw2": [0.0, 0.2, 0.1]}, HeatPlanProblem.VARIANCE),
        ({"heat_kw": [1.0, 51.0, 1.0]}, HeatPlanProblem.HEAT),
    ],
)
def test_bad_values_are_refused_and_the_plan_in_force_stays(received, changes, problem):
    received.receive(replace(PLAN, **changes), 105.0)
    assert received.refusals == [problem]
    assert received.plan is PLAN


def test_a_plan_that_is_over_is_refused(received):
    received.receive(replace(PLAN, type="late"), 120.0)
    assert received.refusals == [HeatPlanProblem.OVER]
    assert received.plan is PLAN


def test_a_weld_keeps_its_profile_through_holds(received):
    other = replace(PLAN, profile="b" * 64)
    moved = replace(PLAN, at_s=[101.0, 111.0, 121.0])
    received.receive(moved, 105.0)
    assert received.plan is moved
    received.receive(None, 106.0)
    assert received.plan is None
    received.receive(other, 107.0)
    assert received.plan is None
    assert received.refusals == [HeatPlanProblem.CHANGED]
    received.receive(moved, 108.0)
    assert received.plan is moved


@pytest.mark.parametrize("between", ["time restarts", "weld is over"])
def test_the_next_weld_may_have_another_profile(received, between):
    other = replace(PLAN, profile="b" * 64, at_s=[130.0, 140.0, 150.0])
    if between == "time restarts":
        received.restart()
    received.receive(other, 110.0 if between == "time restarts" else 125.0)
    assert received.plan is other


@pytest.mark.parametrize(
    ("travelled_mm", "at_s", "stays"),
    [
        (7.5, 115.0, True),
        (10.0, 115.0, True),  # reports are a second apart
        (30.0, 115.0, False),
        (nan, 115.0, False),
        (30.0, 90.0, True),  # before the programme begins it says nothing
    ],
)
def test_a_plan_of_another_path_is_dropped(received, travelled_mm, at_s, stays):
    received.follow(travelled_mm, at_s)
    assert (received.plan is PLAN) is stays
    assert received.refusals == ([] if stays else [HeatPlanProblem.PLACE])
