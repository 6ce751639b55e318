"""A controller that starts in mid-weld, while the power is moving.

It proposes once it knows the heat.
"""

import pytest

from fsw_control import Command, Reference
from fsw_control.reason import ReasonCode
from fsw_nmpc import NmpcController
from fsw_test_support.nmpc_loop import TARGET, Loop

#: a rise of the set-point that takes the power up, and the ticks after which its controller dies
WARMER, BEFORE, LONGEST = Reference(2.66, 826.4), 30, 100
#: ticks of the dead time
DEAD_TICKS = 28


def restarted(rejoins, values=None):
    """A loop whose controller is a new one, three seconds after a rise of the set-point."""
    loop = Loop(NmpcController(values))
    for _ in range(10):
        loop.step()
    for _ in range(BEFORE):
        loop.step(WARMER)
    loop.controller = NmpcController(values)
    loop.controller.reset(loop.applied)
    if rejoins:
        loop.controller.rejoin()
    return loop


def step_until_healthy(loop, reference=WARMER, slower_ticks=0):
    """Another controller's command until a proposal is healthy; returns the proposals.

    For some ticks it lowers the speed, then it holds.
    """
    proposals = []
    while len(proposals) < LONGEST:
        slower_rpm = 3.0 if len(proposals) < slower_ticks else 0.0
        command = Command(loop.applied.force_kn, loop.applied.speed_rpm - slower_rpm)
        proposals.append(loop.step(reference, follow=command))
        if proposals[-1].healthy:
            break
    return proposals


@pytest.mark.slow
@pytest.mark.parametrize("slower_ticks", [0, 15])
def test_delayed_power_is_not_estimated_as_heat(slower_ticks):
    """The process has none of it: what a first healthy proposal is based on is its error."""
    heat_kw = {}
    for rejoins in (False, True):
        loop = restarted(rejoins)
        proposals = step_until_healthy(loop, slower_ticks=slower_ticks)
        assert proposals[-1].healthy
        heat_kw[rejoins] = abs(proposals[-1].diagnosis.disturbances["power_kw"])
    assert heat_kw[False] > 3.0
    assert heat_kw[True] < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["default", "paper", "paper:letter"])
def test_rejoining_takes_a_dead_time_and_a_few_seconds(preset):
    proposals = step_until_healthy(restarted(True, {"preset": preset}))
    assert DEAD_TICKS < len(proposals) < DEAD_TICKS + 40
    assert {proposal.reason.code for proposal in proposals[:-1]} == {ReasonCode.REJOINING}
    assert proposals[-1].healthy


@pytest.mark.slow
def test_rejoining_waits_while_sensors_are_missing():
    loop = restarted(True)
    for _ in range(40):
        blind = loop.step(WARMER, follow=loop.applied, depth_valid=False)
        assert blind.reason.code == ReasonCode.WAITING_FOR_SENSORS
    assert len(step_until_healthy(loop)) > DEAD_TICKS


@pytest.mark.slow
def test_reset_ends_rejoining():
    loop = restarted(True)
    loop.step(WARMER, follow=loop.applied)
    loop.controller.reset(loop.applied)
    assert loop.step(TARGET).healthy
