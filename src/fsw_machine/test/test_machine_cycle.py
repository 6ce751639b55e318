"""The cycle counter is followed, its phase found and kept.

Stamps rise whatever the server's clock does.
"""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_machine.samples import LEAD_S, NEAR_S, OVERDUE_S, STEP_NS, CycleTracker, Stamps

PERIOD_S, TICK_NS = 0.1, 100_000_000


def poll(tracker, changes, end_s, read_time_s=0.001, start_s=0.0):
    """Poll a counter that changes at given times.

    Returns the delays with which that was seen, and the reads.
    """
    delays, reads, now_s = {}, 0, start_s
    while now_s < end_s:
        count = sum(change <= now_s for change in changes)
        now_s += read_time_s
        reads += 1
        if tracker.see(count, now_s) is not None and count:
            delays[count] = now_s - changes[count - 1]
        now_s = max(now_s, tracker.next_poll_s(now_s))
    return list(delays.values()), reads


@given(
    phase_s=st.floats(0.0, 0.1),
    drift=st.floats(-5e-4, 5e-4),
    jitter_s=st.lists(st.floats(0.0, 0.002), min_size=200, max_size=200),
)
def test_a_change_is_seen_soon_and_with_few_reads(phase_s, drift, jitter_s):
    changes = [phase_s + PERIOD_S * (1.0 + drift) * (k + 1) + jitter_s[k] for k in range(200)]
    tracker = CycleTracker(PERIOD_S)
    delays, reads = poll(tracker, changes, changes[-1] + 0.001)
    late = [delay for delay in delays[20:] if delay > 0.005]
    assert tracker.skipped == 0 and len(late) <= 4
    assert reads < 8 * 200 + 60


def test_every_change_counts_once():
    tracker = CycleTracker(PERIOD_S)
    assert [tracker.see(value, i / 10) for i, value in enumerate([7, 7, 8, 8, 11, 11, 3, 4])] == [
        0,
        None,
        1,
        None,
        3,
        None,
        0,
        1,
    ]
    assert (tracker.skipped, tracker.restarts) == (2, 1)


def test_a_machine_that_stands_still_is_polled_slowly():
    tracker = CycleTracker(PERIOD_S)
    delays, reads = poll(tracker, [0.1, 0.2], 2.2)
    assert len(delays) == 2 and reads < 300
    delays, _ = poll(tracker, [0.1, 0.2, 3.0, 3.1, 3.2], 3.25, start_s=2.2)
    assert tracker.skipped == 0 and all(delay < 0.02 for delay in delays)


def test_restarts_are_counted_except_the_first_value():
    tracker = CycleTracker(PERIOD_S)
    assert [tracker.see(value, i / 10) for i, value in enumerate([9, 3, 4, 1, 2])] == [
        0,
        0,
        1,
        0,
        1,
    ]
    assert (tracker.skipped, tracker.restarts) == (0, 2)


def test_a_counter_of_64_bits_begins_again_after_its_largest_value():
    tracker = CycleTracker(PERIOD_S)
    assert [tracker.see(value, i / 10) for i, value in enumerate([2**64 - 1, 0, 1])] == [0, 1, 1]
    assert tracker.restarts == 0


@pytest.mark.parametrize(("step", "steps", "restarts"), [(127, 127, 0), (128, 0, 1), (255, 0, 1)])
def test_a_step_by_half_of_a_counters_values_or_more_counts_as_back(step, steps, restarts):
    tracker = CycleTracker(PERIOD_S)
    tracker.values = 256
    tracker.see(200, 0.0)
    assert tracker.see((200 + step) % 256, 0.1) == steps
    assert tracker.restarts == restarts


def test_before_the_counter_could_be_read_the_server_is_asked_slowly():
    assert CycleTracker(PERIOD_S).next_poll_s(5.0) == 5.0 + OVERDUE_S


@pytest.mark.parametrize(
    ("read_s", "next_s"),
    [
        (0.03, PERIOD_S - LEAD_S),  # a change is far: wait until shortly before it
        (0.098, 0.098 + NEAR_S),
        (0.101, 0.101 + NEAR_S),  # due
        (0.149, 0.149 + NEAR_S),
        (0.151, 0.151 + OVERDUE_S),
    ],
)
def test_the_server_is_asked_often_only_while_a_change_is_near(read_s, next_s):
    tracker = CycleTracker(PERIOD_S)
    tracker.see(7, 0.0)
    assert tracker.next_poll_s(read_s) == pytest.approx(next_s)


def expected_after(*changes):
    """When the next change is expected after changes by so many cycles, seen at such times while they were awaited."""
    tracker, counter = CycleTracker(PERIOD_S), 100
    tracker.see(counter, 0.0)
    for steps, read_s in changes:
        tracker.see(counter, read_s - NEAR_S)
        counter += steps
        tracker.see(counter, read_s)
    return tracker.next_poll_s(read_s) + LEAD_S


def test_one_late_change_hardly_moves_when_the_next_is_expected():
    assert expected_after((1, 0.12)) == pytest.approx(0.2 + 0.2 * 0.02)
    assert expected_after((1, 0.14)) == pytest.approx(0.2 + 0.2 * 0.04)


@pytest.mark.parametrize(("steps", "read_s"), [(1, 0.16), (3, 0.13), (2, 0.21), (-5, 0.12)])
def test_phase_is_found_again_after_an_interruption(steps, read_s):
    assert expected_after((steps, read_s)) == pytest.approx(read_s + PERIOD_S)


