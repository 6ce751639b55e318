"""The order in which the messages of a tick arrive does not matter."""

from math import nan

import pytest

from fsw_control.contract import Command
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.tick import ProposalInput

STEP_NS = 100_000_000
STEADY = Command(78.4, 407.5)
SAMPLES = {"depth": 2.66, "torque": 1050.0, "thermocouple": 850.0}


class Ticks:
    """Ticks of an arbiter with two controllers.

    ``proposals_first`` is one order of the messages, else the other.
    """

    def __init__(self):
        self.arbiter = Arbiter(
            SupervisorParameters.from_values(
                {"warm_ticks": 3, "takeover_wait_s": 0.0, "first_report_wait_s": 0.0}
            )
        )
        self.now_s, self.stamp_ns = 50.0, 10**15

    def tick(self, proposals_first=False, after_ns=STEP_NS, **commands):
        arbiter, now_s = self.arbiter, self.now_s
        self.now_s, self.stamp_ns = now_s + 0.1, self.stamp_ns + after_ns
        stamp_ns = self.stamp_ns
        measured = [lambda: arbiter.on_drives(stamp_ns, STEADY, now_s)]
        measured += [
            lambda s=s, v=v: arbiter.on_sample(s, stamp_ns, v, now_s) for s, v in SAMPLES.items()
        ]
        proposed = [
            lambda n=n: arbiter.on_proposal(
                n, ProposalInput(stamp_ns, n, commands.get(n, STEADY)), now_s
            )
            for n in ("nmpc", "decentral")
        ]
        messages = [*proposed, *measured] if proposals_first else [*measured, *reversed(proposed)]
        decisions = [decision for message in messages for decision in message()]
        while not decisions and (at_s := arbiter.wakeup_s) is not None:
            decisions += arbiter.on_time(at_s)
        return [(decision.source, decision.command) for decision in decisions]


@pytest.mark.parametrize("proposals_first", [False, True])
def test_at_a_start_a_jump_from_the_drives_is_refused(proposals_first):
    assert Ticks().tick(proposals_first, decentral=Command(76.9, 407.5)) == [("hold", STEADY)]


@pytest.mark.parametrize("proposals_first", [False, True])
def test_a_fallback_is_ready_by_what_it_proposed_before_the_tick(proposals_first):
    ticks = Ticks()
    ticks.tick()
    ticks.tick()
    assert ticks.tick(proposals_first, decentral=Command(nan, nan)) == [("hold", STEADY)]
    assert ticks.tick(proposals_first) == [("nmpc", STEADY)]


@pytest.mark.parametrize("proposals_first", [False, True])
def test_where_the_clock_goes_back_a_proposal_may_come_before_its_measurement(proposals_first):
    ticks = Ticks()
    for _ in range(5):
        ticks.tick()
    assert ticks.tick(proposals_first, after_ns=-3600 * 10**9) == [("decentral", STEADY)]
    assert ticks.tick(proposals_first) == [("decentral", STEADY)]
