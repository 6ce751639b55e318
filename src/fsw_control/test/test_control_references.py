"""Which reference holds, for who hears all and for who starts in mid-weld."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_control.coded import Fact
from fsw_control.contract import Coming, Reference
from fsw_control.ramps import ReferencePlan
from fsw_control.references import AHEAD_REAL_NS, OTHER_CLOCK_NS, OWN_CLOCK_NS, ReferenceQueue

SECOND = 1_000_000_000
TICK_NS = SECOND // 10
REFERENCE, OTHER, THIRD = Reference(2.66, 816.4), Reference(2.86, 816.4), Reference(2.5, 806.4)


def test_reference_begins_at_its_stamp():
    queue = ReferenceQueue()
    assert queue.at(0) is None
    queue.add(0, REFERENCE)
    queue.add(2 * SECOND, OTHER)
    assert [queue.at(k * SECOND) for k in range(4)] == [REFERENCE, REFERENCE, OTHER, OTHER]


def test_past_stamps_begin_at_once_and_those_of_another_clock_are_refused():
    refusals: list[Fact] = []
    queue = ReferenceQueue(refuse=refusals.append)
    queue.add(SECOND, REFERENCE)
    queue.add(1_700_000_000 * SECOND, OTHER)
    assert queue.at(5 * SECOND) == REFERENCE
    assert [queue.at(k * SECOND) for k in (6, 7)] == [REFERENCE] * 2
    assert [(fact.code, fact.data["depth_mm"]) for fact in refusals] == [("too_far", 2.86)]


def test_real_time_horizon_rejects_stamps_an_hour_ahead():
    """A sender whose clock is an hour ahead, and who stamps with it.

    In force in an hour, and told that it is sent.
    """
    listener = Listener(AHEAD_REAL_NS)
    assert listener.hear(0.0, REFERENCE, stamp_s=0.0)
    assert not listener.hear(20.0, OTHER, stamp_s=3620.0)
    assert (listener.holds(21.0), len(listener.told)) == (REFERENCE, 1)
    data = listener.told[0].data
    assert (round(data["ahead_s"]), data["limit_s"]) == (3620, 600.0)


class Listener:
    """Hears set-points at times of its own clock [s], which is the clock of the measurements, too."""

    def __init__(self, horizon_ns=OTHER_CLOCK_NS, began_s=-1000.0):
        self.told = []
        self.queue = ReferenceQueue(horizon_ns, self.told.append)
        self.queue.join(WALL + round(began_s * SECOND))
        self.queue.at(WALL)

    def hear(self, at_s, reference, clock_s=0.0, stamp_s=None, late_s=0.0):
        """Take one that a sender, whose clock is ahead by ``clock_s``, published ``late_s`` ago."""
        stamp_ns = 0 if stamp_s is None else WALL + round(stamp_s * SECOND)
        published_ns = WALL + round((at_s - late_s + clock_s) * SECOND)
        return self.queue.receive(stamp_ns, reference, published_ns, WALL + round(at_s * SECOND))

    def holds(self, at_s):
        return self.queue.at(WALL + round(at_s * SECOND))


WALL = 1_700_000_000 * SECOND


@pytest.mark.requirement("S28")
def test_fast_sender_clock_is_reported_and_rejected():
    listener = Listener()
    assert not listener.hear(1.0, OTHER, clock_s=3600.0)
    assert (listener.told[0].code, round(listener.told[0].data["ahead_s"])) == ("ahead", 3600)
    for k in range(60):
        assert listener.hear(2.0 + k, Reference(2.0 + 0.01 * k, 816.4))
        assert listener.holds(2.5 + k) == Reference(2.0 + 0.01 * k, 816.4)


def test_last_received_wins_despite_clock_offsets():
    listener = Listener()
    for k in range(20):
        set_points = Reference(2.0 + 0.01 * k, 816.4)
        assert listener.hear(0.5 * k, set_points, clock_s=4.0 if k % 2 else -4.0)
        assert listener.holds(0.5 * k + 0.1) == set_points


@pytest.mark.requirement("S21")
def test_standby_orders_set_points_by_publication_time():
    """All others heard the newer one last and follow it.

    At takeover they would follow the standby.
    """
    follower, standby = Listener(), Listener()
    standby.queue.decides = False
    follower.hear(0.0, REFERENCE)
    follower.hear(1.0, OTHER)
    standby.hear(1.5, OTHER, late_s=0.5)
    standby.hear(2.0, REFERENCE, late_s=2.0)
    assert (standby.holds(3.0), standby.told) == (OTHER, [])
    follower.holds(3.0)
    follower.queue.add(0, standby.holds(3.0), standby.queue.issued_ns)
    assert follower.holds(4.0) == OTHER
    standby.queue.decides = True
    assert standby.hear(5.0, THIRD, clock_s=-4.5), "it leads now: the one received last holds"
    assert standby.holds(6.0) == THIRD


def test_a_standby_takes_the_order_of_receipt_from_those_that_are_followed():
    leader, standby = Listener(), Listener()
    standby.queue.decides = False
    for receiver in (leader, standby):
        receiver.hear(0.0, REFERENCE)
        receiver.hear(1.0, OTHER, clock_s=-4.0)  # a slow clock, but received last
    assert (leader.holds(2.0), standby.holds(2.0)) == (OTHER, REFERENCE)
    standby.queue.add(0, OTHER, leader.queue.issued_ns)
    assert standby.holds(3.0) == OTHER


def test_repetition_after_a_lost_link_does_not_override_newer_set_points():
    listener = Listener()
    listener.hear(0.0, REFERENCE)
    listener.hear(60.0, OTHER)
    assert listener.holds(61.0) == OTHER
    assert not listener.hear(100.0, REFERENCE, late_s=100.0)
    assert (listener.holds(101.0), len(listener.told)) == (OTHER, 1)
    assert listener.hear(200.0, THIRD, late_s=100.0), (
        "published at 100 s: newer than what is in force, and missed"
    )
    assert listener.holds(201.0) == THIRD


def test_slow_sender_clock_is_reported():
    listener = Listener(began_s=0.0)
    assert listener.hear(60.0, REFERENCE)
    assert listener.holds(60.1) == REFERENCE
    assert not listener.hear(62.0, OTHER, clock_s=-100.0)
    assert (listener.told[0].code, round(listener.told[0].data["age_s"])) == ("old", 100)


def test_set_points_are_accepted_after_the_clock_goes_back():
    listener = Listener(began_s=0.0)
    assert listener.hear(60.0, REFERENCE)
    assert listener.holds(60.1) == REFERENCE
    assert listener.hear(-3540.0, OTHER)
    assert listener.holds(60.2) == OTHER


def test_repetition_to_a_late_joiner_is_not_reported():
    listener = Listener(began_s=99.0)
    assert listener.hear(100.0, OTHER, late_s=40.0)
    assert listener.holds(100.1) == OTHER
    assert not listener.hear(100.2, REFERENCE, late_s=70.0)
    assert (listener.holds(101.0), listener.told) == (OTHER, [])


@pytest.mark.requirement("S28")
def test_new_listener_reports_rejections_of_a_slow_clock():
    listener = Listener(began_s=0.0)
    assert listener.hear(1.0, REFERENCE)
    assert not listener.hear(2.0, OTHER, clock_s=-3.0)
    assert (listener.told[0].code, round(listener.told[0].data["age_s"])) == ("old", 3)
    assert listener.holds(2.1) == REFERENCE


@pytest.mark.requirement("S28")
@given(
    st.lists(
        st.tuples(
            *(st.sampled_from([0, 1, 3]), st.sampled_from([-60.0, -4.0, -1.0, 0.0, 1.0, 4.0])),
            st.sampled_from([None, -2, 0, 1, 2, 30]),
        ),
        max_size=8,
    )
)
def test_new_listener_rejects_void_set_points(sent):
    """Of those accepted the last one comes to hold.

    Whoever sent less than 5 s ago, by all clocks, is told.
    """
    listener, tick, held = Listener(AHEAD_REAL_NS, began_s=0.0), 0, []
    last = None
    for number, (ticks, clock_s, ahead_ticks) in enumerate(sent):
        for _ in range(ticks):
            tick += 1
            held.append(listener.holds(0.1 * tick))
        set_points, before = Reference(2.0 + 0.01 * number, 816.4), len(listener.told)
        stamp_s = None if ahead_ticks is None else 0.1 * (tick + ahead_ticks)
        if listener.hear(0.1 * tick + 0.05, set_points, clock_s, stamp_s):
            last = set_points
        elif clock_s > -5.0:
            assert len(listener.told) > before
    held += [listener.holds(0.1 * (tick + k)) for k in range(1, 35)]
    assert last is None or last in held


_senders = st.sampled_from([-4000.0, -4.0, -1.0, 0.0, 1.0, 4.0, 4000.0])


@pytest.mark.requirement("S28")
@given(
    st.lists(
        st.tuples(st.floats(0.0, 30.0), _senders, st.sampled_from([None, 0.0, 3.0, 700.0])),
        max_size=12,
    )
)
def test_every_set_point_holds_or_is_replaced_or_is_refused_with_a_report(sent):
    """Whatever the clocks.

    An accepted one holds from its time on, until the next accepted one does.
    """
    listener, at_s = Listener(AHEAD_REAL_NS), 0.0
    accepted: list[tuple[float, Reference]] = []
    for number, (wait_s, clock_s, ahead_s) in enumerate(sent):
        at_s += wait_s + 0.1
        set_points = Reference(2.0 + 0.001 * number, 816.4)
        before, begins_s = len(listener.told), at_s + (ahead_s or 0.0)
        if listener.hear(at_s, set_points, clock_s, None if ahead_s is None else begins_s):
            accepted.append((begins_s, set_points))
        else:
            assert len(listener.told) == before + 1
        if clock_s in (-4.0, -1.0, 0.0, 1.0, 4.0) and ahead_s != 700.0:
            assert accepted and accepted[-1][1] == set_points
        begun = [reference for begins, reference in accepted if begins <= at_s + 0.05]
        if begun and all(abs(clock) < 100.0 for _, clock, _ in sent):
            assert listener.holds(at_s + 0.05) == begun[-1]


@pytest.mark.requirement("S28")
@given(
    st.permutations([(0.0, REFERENCE), (0.001, OTHER), (0.002, THIRD)]), st.permutations([0, 1, 2])
)
def test_listeners_that_heard_two_senders_in_different_order_come_to_follow_the_same(first, order):
    early, other = Listener(), Listener()
    for k, (at_s, reference) in enumerate(first):
        early.hear(1.0 + 0.001 * k, reference, late_s=0.001 * k - at_s)
    for k, index in enumerate(order):
        other.hear(1.0 + 0.001 * k, first[index][1], late_s=0.001 * k - first[index][0])
    for k in range(3):
        stated = [
            (listener.holds(2.0 + k), listener.queue.issued_ns) for listener in (early, other)
        ]
        for listener, (reference, issued_ns) in zip((other, early), stated, strict=True):
            listener.queue.add(WALL, reference, issued_ns)
    assert early.holds(9.0) == other.holds(9.0)


def test_a_newer_message_overrides_one_held_back():
    queue = ReferenceQueue()
    queue.add(9 * SECOND, OTHER)
    assert queue.at(SECOND) is None
    queue.add(0, REFERENCE)
    assert [queue.at(k * SECOND) for k in (2, 9, 10)] == [REFERENCE] * 3


#: a scenario's three set-points, the first of them "at once"; issued 100 ns, 101 ns and 102 ns
SCENARIO = [(0, REFERENCE, 100), (3 * SECOND, OTHER, 101), (20 * SECOND, THIRD, 102)]


@pytest.mark.parametrize("tick_between", [False, True])
def test_late_joiner_finds_the_set_points_in_force_in_any_order(tick_between):
    refusals = [
        *SCENARIO,
        (3 * SECOND, OTHER, 101),
    ]  # the last one by the supervisor, with the time of issue
    for order in itertools.permutations(refusals):
        queue = ReferenceQueue()
        for item in order:
            queue.add(*item)
            if tick_between:
                queue.at(10 * SECOND)
        assert [queue.at(k * SECOND) for k in (11, 19, 20)] == [OTHER, OTHER, THIRD], order
        assert queue.issued_ns == 102, order


def test_manual_override_holds_for_late_joiners():
    by_hand = Reference(2.71, 820.0)
    for order in itertools.permutations([*SCENARIO, (10 * SECOND, by_hand, 200)]):
        queue = ReferenceQueue()
        for item in order:
            queue.add(*item)
        assert [queue.at(k * SECOND) for k in (11, 20, 21)] == [by_hand] * 3, order


def test_lost_set_point_is_not_taken_from_other_nodes():
    queue = ReferenceQueue()
    queue.add(0, REFERENCE, 100)
    queue.add(0, OTHER, 200)
    assert queue.at(5 * SECOND) == OTHER
    queue.add(
        6 * SECOND, REFERENCE, 100
    )  # restarted, it knows only the sender that is still there
    assert queue.at(7 * SECOND) == OTHER


def test_set_points_survive_a_time_reset():
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
def test_late_joiner_follows_the_same_set_points(stamps_s, random, start_s):
    """All messages reach one listener as they are issued, and a later one at its start, in any order."""
    messages = [
        (stamp_s * SECOND, Reference(1.0 + k, 800.0), k) for k, stamp_s in enumerate(stamps_s)
    ]
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


def test_plan_returns_a_limited_number_of_coming_set_points():
    steps = [Reference(2.66 + 0.01 * k, 816.4) for k in range(20)]
    plan = ReferencePlan([(10 * k * TICK_NS, steps[k]) for k in range(1, 20)])
    assert [round(point.at_s) for point in plan.after(0, steps[0])] == [1, 2, 3, 4, 5, 6, 7, 8]
    assert plan.after(10 * TICK_NS, steps[1])[0] == Coming(2.0, 2.68, 816.4)
    assert [round(point.at_s) for point in plan.after(185 * TICK_NS, steps[18])] == [19]
    assert plan.after(190 * TICK_NS, steps[19]) == () == ReferencePlan().after(0, steps[0])


def test_a_plan_that_does_not_come_true_is_not_believed():
    planned = [(50 * TICK_NS, Reference(2.66, 826.4)), (150 * TICK_NS, Reference(2.66, 836.4))]
    plan = ReferencePlan(planned)
    assert len(plan.after(40 * TICK_NS, Reference(2.7, 816.4))) == 2  # nothing of it is due yet
    assert plan.after(50 * TICK_NS, Reference(2.66, 816.4)) == ()
    assert plan.after(60 * TICK_NS, Reference(2.7, 826.4)) == ()
    assert len(plan.after(60 * TICK_NS, planned[0][1])) == 1


def test_whether_any_is_known():
    queue = ReferenceQueue()
    assert not queue and (queue.issued_ns, queue.mark) == (0, "")
    queue.add(SECOND, REFERENCE)
    assert queue, "one waits"
    assert queue.at(SECOND) == REFERENCE and queue, "one holds"


@pytest.mark.parametrize(("ahead_ns", "accepted"), [(0, True), (1, False)])
def test_the_widest_clocks_and_stamps_that_are_believed(ahead_ns, accepted):
    refusals: list[Fact] = []
    queue = ReferenceQueue(AHEAD_REAL_NS, refusals.append)
    queue.join(WALL - 100 * SECOND)
    queue.at(WALL)
    assert queue.receive(0, REFERENCE, WALL + OWN_CLOCK_NS + ahead_ns, WALL) == accepted
    assert queue.receive(WALL + AHEAD_REAL_NS + ahead_ns, OTHER, WALL, WALL) == accepted
    assert len(refusals) == (0 if accepted else 2)


def test_the_oldest_that_was_just_sent_is_the_last_received():
    queue = ReferenceQueue()
    queue.join(WALL - 100 * SECOND)
    assert queue.receive(0, REFERENCE, WALL, WALL) and queue.at(WALL) == REFERENCE
    assert queue.receive(0, OTHER, WALL - OWN_CLOCK_NS, WALL) and queue.at(WALL) == OTHER
    assert not queue.receive(0, THIRD, WALL - OWN_CLOCK_NS - 1, WALL) and queue.at(WALL) == OTHER


@pytest.mark.parametrize(("after_ns", "holds"), [(-1, OTHER), (0, THIRD)])
def test_shortly_after_the_start_the_order_is_that_of_publication(after_ns, holds):
    queue = ReferenceQueue()
    queue.join(WALL)
    now = WALL + OWN_CLOCK_NS + 10
    assert queue.receive(0, OTHER, WALL + OWN_CLOCK_NS + after_ns, now) and queue.at(now) == OTHER
    queue.receive(0, THIRD, WALL + OWN_CLOCK_NS + min(2 * after_ns, 0), now)
    assert queue.at(now) == holds


def test_set_points_older_than_the_first_are_dropped_silently():
    refusals: list[Fact] = []
    queue = ReferenceQueue(refuse=refusals.append)
    assert queue.receive(0, REFERENCE, WALL, WALL) and queue.at(WALL) == REFERENCE
    assert not queue.receive(0, OTHER, WALL - 1, WALL + OWN_CLOCK_NS)
    assert queue.receive(0, REFERENCE, WALL, WALL + OWN_CLOCK_NS), (
        "a repetition of the one that holds"
    )
    assert (refusals, queue.at(WALL)) == ([], REFERENCE)
    assert not queue.receive(0, OTHER, WALL - 1, WALL + OWN_CLOCK_NS + 1)
    assert len(refusals) == 1


@pytest.mark.parametrize("late_s", [0, 50])
def test_a_mark_goes_with_its_set_point(late_s):
    queue = ReferenceQueue()
    queue.join(WALL - 100 * SECOND)
    queue.receive(0, REFERENCE, WALL - late_s * SECOND, WALL, "page 3")
    assert (queue.at(WALL), queue.mark) == (REFERENCE, "page 3")
    queue.receive(0, OTHER, WALL + SECOND, WALL + SECOND)
    assert (queue.at(WALL + SECOND), queue.mark) == (OTHER, "")


def test_only_the_next_treads_of_a_stair_count_as_near():
    plan = ReferencePlan([(k * SECOND // 2, Reference(2.0 + 0.1 * k, 816.4)) for k in range(9)])
    believed = [
        bool(plan.after(2 * SECOND, Reference(2.4 + off, 816.4)))
        for off in (-0.35, -0.25, 0.25, 0.35)
    ]
    assert believed == [False, True, True, False]


@pytest.mark.parametrize("in_force", [False, True])
def test_the_same_place_without_a_mark_keeps_the_mark(in_force):
    queue = ReferenceQueue()
    queue.add(0, REFERENCE, 5, "page 3")
    if in_force:
        queue.at(0)
    queue.add(0, REFERENCE, 5)
    queue.at(0)
    assert queue.mark == "page 3"
    queue.add(0, OTHER, 6)
    queue.add(0, THIRD, 5, "page 4")
    assert (queue.at(0), queue.mark, queue.issued_ns) == (OTHER, "", 6)


def test_a_set_point_in_force_that_is_heard_again_with_a_mark_gets_it():
    queue = ReferenceQueue()
    queue.add(0, REFERENCE, 5)
    queue.at(0)
    queue.add(0, REFERENCE, 5, "page 3")
    queue.at(TICK_NS)
    assert queue.mark == "page 3"


def test_a_mark_is_kept_once_however_often_its_set_point_is_heard():
    queue = ReferenceQueue()
    queue.add(0, REFERENCE, 5, "page 3")
    for _ in range(3):
        queue.add(0, REFERENCE, 5)
    queue.at(0)
    assert queue.mark == "page 3"


def test_last_of_equal_set_points_decides_the_start():
    queue = ReferenceQueue()
    queue.add(0, REFERENCE, 4)
    queue.at(0)
    for stamp_s in (3, 2):
        queue.add(stamp_s * SECOND, OTHER, 5)
    assert [queue.at(k * SECOND) for k in (1, 2)] == [REFERENCE, OTHER]


def test_a_stamp_at_the_horizon_waits():
    queue = ReferenceQueue(AHEAD_REAL_NS)
    queue.add(AHEAD_REAL_NS, REFERENCE)
    assert queue.at(0) is None
    assert queue.at(AHEAD_REAL_NS) == REFERENCE