def test_unexpected_change_moves_the_next_read_earlier():
    tracker = CycleTracker(PERIOD_S)
    tracker.see(7, 0.0)
    tracker.see(8, 0.1)
    assert tracker.next_poll_s(0.1) == pytest.approx(0.2 - 2 * LEAD_S)
    tracker.see(9, 0.1 + 0.12)  # late, but nobody had looked since: it may have changed in time
    assert tracker.next_poll_s(0.22) == pytest.approx(0.3 - 3 * LEAD_S)


def test_a_change_that_was_awaited_again_is_looked_for_no_earlier():
    tracker = CycleTracker(PERIOD_S)
    for counter, read_s in [(7, 0.0), (8, 0.1), (8, 0.19), (9, 0.196), (9, 0.29), (10, 0.296)]:
        tracker.see(counter, read_s)
    assert tracker.next_poll_s(0.296) == pytest.approx(0.396 - LEAD_S)


@pytest.mark.requirement("S15")
@given(
    moves=st.lists(
        st.tuples(
            st.integers(1, 40),
            st.integers(-20_000_000, 20_000_000),
            st.sampled_from([0, 0, 0, 10**12, -(10**12)]),
        ),
        min_size=1,
        max_size=60,
    ),
    received=st.booleans(),
    start_ns=st.integers(0, 2**61),
)
def test_stamps_rise_with_the_cycles_whatever_the_clock_does(moves, received, start_ns):
    stamps = Stamps(TICK_NS, received)
    local_ns, clock_ns = 5 * 10**17, start_ns
    seen = [stamps.next(clock_ns, 0, local_ns, 0)]
    assert seen[0] == (local_ns if received else start_ns)
    for steps, jitter_ns, set_ns in moves:
        local_ns += steps * TICK_NS
        clock_ns += steps * TICK_NS + set_ns
        seen.append(stamps.next(clock_ns + jitter_ns, steps, local_ns, steps * TICK_NS))
    for (before, after), (steps, _, _) in zip(pairwise(seen), moves, strict=True):
        assert after > before and abs(after - before - steps * TICK_NS) <= STEP_NS
    assert stamps.steps == sum(bool(set_ns) for _, _, set_ns in moves)


def test_a_late_cycle_is_not_a_step_of_the_clock():
    stamps = Stamps(TICK_NS)
    stamps.next(0, 0, 0, 0)
    assert stamps.next(2 * TICK_NS, 1, 0, 2 * TICK_NS) == 2 * TICK_NS
    assert stamps.steps == 0


START_NS = 10**18


@pytest.mark.requirement("S15")
@pytest.mark.parametrize(
    ("moved_ns", "steps", "elapsed_ns", "goes_on_ns"),
    [
        (10**12, 3, 4 * TICK_NS, 3 * TICK_NS),  # set: on by what was counted
        (-(10**12), 3, 4 * TICK_NS, 3 * TICK_NS),
        (10**12, 0, 4 * TICK_NS, 4 * TICK_NS),  # not counted: on by what has passed
        (10**12, 0, 0, TICK_NS),  # by a cycle at least
        (0, 1, TICK_NS, TICK_NS),  # a timestamp that stands still
        (TICK_NS + STEP_NS + 10_000_000, 1, TICK_NS, TICK_NS),
        (3 * TICK_NS - STEP_NS - 10_000_000, 3, 3 * TICK_NS, 3 * TICK_NS),
    ],
)
def test_stamps_continue_after_the_machine_clock_was_set(moved_ns, steps, elapsed_ns, goes_on_ns):
    stamps = Stamps(TICK_NS)
    stamps.next(START_NS, 0, 0, 0)
    assert stamps.next(START_NS + moved_ns, steps, 0, elapsed_ns) == START_NS + goes_on_ns
    assert (stamps.steps, stamps.shift_ns) == (1, goes_on_ns - moved_ns)
    assert (
        stamps.next(START_NS + moved_ns + TICK_NS, 1, 0, TICK_NS)
        == START_NS + goes_on_ns + TICK_NS
    )
    assert stamps.steps == 1


@pytest.mark.parametrize(
    ("moved_ns", "steps", "elapsed_ns"),
    [
        (TICK_NS + STEP_NS - 10_000_000, 1, TICK_NS),
        (10 * TICK_NS, 10, TICK_NS),  # as counted, but heard late
        (10 * TICK_NS, 1, 10 * TICK_NS),  # as has passed, whatever was counted
        (1, 1, TICK_NS),
    ],
)
def test_timestamps_that_agree_with_the_cycles_or_the_time_that_has_passed_are_taken_as_they_are(
    moved_ns, steps, elapsed_ns
):
    stamps = Stamps(TICK_NS)
    stamps.next(START_NS, 0, 0, 0)
    assert stamps.next(START_NS + moved_ns, steps, 0, elapsed_ns) == START_NS + moved_ns
    assert (stamps.steps, stamps.shift_ns) == (0, 0)


@pytest.mark.parametrize("source_ns", [-(10**13), 10**13])
def test_a_machine_that_was_started_again_with_another_clock(source_ns):
    stamps = Stamps(TICK_NS)
    stamps.next(10**18, 0, 0, 0)
    assert stamps.next(10**18 + source_ns, 0, 0, 30 * TICK_NS) == 10**18 + 30 * TICK_NS
    assert stamps.steps == 1
