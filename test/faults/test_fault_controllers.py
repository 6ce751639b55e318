"""Controllers that die, stop or lie: what reached the plant, tick by tick."""

from __future__ import annotations

import math
import signal

import pytest

from fsw_control import messages_ros as convert
from fsw_control.cause import Cause
from fsw_control.reason import ReasonCode

DEADLINE = "no proposal at the deadline"
IN_REAL_TIME = (pytest.mark.full, pytest.mark.real_time)
FALLBACK = "fallback in the same tick, inhibited"


@pytest.mark.requirement("S5")
@pytest.mark.full
@pytest.mark.real_time
def test_a_nominal_weld_loses_nothing(launch, table):
    weld = launch(standby=True)
    first = weld.restore()
    weld.ticks(30)
    outcome = weld.outcome(first)
    outcome.assert_steady(depth_mm=0.1)
    outcome.assert_sources("decentral")
    weld.until(
        lambda: weld.node.count_publishers("/fsw/command") == 1, "a standby that publishes nothing"
    )
    table.add("none (nominal weld)", "–", "–", outcome)


@pytest.mark.requirement("S12")
@pytest.mark.parametrize("lockstep", [pytest.param(False, marks=IN_REAL_TIME), True])
def test_swaps_in_both_directions_during_a_depth_step(launch, table, lockstep):
    weld = launch(lockstep=True) if lockstep else launch(standby=True)
    first = weld.restore()
    weld.refer(2.7)
    weld.ticks(5)
    weld.switch("nmpc")
    weld.ticks(10)
    weld.switch("decentral")
    weld.ticks(10)
    outcome = weld.outcome(first)
    weld.refer(2.66)
    outcome.assert_steady()
    outcome.assert_sources("decentral", "nmpc", "decentral")
    table.add("swap in both directions during a step of the depth by 0.04 mm", "–", "–", outcome)


@pytest.mark.requirement("S6")
@pytest.mark.parametrize(
    "number", [signal.SIGKILL, pytest.param(signal.SIGSTOP, marks=pytest.mark.full)]
)
@pytest.mark.parametrize(("active", "other"), [("decentral", "nmpc"), ("nmpc", "decentral")])
@pytest.mark.parametrize("lockstep", [pytest.param(False, marks=IN_REAL_TIME), True])
def test_the_active_controller_is_killed_or_stopped(
    launch, table, active, other, number, lockstep
):
    weld = launch(lockstep=True) if lockstep else launch(standby=True)
    weld.restore()
    before = len(weld.states)
    first = weld.switch(active)
    weld.ticks(5)
    weld.signal(active, number)
    weld.until(lambda: weld.source() == other, what="the fallback")
    weld.ticks(10)
    if number == signal.SIGSTOP:
        weld.signal(active, signal.SIGCONT)
        weld.ticks(10)
    outcome = weld.outcome(first)
    outcome.assert_steady()
    outcome.assert_sources(active, other)
    assert (
        any(state.cause == Cause.SWAP_FAILED for state in weld.states[before:])
        or not outcome.exact
    )
    verb = "killed (-9)" if number == signal.SIGKILL else "stopped and continued"
    where = ", lockstep" if lockstep else ""
    table.add(f"`{active}`, in command, {verb}{where}", DEADLINE, FALLBACK, outcome)


def not_finite(weld):
    def send(proposal):
        proposal.axial_force = math.nan
        weld.proposals.publish(proposal)

    return send


def late(weld):
    """A proposal comes with the next tick.

    In lockstep only once its own was decided without it.
    """
    kept = []

    def send(proposal):
        if kept and kept[0].header.stamp != proposal.header.stamp:
            weld.proposals.publish(kept.pop())
        kept[:] = kept or [proposal]

    return send


def old_stamps(weld):
    stamp = convert.stamp_from_ns(max(weld.commands))

    def send(proposal):
        proposal.header.stamp = stamp
        weld.proposals.publish(proposal)

    return send


def too_fast(weld):
    def send(proposal):
        proposal.axial_force += 1500.0
        weld.proposals.publish(proposal)

    return send


@pytest.mark.requirement("S6")
@pytest.mark.parametrize(
    ("behaviour", "fault", "detected"),
    [
        (not_finite, "proposes NaN", "check of the proposal"),
        (late, "late by a tick", DEADLINE),
        (old_stamps, "repeats an old stamp", "the stamp is not the tick's"),
        (too_fast, "proposes a jump of 1.5 kN", "check of the proposal"),
    ],
)
def test_a_controller_lies(steps, table, behaviour, fault, detected):
    weld = steps
    weld.restore()
    first = weld.switch("rogue")
    weld.ticks(5)
    weld.misbehave = behaviour(weld)
    weld.until(lambda: weld.source() == "decentral", what="the fallback")
    weld.ticks(10)
    outcome = weld.outcome(first)
    outcome.assert_steady()
    outcome.assert_sources("rogue", "decentral")
    table.add(f"a controller in command {fault}", detected, FALLBACK, outcome)


def test_two_controllers_of_one_name(steps, table):
    weld = steps
    weld.restore()
    first = weld.switch("rogue")

    def twice(proposal):
        weld.proposals.publish(proposal)
        proposal.axial_force += 300.0
        weld.proposals.publish(proposal)

    weld.misbehave = twice
    weld.until(lambda: weld.source() == "decentral", what="the fallback")
    weld.ticks(5)
    outcome = weld.outcome(first)
    outcome.assert_steady()
    weld.until(
        lambda: ReasonCode.NAMESAKE in [why.code for why in weld.states[-1].why], "the reason"
    )
    detected = "different proposals to one stamp, 3 ticks in a row"
    table.add("two controllers of one name", detected, "the first counts, then fallback", outcome)
