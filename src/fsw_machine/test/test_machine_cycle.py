"""The cycle counter is followed, its phase found and kept; stamps rise whatever the server's clock does."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_machine.cycle import CycleTracker
from fsw_machine.stamps import STEP_NS, Stamps

PERIOD_S, TICK_NS = 0.1, 100_000_000


def poll(tracker, changes, end_s, read_time_s=0.001, start_s=0.0):
    """Poll a counter that changes at given times; returns the delays with which that was seen, and the reads."""
    delays, reads, now_s = {}, 0, start_s
    while now_s < end_s:
        count = sum(one <= now_s for one in changes)
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
        *(0, None, 1, None),
        *(3, None, 0, 1),
    ]
    assert (tracker.skipped, tracker.restarts) == (2, 1)


def test_a_machine_that_stands_still_is_polled_slowly():
    tracker = CycleTracker(PERIOD_S)
    delays, reads = poll(tracker, [0.1, 0.2], 2.2)
    assert len(delays) == 2 and reads < 300
    delays, _ = poll(tracker, [0.1, 0.2, 3.0, 3.1, 3.2], 3.25, start_s=2.2)
    assert tracker.skipped == 0 and all(delay < 0.02 for delay in delays)


@pytest.mark.requirement("S15")
@given(
    moves=st.lists(
        st.tuples(
            st.integers(1, 40), st.integers(-20_000_000, 20_000_000), st.sampled_from([0, 0, 0, 10**12, -(10**12)])
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


@pytest.mark.parametrize("source_ns", [-(10**13), 10**13])
def test_a_machine_that_was_started_again_with_another_clock(source_ns):
    stamps = Stamps(TICK_NS)
    stamps.next(10**18, 0, 0, 0)
    assert stamps.next(10**18 + source_ns, 0, 0, 30 * TICK_NS) == 10**18 + 30 * TICK_NS
    assert stamps.steps == 1
