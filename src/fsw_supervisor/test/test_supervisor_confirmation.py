"""A request is answered with success when the actuator end reports its effect."""

import pytest

from fsw_control.contract import Command
from fsw_control.fence import Signature
from fsw_control.stop import StopCause, StopRegister
from fsw_supervisor.confirmation import CONFIRM_S, Confirmations
from fsw_supervisor.state_machine import Mode


class Asked:
    """A leader in control, and its requests."""

    def __init__(self, leader):
        self.leader, self.operator = leader, leader.arbiter.operator
        self.confirmations = Confirmations(leader.failover, 0.0)

    def measure(self, count=1):
        for _ in range(count):
            self.leader.measure()
            self.confirmations.on_report()
            self.confirmations.look(self.leader.now_s)
            self.leader.run(0.1)
            self.confirmations.look(self.leader.now_s)

    def mode(self, mode):
        assert self.operator.ask_mode(str(mode), Command(80.0, 410.0), "operator")[0]
        if mode is Mode.SAFE_STOP:
            return self.confirmations.of_stop(self.leader.now_s)
        return self.confirmations.of_mode(mode, self.leader.now_s)


@pytest.fixture
def asked(leader):
    """A leader in control."""
    return Asked(leader)


@pytest.mark.requirement("S38")
@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.MANUAL, Mode.SAFE_STOP])
def test_a_mode_is_confirmed_by_the_report_after_its_first_command(asked, mode):
    waiting = asked.mode(mode)
    asked.measure()
    assert waiting.ok is None, "the report that comes first is of the command before"
    asked.measure()
    assert waiting.ok is True
    assert asked.leader.fence.state.source == mode


@pytest.mark.requirement("S38")
def test_reports_from_before_the_last_mode_confirm_nothing(asked):
    """They were under way for so long that they show the mode of before, which is asked for again."""
    leader, before = asked.leader, asked.leader.fence.state
    asked.mode(Mode.HOLD)
    asked.measure(2)
    waiting = asked.mode(Mode.AUTO)
    for _ in range(5):
        leader.failover.on_actuator(before, leader.now_s)
        asked.confirmations.on_report()
    assert waiting.ok is None and before.source == "decentral"
    asked.measure(2)
    assert waiting.ok is True


@pytest.mark.requirement("S38")
def test_a_stop_in_a_pause_of_the_measurements_is_not_confirmed_and_stays(asked):
    waiting = asked.mode(Mode.SAFE_STOP)
    asked.leader.run(CONFIRM_S + 0.1)
    asked.confirmations.look(asked.leader.now_s)
    assert waiting.ok is False
    asked.measure(2)
    assert asked.leader.fence.register.stopped


@pytest.mark.requirement("S25", "S38")
@pytest.mark.parametrize("heard_before", [False, True])
def test_safe_stop_outlasts_an_acknowledgement_of_another_stop_given_before_it(
    asked, heard_before
):
    leader, fence = asked.leader, asked.leader.fence
    fence.stop(StopCause.WATCHDOG, 0)
    elsewhere = StopRegister()
    elsewhere.merge(fence.register.value)
    elsewhere.acknowledge("anna", 0)
    if heard_before:
        asked.measure()
    waiting = asked.mode(Mode.SAFE_STOP)
    asked.measure(3)
    assert waiting.ok is True
    fence.hear(elsewhere.value)
    assert fence.register.stopped
    asked.measure(2)
    assert leader.fence.state.source == Mode.SAFE_STOP


@pytest.mark.requirement("S38")
def test_two_requests_for_a_safe_stop_are_confirmed_by_the_later_stop(asked):
    register = asked.leader.arbiter.machine.register
    first, before = asked.mode(Mode.SAFE_STOP), register.value.epoch
    waiting = [first, asked.mode(Mode.SAFE_STOP)]
    asked.measure(3)
    assert [request.ok for request in waiting] == [True, True]
    assert asked.leader.fence.register.value.epoch == before + 1


@pytest.mark.requirement("S38")
@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.SAFE_STOP])
def test_a_leader_that_was_deposed_confirms_no_mode(asked, mode):
    waiting = asked.mode(mode)
    fence = asked.leader.fence
    fence.check(Signature(9, "other", fence.register.value), "nmpc")
    fence.take("nmpc", asked.leader.stamp_ns)
    asked.measure(2)
    assert waiting.ok is False


@pytest.mark.requirement("S38")
def test_an_acknowledgement_is_confirmed_when_the_actuator_end_knows_it(asked):
    asked.mode(Mode.SAFE_STOP)
    asked.measure(3)
    assert asked.operator.acknowledge("anna")[0]
    waiting = asked.confirmations.of_acknowledgement(asked.leader.now_s)
    asked.measure(2)
    assert waiting.ok is True
    assert not asked.leader.fence.register.stopped


@pytest.mark.requirement("S38")
def test_a_second_acknowledgement_is_not_confirmed_once_another_stop_is_heard(asked):
    """The report that comes next may still be of the time before that stop."""
    leader, fence = asked.leader, asked.leader.fence
    asked.mode(Mode.SAFE_STOP)
    asked.measure(3)
    assert asked.operator.acknowledge("anna")[0]
    asked.measure(2)
    assert asked.operator.acknowledge("anna")[0]
    waiting = asked.confirmations.of_acknowledgement(leader.now_s)
    before = fence.register.value
    leader.failover.on_stop(fence.register.next_stop(StopCause.OPERATOR, "bert", 0))
    for _ in range(3):
        leader.failover.on_actuator(fence.state._replace(stop=before), leader.now_s)
        asked.confirmations.on_report()
        leader.run(0.1)
        asked.confirmations.look(leader.now_s)
    assert waiting.ok is None
    leader.run(CONFIRM_S)
    asked.confirmations.look(leader.now_s)
    assert waiting.ok is False


@pytest.mark.requirement("S38")
def test_a_stop_of_the_actuator_ends_own_is_not_acknowledged_unseen(asked):
    """The watchdog has begun a safe stop of the same epoch that has not been reported yet."""
    asked.mode(Mode.SAFE_STOP)
    assert not asked.operator.acknowledge("anna")[0], "nothing is reported yet"
    asked.measure(3)
    assert asked.operator.acknowledge("anna")[0]


@pytest.mark.requirement("S38")
def test_auto_is_confirmed_by_a_command_of_the_controller(asked):
    asked.mode(Mode.HOLD)
    asked.measure(3)
    waiting = asked.mode(Mode.AUTO)
    asked.measure(2)
    assert waiting.ok is True
    assert asked.leader.fence.state.source == "decentral"
