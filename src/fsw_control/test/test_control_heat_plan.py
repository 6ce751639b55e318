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
    angle_deg=[0.0, 0.0, 1.6],
    type="copper_lid",
    profile="a" * 64,
)


#: seconds, of stamps in ns
S = 10**9


class Weld(ReceivedHeat):
    """A receiver that has taken a plan before the first measurement, and its refusals."""

    def __init__(self):
        self.refusals = []
        super().__init__(self.refusals.append)
        self.receive(PLAN, 0, None)

    def take(self, plan, now_s):
        """Take a plan after the tick of now; returns the one in force at the next tick."""
        self.receive(plan, round(now_s * S), round(now_s * S))
        return self.at(round(now_s * S) + S // 10)


@pytest.fixture
def weld():
    made = Weld()
    assert made.at(1) is PLAN
    return made


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
            {key: [1.0] for key in ("at_s", "heat_kw", "variance_kw2", "travel_mm", "angle_deg")},
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
        ({"model": {}}, HeatPlanProblem.MODEL),
    ],
)
def test_bad_values_are_refused_and_the_plan_in_force_stays(weld, changes, problem):
    assert weld.take(replace(PLAN, **changes), 105.0) is PLAN
    assert weld.refusals == [problem]


def test_a_plan_that_is_over_is_refused(weld):
    assert weld.take(replace(PLAN, type="late"), 120.0) is PLAN
    assert weld.refusals == [HeatPlanProblem.OVER]


def test_a_weld_keeps_its_profile_through_holds(weld):
    moved, other = replace(PLAN, at_s=[101.0, 111.0, 121.0]), replace(PLAN, profile="b" * 64)
    assert weld.take(moved, 105.0) is moved
    assert weld.take(None, 106.0) is None
    assert weld.take(other, 107.0) is None
    assert weld.refusals == [HeatPlanProblem.CHANGED]
    assert weld.take(moved, 108.0) is moved


def test_a_plan_holds_from_the_tick_after_its_stamp_however_early_it_comes(weld):
    first, second = replace(PLAN, type="first"), replace(PLAN, type="second")
    weld.receive(first, 105 * S, 104 * S)
    weld.receive(second, 106 * S, 104 * S)
    assert [weld.at(at_s * S) for at_s in (105, 106, 107)] == [PLAN, first, second]


def test_a_plan_stamped_far_ahead_blocks_neither_the_next_nor_a_withdrawal(weld):
    moved = replace(PLAN, type="moved")
    for later in (moved, None):
        weld.receive(PLAN, 10**18, 105 * S)
        assert weld.take(later, 106.0) is later
    assert weld.at(10**18 + 1) is None  # replaced


def test_a_jump_of_time_ends_the_plan_in_force_not_one_that_waits(weld):
    weld.jump()
    assert weld.at(101 * S) is None
    moved = replace(PLAN, type="moved")
    weld.receive(moved, 102 * S, 101 * S)
    weld.jump()
    assert weld.at(103 * S) is moved


def test_plans_that_never_come_into_force_do_not_pile_up(weld):
    for number in range(100):
        weld.receive(replace(PLAN, type=str(number)), 10**18, 105 * S)
    assert len(weld._plans.coming) < 10
    assert weld.at(106 * S) is PLAN


@pytest.mark.parametrize("between", ["time restarts", "weld is over"])
def test_the_next_weld_may_have_another_profile(weld, between):
    other = replace(PLAN, profile="b" * 64, at_s=[130.0, 140.0, 150.0])
    if between == "time restarts":
        weld.jump()
    assert weld.take(other, 110.0 if between == "time restarts" else 125.0) is other


@pytest.mark.parametrize(
    ("travelled_mm", "at_s", "stays"),
    [
        (7.5, 115, True),
        (10.0, 115, True),  # reports are a second apart
        (30.0, 115, False),
        (nan, 115, False),
        (30.0, 90, True),  # before the programme begins it says nothing
    ],
)
def test_a_plan_of_another_path_is_dropped(weld, travelled_mm, at_s, stays):
    weld.follow(travelled_mm, at_s * S)
    assert weld.at(116 * S) is (PLAN if stays else None)
    assert weld.refusals == ([] if stays else [HeatPlanProblem.PLACE])
