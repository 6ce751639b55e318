"""Set-points of a programme over any sequence of holds, resumes and set-points by hand."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from fsw_control.contract import Reference
from fsw_control.ramps import duration_s, ramp
from fsw_control.ranges import WELD_RATE_DEPTH_MM_PER_S, WELD_RATE_TEMPERATURE_C_PER_S
from fsw_control.references import ReferenceQueue
from fsw_scenario.weld_programme import Phase, PhaseMachine
from fsw_scenario.weld_programme_course import Course

TICK_NS = 100_000_000
START = Reference(2.66, 816.4)
#: at the permitted rate up from tick 100, and depth down from tick 600
PROGRAMME = (
    {0: START}
    | {100 + k: Reference(2.66, 816.4 + 0.1 * k) for k in range(1, 201)}
    | {600 + k: Reference(2.66 - 0.001 * k, 836.4) for k in range(1, 61)}
)
BY_HAND = Reference(2.60, 805.0)


class Weld:
    """A player as in the node, and what the controllers follow."""

    def __init__(self, programme=PROGRAMME):
        self.course = Course(programme)
        self.machine = PhaseMachine([Phase(name="dwell", duration_s=100.0)])
        self.queue = ReferenceQueue()
        self.number = 0
        self.send_ahead()

    @property
    def in_force(self):
        return self.queue.at(self.number * TICK_NS)

    def send_ahead(self):
        while self.course.coming and self.course.coming[0][0] <= self.machine.tick + 50:
            tick, reference = self.course.coming.popleft()
            self.queue.add((tick + self.machine.held) * TICK_NS, reference)

    def restart(self, present):
        self.queue.add(0, present)
        self.send_ahead()

    def hold(self):
        if self.machine.hold().ok:
            present = self.in_force
            self.course.leave()
            self.restart(present)

    def resume(self):
        if self.machine.resume().ok or (
            not self.course.followed and self.machine.state == "running"
        ):
            way = self.course.resume(present := self.in_force, self.machine.tick)
            self.restart(present)
            return way
        return None

    def by_hand(self, goal, ramped):
        start = self.in_force
        self.queue.add(0, start if ramped else goal)
        if ramped and start != goal:
            for stamp_ns, reference in ramp(start, goal, (self.number + 5) * TICK_NS):
                self.queue.add(stamp_ns, reference)
        self.course.leave()

    def tick(self):
        self.number += 1
        self.machine.follow(self.number)
        self.send_ahead()
        return self.in_force

    @property
    def programme(self):
        return self.course.programme_at(self.machine.tick)


def moved_too_fast(before, after):
    depth, temperature = (
        abs(after.depth_mm - before.depth_mm),
        abs(after.temperature_c - before.temperature_c),
    )
    return (
        depth > 0.1 * WELD_RATE_DEPTH_MM_PER_S + 1e-9
        or temperature > 0.1 * WELD_RATE_TEMPERATURE_C_PER_S + 1e-9
    )


@pytest.mark.requirement("S29")
def test_resume_after_a_manual_ramp_returns_and_the_next_hold_does_not_step():
    """In the end phase: ramp to 2.60 mm, 805 degC, resume before it is over; then hold again."""
    weld = Weld()
    for _ in range(350):
        weld.tick()
    weld.hold()
    weld.by_hand(BY_HAND, ramped=True)
    for _ in range(100):
        weld.tick()
    begun = weld.in_force
    way = weld.resume()
    assert way.start == begun != BY_HAND and way.goal == Reference(2.66, 836.4)
    assert way.duration_s == pytest.approx(0.5 + duration_s(begun, way.goal), abs=0.11)
    for _ in range(round(way.duration_s / 0.1)):
        before = weld.in_force
        assert not moved_too_fast(before, weld.tick())
    assert weld.in_force == weld.programme
    before = weld.in_force
    weld.hold()
    assert weld.tick() == before


def test_after_a_dwell_that_ended_early_only_the_depth_returns_by_a_ramp():
    """A ramp of the temperature from where its own was cut short would cool the copper first."""
    cut = Reference(2.64, 821.4)
    way = Course(PROGRAMME).resume(cut, 650, warm=True)
    first, last = min(way.changes), max(way.changes)
    assert first <= 656 and last - first > 1  # both move; the depth more than one step
    assert {reference.temperature_c for reference in way.changes.values()} == {836.4}
    moved = np.abs(
        np.diff([cut.depth_mm, *(reference.depth_mm for reference in way.changes.values())])
    )
    assert moved.max() <= 0.1 * WELD_RATE_DEPTH_MM_PER_S + 1e-9
    assert way.changes[last] == way.goal == Course(PROGRAMME).programme_at(last)


@pytest.mark.requirement("S29")
def test_resume_without_manual_set_points_follows_the_programme():
    weld = Weld()
    for _ in range(90):
        weld.tick()
    weld.hold()
    for _ in range(1000):
        assert weld.tick() == START
    way = weld.resume()
    assert (way.changes, way.duration_s, way.goal) == ({}, 0.0, weld.programme)
    assert way.fact.code == "followed"
    for _ in range(600):
        assert weld.tick() == weld.programme


actions = st.one_of(
    st.sampled_from(["hold", "resume"]),
    st.integers(1, 150),
    st.tuples(st.floats(2.5, 2.8), st.floats(800.0, 840.0), st.booleans()),
)


@pytest.mark.requirement("S29")
@given(st.lists(actions, max_size=12))
@example(
    [81, 150, 150, 150, 150, (2.5, 800.0, False)]
)  # the way back is longer than what is left of the programme
def test_set_points_in_force_move_at_the_permitted_rates_unless_by_a_step_by_hand(sequence):
    weld, stepped = Weld(), False
    before = weld.in_force
    for action in [*sequence, "hold", "resume"]:
        if action == "hold":
            weld.hold()
        elif action == "resume":
            way = weld.resume()
        elif isinstance(action, tuple):
            depth_mm, temperature_c, ramped = action
            weld.by_hand(Reference(depth_mm, temperature_c), ramped)
            stepped = not ramped
        for _ in range(action if isinstance(action, int) else 1):
            after = weld.tick()
            assert stepped or not moved_too_fast(before, after)
            before, stepped = after, False
    if weld.machine.state == "running" and way is not None:
        assert way.duration_s <= 100.0 + duration_s(way.start, way.goal)
        for _ in range(round(way.duration_s / 0.1)):
            after = weld.tick()
            assert not moved_too_fast(before, after)
            before = after
        assert after == weld.programme or weld.machine.state == "done"
