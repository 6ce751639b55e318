"""A leader that was held up: what it sends when it goes on, and what it must not send any more."""

import pytest

from fsw_control.contract import Command
from fsw_supervisor.failover import LISTEN_S, Role
from fsw_supervisor.state_machine import Mode

COMMANDED = Command(80.0, 410.0)


@pytest.mark.requirement("S12")
@pytest.mark.parametrize(
    ("off_kn", "off_rpm", "moved"),
    [(0.5, 0.0, False), (0.6, 0.0, True), (-0.6, 0.0, True), (0.0, 1.5, False), (0.0, -1.6, True), (0.4, 1.2, False)],
)
def test_commands_kept_back_are_sent_only_if_nothing_else_has_moved_the_drives(leader, off_kn, off_rpm, moved):
    """Half a move is what the drives may differ from what they were told."""
    sent = len(leader.sent)
    leader.drives = Command(COMMANDED.force_kn - off_kn, COMMANDED.speed_rpm - off_rpm)
    leader.sleep(0.3)
    leader.measure()
    leader.measure()
    assert len(leader.sent) == sent, "another supervisor may have taken over: first it is heard"
    leader.run(0.1)
    assert len(leader.sent) == sent + (0 if moved else 2)
    assert leader.ticks_accounted_for
    leader.tick(1)
    begun = leader.drives if moved else COMMANDED
    assert leader.sent[sent + (0 if moved else 2)].command == leader.arbiter.settings.limits.clip(COMMANDED, begun)
    assert ("the drives have moved while" in leader.events()) == moved
    leader.tick(5)
    assert leader.sent[-1].source == "decentral"
    assert leader.ticks_accounted_for


@pytest.mark.requirement("S12")
def test_control_begins_again_where_a_plc_has_ramped_the_drives_to(leader):
    leader.sleep(0.5)
    for _ in range(5):
        leader.drives = Command(leader.drives.force_kn - 0.5, leader.drives.speed_rpm)
        leader.measure()
    leader.run(0.1)
    sent = len(leader.sent)
    leader.drives = Command(leader.drives.force_kn - 0.5, leader.drives.speed_rpm)
    leader.tick()
    assert abs(leader.sent[sent].command.force_kn - leader.drives.force_kn) <= 1.0
    assert leader.ticks_accounted_for


def test_commands_kept_back_are_sent_when_the_drives_report_nothing(leader):
    sent = len(leader.sent)
    leader.drives = None
    leader.sleep(0.3)
    leader.measure()
    leader.run(0.1)
    assert len(leader.sent) == sent + 1
    assert leader.tick(3).ticks_accounted_for


def test_a_hold_up_between_two_measurements_changes_nothing(leader):
    """The drives' last feedback is from before the last command, which may be a whole move away from it."""
    leader.wish = Command(90.0, 410.0)
    for _ in range(3):
        leader.tick()
        leader.drives = leader.sent[-1].command
    leader.sleep(0.3)
    leader.run(0.0)
    leader.run(0.2)
    assert leader.arbiter.machine.mode is Mode.AUTO
    sent = len(leader.sent)
    leader.tick()
    assert leader.sent[sent].command == Command(84.0, 410.0)
    assert "the drives have moved" not in leader.events()


def test_a_hold_up_before_the_first_measurement_does_no_harm(make_leader):
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


@pytest.mark.parametrize(("hold_up_s", "kept_back"), [(0.14, False), (0.16, True)])
def test_it_keeps_commands_back_only_after_a_hold_up_in_which_another_may_have_taken_over(leader, hold_up_s, kept_back):
    sent = len(leader.sent)
    leader.sleep(hold_up_s)
    leader.measure()
    assert (len(leader.sent) == sent) == kept_back
    assert leader.run(0.1).tick().ticks_accounted_for


def test_with_more_ticks_before_a_takeover_a_leader_may_be_held_up_for_longer(make_leader):
    leader = make_leader(takeover_ticks=5).run(2 * LISTEN_S).tick(10)
    for hold_up_s, kept_back in ((0.44, False), (0.46, True)):
        sent = len(leader.sent)
        leader.sleep(hold_up_s)
        leader.measure()
        assert (len(leader.sent) == sent) == kept_back
        leader.run(0.1).tick()


def test_in_lockstep_a_leader_may_be_held_up_for_half_of_the_time_until_a_takeover(make_leader):
    leader = make_leader(lockstep=True, lockstep_deadline_s=1.0).run(2 * LISTEN_S).tick(10)
    for hold_up_s, kept_back in ((0.99, False), (1.01, True)):
        sent = len(leader.sent)
        leader.sleep(hold_up_s)
        leader.measure()
        assert (len(leader.sent) == sent) == kept_back
        leader.run(0.1).tick()


def test_a_second_hold_up_while_commands_are_kept_back_keeps_them_no_longer(leader):
    sent = len(leader.sent)
    leader.sleep(0.3)
    leader.measure()
    leader.sleep(0.3)
    leader.call(leader.arbiter.on_time(leader.now_s))
    assert len(leader.sent) == sent + 1


@pytest.mark.requirement("S9")
def test_a_leader_that_hears_of_a_newer_one_sends_nothing_that_it_has_kept_back(leader):
    sent = len(leader.sent)
    leader.sleep(0.3)
    leader.measure()
    assert leader.failover.on_leader_state("2.other", leader.stamp_ns)
    assert leader.failover.role is Role.STANDBY
    leader.run(0.1)
    assert len(leader.sent) == sent
    assert leader.ticks_accounted_for
    assert "on standby: another supervisor leads" in leader.events()
    leader.measure()
    leader.run(0.1)
    assert len(leader.sent) == sent, "one tick that goes unanswered is no reason to take over again"
    leader.tick(2)
    assert len(leader.sent) > sent
    assert leader.failover.token == "3.m"


@pytest.mark.requirement("S9")
@pytest.mark.parametrize("replaced", [False, True])
def test_after_a_stall_a_leader_is_not_sure_that_it_leads_until_it_has_heard(leader, replaced):
    """A request may be the first that it handles; its answer waits."""
    assert leader.failover.leads(leader.now_s) is True
    leader.sleep(0.3)
    assert leader.failover.leads(leader.now_s) is None
    leader.measure()
    assert leader.failover.leads(leader.now_s) is None
    if replaced:
        leader.failover.on_leader_state("2.other", leader.stamp_ns)
    else:
        leader.run(0.1)
    assert leader.failover.leads(leader.now_s) is not replaced
