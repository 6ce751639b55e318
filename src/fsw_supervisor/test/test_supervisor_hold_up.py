"""A leader that was held up.

The actuator end refuses what it sends if another one has taken over meanwhile.
"""

import pytest

from fsw_control.contract import Command
from fsw_control.fence import Signature
from fsw_supervisor.failover import LISTEN_S, Role
from fsw_supervisor.state_machine import Mode

HELD_UP_S = 0.3


def take_over(fence, times=1):
    """Let another supervisor command."""
    for _ in range(times):
        term = fence.state.term + 1
        assert fence.check(Signature(term, "other", fence.register.value), "nmpc") is None
        fence.take("nmpc", 0)


@pytest.mark.requirement("S9", "S12")
def test_commands_of_a_deposed_leader_are_refused_and_it_stands_by(leader):
    leader.sleep(HELD_UP_S)
    take_over(leader.fence)
    term = leader.failover.term
    leader.call(leader.arbiter.on_time(leader.now_s))
    assert leader.failover.role is Role.ACTIVE, "it has heard nothing yet"
    assert leader.fence.check(leader.failover.signature, "decentral").code == "leader"
    leader.measure()
    assert (leader.failover.role, term, leader.fence.state.leader) == (Role.STANDBY, 1, "other")
    assert leader.facts("standby")


def test_a_leader_held_up_without_a_takeover_continues_at_once(leader):
    sent = len(leader.sent)
    leader.sleep(HELD_UP_S)
    leader.measure()
    assert len(leader.sent) == sent + 1
    assert (leader.failover.role, leader.failover.term) == (Role.ACTIVE, 1)
    assert leader.ticks_accounted_for


def test_hold_up_between_two_measurements_changes_nothing(leader):
    """The drives' last feedback is from before the last command, which may be a whole move away from it."""
    leader.wish = Command(90.0, 410.0)
    for _ in range(3):
        leader.tick()
        leader.drives = leader.sent[-1].command
    leader.sleep(HELD_UP_S)
    leader.run(0.0)
    leader.run(0.2)
    assert leader.arbiter.machine.mode is Mode.AUTO
    sent = len(leader.sent)
    leader.tick()
    assert leader.sent[sent].command == Command(84.0, 410.0)


def test_hold_up_before_the_first_measurement_does_no_harm(make_leader):
    leader = make_leader().run(2 * LISTEN_S)
    assert leader.failover.role is Role.ACTIVE
    leader.sleep(0.5)
    leader.run(0.3)
    leader.sleep(0.5)
    leader.measure()
    leader.run(0.1)
    leader.tick(5)
    assert leader.sent[-1].source == "decentral"
    assert leader.ticks_accounted_for


@pytest.mark.requirement("S9")
@pytest.mark.parametrize("replaced", [False, True])
def test_after_a_stall_it_is_uncertain_who_leads_until_the_next_report(leader, replaced):
    """A request may be the first that it handles; its answer waits."""
    assert leader.failover.is_certain(leader.now_s)
    leader.sleep(HELD_UP_S)
    assert not leader.failover.is_certain(leader.now_s)
    if replaced:
        take_over(leader.fence)
    leader.measure()
    assert leader.failover.is_certain(leader.now_s)
    assert (leader.failover.role is Role.STANDBY) == replaced
