"""Which reference holds, for who hears all and for who starts in mid-weld."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_control.contract import Coming, Reference
from fsw_control.references import ReferencePlan, ReferenceQueue

SECOND = 1_000_000_000
TICK_NS = SECOND // 10
REFERENCE, OTHER, THIRD = Reference(2.66, 816.4), Reference(2.86, 816.4), Reference(2.5, 806.4)


def test_reference_begins_at_its_stamp():
    queue = ReferenceQueue()
    assert queue.at(0) is None
    queue.add(0, REFERENCE)
    queue.add(2 * SECOND, OTHER)
    assert [queue.at(k * SECOND) for k in range(4)] == [REFERENCE, REFERENCE, OTHER, OTHER]


def test_past_and_foreign_stamps_begin_at_once():
    queue = ReferenceQueue()
    queue.add(SECOND, REFERENCE)
    assert queue.at(5 * SECOND) == REFERENCE
    queue.add(1_700_000_000 * SECOND, OTHER)
    assert queue.at(6 * SECOND) == OTHER


def test_a_newer_message_overrides_one_held_back():
    queue = ReferenceQueue()
    queue.add(9 * SECOND, OTHER)
    assert queue.at(SECOND) is None
    queue.add(0, REFERENCE)
    assert [queue.at(k * SECOND) for k in (2, 9, 10)] == [REFERENCE] * 3


#: a scenario's three set-points, the first of them "at once"; issued 100 ns, 101 ns and 102 ns
SCENARIO = [(0, REFERENCE, 100), (3 * SECOND, OTHER, 101), (20 * SECOND, THIRD, 102)]


@pytest.mark.parametrize("tick_between", [False, True])
def test_who_starts_in_mid_weld_takes_what_holds_in_whatever_order_it_is_told(tick_between):
    told = [*SCENARIO, (3 * SECOND, OTHER, 101)]  # the last one by the supervisor, with the time of issue
    for order in itertools.permutations(told):
        queue = ReferenceQueue()
        for item in order:
            queue.add(*item)
            if tick_between:
                queue.at(10 * SECOND)
        assert [queue.at(k * SECOND) for k in (11, 19, 20)] == [OTHER, OTHER, THIRD], order
        assert queue.issued_ns == 102, order


def test_who_overrides_a_scenario_by_hand_does_so_for_those_who_start_later_too():
    by_hand = Reference(2.71, 820.0)
    for order in itertools.permutations([*SCENARIO, (10 * SECOND, by_hand, 200)]):
        queue = ReferenceQueue()
        for item in order:
            queue.add(*item)
        assert [queue.at(k * SECOND) for k in (11, 20, 21)] == [by_hand] * 3, order


def test_a_supervisor_that_has_lost_a_set_point_takes_it_from_nobody():
    queue = ReferenceQueue()
    queue.add(0, REFERENCE, 100)
    queue.add(0, OTHER, 200)
    assert queue.at(5 * SECOND) == OTHER
    queue.add(6 * SECOND, REFERENCE, 100)  # restarted, it knows only the sender that is still there
    assert queue.at(7 * SECOND) == OTHER


def test_when_time_starts_over_what_held_goes_on():
    queue = ReferenceQueue()
    queue.add(100 * SECOND, OTHER, 100)
    assert queue.at(101 * SECOND) == OTHER
    assert queue.at(SECOND) == OTHER
    queue.add(2 * SECOND, REFERENCE, 101)
    assert queue.at(2 * SECOND) == REFERENCE


@given(
    st.lists(st.integers(0, 40), min_size=1, max_size=8),
    st.randoms(use_true_random=False),
    st.integers(1, 40),
)
def test_who_starts_later_follows_what_the_others_follow(stamps_s, random, start_s):
    """All messages reach one listener as they are issued, and a later one at its start, in any order."""
    messages = [(stamp_s * SECOND, Reference(1.0 + k, 800.0), k) for k, stamp_s in enumerate(stamps_s)]
    first, late = ReferenceQueue(), ReferenceQueue()
    for message in messages:
        first.add(*message)
    holds = [first.at(k * SECOND) for k in range(start_s + 1)]
    again = random.sample(messages, len(messages))
    if holds[-1] is not None:
        again.insert(random.randint(0, len(again)), (start_s * SECOND, holds[-1], first.issued_ns))
    for message in again:
        late.add(*message)
    for k in range(start_s, 45):
        assert late.at(k * SECOND) == first.at(k * SECOND)


def test_a_plan_tells_what_comes_and_no_more_than_a_controller_takes():
    steps = [Reference(2.66 + 0.01 * k, 816.4) for k in range(20)]
    plan = ReferencePlan([(10 * k * TICK_NS, steps[k]) for k in range(1, 20)])
    assert [round(one.at_s) for one in plan.after(0, steps[0])] == [1, 2, 3, 4, 5, 6, 7, 8]
    assert plan.after(10 * TICK_NS, steps[1])[0] == Coming(2.0, 2.68, 816.4)
    assert [round(one.at_s) for one in plan.after(185 * TICK_NS, steps[18])] == [19]
    assert plan.after(190 * TICK_NS, steps[19]) == () == ReferencePlan().after(0, steps[0])


def test_a_plan_that_does_not_come_true_is_not_believed():
    planned = [(50 * TICK_NS, Reference(2.66, 826.4)), (150 * TICK_NS, Reference(2.66, 836.4))]
    plan = ReferencePlan(planned)
    assert len(plan.after(40 * TICK_NS, Reference(2.7, 816.4))) == 2  # nothing of it is due yet
    assert plan.after(50 * TICK_NS, Reference(2.66, 816.4)) == ()
    assert plan.after(60 * TICK_NS, Reference(2.7, 826.4)) == ()
    assert len(plan.after(60 * TICK_NS, planned[0][1])) == 1
