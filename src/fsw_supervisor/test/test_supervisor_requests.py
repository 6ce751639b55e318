"""How requests of the operator end: answered once, with the reason, and never left open."""

import math

import pytest

from fsw_control.cause import Cause
from fsw_control.contract import Command
from fsw_control.reason import Reason, ReasonCode
from fsw_supervisor.settings import ArbiterSettings
from fsw_supervisor.state_machine import Mode


def ask(rig, name="nmpc", strict=False, timeout_s=1.0):
    return rig.arbiter.operator.ask_switch(name, strict, timeout_s, "operator", rig.now_s)


@pytest.fixture
def waiting(rig):
    """A rig in which ``nmpc`` is asked for and not ready."""
    rig.silent.add("nmpc")
    rig.run(1)
    request = ask(rig, timeout_s=2.0)
    assert rig.arbiter.operator.waiting
    return rig, request


@pytest.mark.parametrize("timeout_s", [0.0, -1.0, math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("ready", [True, False])
def test_without_a_time_to_wait_the_answer_comes_at_once(rig, timeout_s, ready):
    if not ready:
        rig.silent.add("nmpc")
        rig.run(2)
    request = ask(rig, timeout_s=timeout_s)
    assert (request.done, request.ok) == (True, ready)
    words = "accepted: nmpc is applied from the next tick on"
    assert request.message == (
        words if ready else "nmpc is not usable: no proposal at the deadline"
    )
    assert rig.arbiter.operator.waiting == ready
    assert rig.arbiter.machine.target == ("nmpc" if ready else "decentral")
    rig.run(1)
    assert rig.last.source == ("nmpc" if ready else "decentral")
    assert rig.events().count("switch to nmpc") == 1


def test_an_accepted_switch_that_cannot_be_made_is_told_though_it_was_answered(rig):
    request = ask(rig, timeout_s=0.0)
    rig.arbiter.registry.get("nmpc").bad(Reason.of("gone"))
    rig.run(2)
    assert rig.last.source == "decentral"
    assert not rig.arbiter.operator.waiting
    assert rig.arbiter.machine.target == "decentral"
    assert request.message.startswith("accepted")
    assert "warn operator: switch to nmpc: nmpc is not usable: gone" in rig.events()


def test_an_accepted_switch_does_not_time_out_before_the_next_tick(rig):
    ask(rig, timeout_s=0.0)
    rig.arbiter.on_time(rig.now_s + 0.0995)
    rig.run(1)
    assert rig.last.source == "nmpc"


@pytest.mark.parametrize("after_s", [0.99, 1.01])
def test_a_request_times_out_when_its_time_is_over(rig, after_s):
    rig.silent.add("nmpc")
    rig.run(1)
    request = ask(rig, timeout_s=1.0)
    rig.arbiter.on_time(rig.now_s + after_s)
    assert request.done == (after_s > 1.0)


def swapping(rig):
    """A request whose time is over just after the swap, before the first command of the new controller."""
    request = ask(rig, timeout_s=0.11)
    rig.now_s += 0.1
    rig.stamp_ns += 100_000_000
    for sensor, value in rig.values.items():
        assert rig.arbiter.on_sample(sensor, rig.stamp_ns, value, rig.now_s) == []
    assert rig.arbiter.on_time(rig.now_s + 0.02) == []
    assert rig.arbiter.machine.active == "nmpc"
    return request


def test_a_swap_that_was_made_in_time_is_not_told_to_be_too_late(rig):
    request = swapping(rig)
    assert not request.done
    out = rig.arbiter.on_proposal("nmpc", rig.proposal("nmpc"), rig.now_s + 0.03)
    assert [decision.source for decision in out] == ["nmpc"]
    assert (request.ok, request.message) == (True, "nmpc is applied")


def test_a_swap_to_a_controller_that_then_fails_is_told_as_such_though_its_time_is_over(rig):
    request = swapping(rig)
    rig.arbiter.on_time(rig.now_s + 0.08)
    assert request.message == "swapped, but nmpc failed: no proposal at the deadline"


def test_a_swap_after_which_no_measurement_comes_is_told_as_such(rig):
    request = swapping(rig)
    rig.arbiter.on_command(1, "x", Command(61.0, 310.0))
    rig.spoil("nmpc", command=Command(61.0, 310.0))
    out = rig.arbiter.on_proposal("nmpc", rig.edit["nmpc"](rig.proposal("nmpc")), rig.now_s + 0.03)
    assert [decision.source for decision in out] == ["hold"]
    rig.arbiter.on_time(rig.now_s + 0.089)
    assert not request.done
    rig.arbiter.on_time(rig.now_s + 0.091)
    assert request.message == "timed out: swapped, but nmpc is not applied yet"


@pytest.mark.parametrize("timeout_s", [0.3, 0.5])
def test_in_lockstep_a_request_waits_so_many_ticks_however_long_they_take(make_rig, timeout_s):
    rig = make_rig(lockstep=True)
    for _ in range(20):
        rig.tick()
    rig.silent.add("nmpc")
    for _ in range(30):
        rig.tick()
    request = ask(rig, timeout_s=timeout_s)
    ticks = round(timeout_s / 0.1)
    for _ in range(ticks):
        rig.now_s += 0.1
        rig.tick()
        assert not request.done
    rig.tick()
    assert request.message.startswith("timed out: nmpc is not usable")


def test_in_lockstep_a_request_ends_when_no_tick_comes_for_long(make_rig):
    rig = make_rig(lockstep=True)
    for _ in range(20):
        rig.tick()
    request = ask(rig, timeout_s=1.0)
    for after_s, done in ((1.01, False), (2.49, False), (2.51, True)):
        rig.arbiter.on_time(rig.now_s + after_s)
        assert request.done == done
    assert request.message == "timed out: no measurement has arrived for the swap"


def test_to_ask_for_the_active_one_takes_back_what_was_asked_before(waiting):
    rig, request = waiting
    again = ask(rig, "decentral")
    assert (again.ok, again.message) == (True, "decentral is active already")
    assert (request.ok, request.message) == (False, "superseded by a request for decentral")
    assert rig.arbiter.machine.target == "decentral"
    assert not rig.arbiter.operator.waiting
    rig.silent.clear()
    rig.run(8)
    assert rig.last.source == "decentral"


def test_without_any_controller_it_is_told_that_none_is_known(make_rig):
    assert ask(make_rig()).message == "unknown controller 'nmpc'; known: none"


def test_manual_without_values_is_refused(rig):
    words = "not finite: force nan kN, speed nan rpm"
    assert rig.arbiter.operator.ask_mode("manual", None, "operator") == (False, words)


def test_an_unknown_name_ends_no_request_that_is_waiting(waiting):
    rig, request = waiting
    assert not ask(rig, "nobody").ok
    assert not request.done


def test_a_fallback_swap_to_the_controller_that_is_waited_for_answers_the_request(rig):
    rig.silent.add("nmpc")
    rig.run(1)
    rig.silent.clear()
    request = ask(rig, timeout_s=2.0)
    rig.run(5)
    assert not request.done
    rig.silent.add("decentral")
    rig.run(1)
    assert rig.last.source == "nmpc"
    assert request.ok
    assert request.message == "nmpc is applied"


def test_a_failure_of_the_active_one_does_not_end_a_request_for_another(rig):
    rig.names.append("third")
    rig.run(6)
    rig.silent.add("third")
    rig.run(1)
    request = ask(rig, "third", timeout_s=3.0)
    rig.silent.add("decentral")
    rig.run(2)
    assert (rig.last.source, request.done) == ("nmpc", False)
    rig.silent.discard("third")
    rig.run(7)
    assert (rig.last.source, request.ok) == ("third", True)


def test_a_request_is_refused_when_the_mode_has_changed_by_itself(waiting):
    rig, request = waiting
    rig.silent.add("decentral")
    rig.run(2)
    assert rig.last.source == "hold"
    assert (request.done, request.message) == (True, "the mode has become hold")
    assert not rig.arbiter.operator.waiting


def test_a_strict_request_is_refused_at_the_tick_at_which_the_controller_is_not_ready(rig):
    request = ask(rig, strict=True, timeout_s=5.0)
    rig.arbiter.registry.get("nmpc").bad(Reason.of("gone"))
    rig.run(1)
    assert (request.done, request.ok) == (True, False)


@pytest.mark.parametrize("interval_s", [0.3, 0.6])
def test_swaps_of_the_operator_keep_the_interval_that_is_set(make_rig, interval_s):
    rig = make_rig(ArbiterSettings.from_values({"switch_interval_s": interval_s})).run(10)
    assert ask(rig).message == ""
    rig.run(1)
    for elapsed in range(round(interval_s / 0.1)):
        refused = ask(rig, "decentral", strict=True)
        assert refused.message == f"the last swap was only {elapsed / 10:.1f} s ago"
        assert ask(rig, "nmpc").ok, "no swap is needed for the active one"
        rig.run(1)
    assert not ask(rig, "decentral", strict=True).done
    rig.run(1)
    assert rig.last.source == "decentral"


def test_a_switch_outside_auto_needs_no_interval(rig):
    ask(rig)
    rig.run(1)
    rig.arbiter.operator.ask_mode("hold", None, "operator")
    request = ask(rig, "decentral", strict=True)
    assert (request.ok, rig.arbiter.machine.target) == (True, "decentral")


def test_a_refused_mode_is_told_in_the_log_with_the_reason(rig):
    rig.arbiter.operator.ask_mode("full_speed" * 10, None, "someone")
    assert f"warn someone: mode {('full_speed' * 10)[:40]}: unknown mode" in rig.events()
    rig.arbiter.machine.events.clear()
    rig.arbiter.operator.ask_mode("hold", None, "someone")
    assert "mode hold:" not in rig.events()


def test_auto_while_in_auto_goes_on_with_the_active_one_and_readmits_the_others(rig):
    rig.silent.add("decentral")
    rig.run(1)
    rig.silent.clear()
    rig.run(8)
    assert rig.last.source == "nmpc"
    assert rig.arbiter.operator.ask_mode("auto", None, "operator") == (True, "auto already")
    rig.run(2)
    assert rig.last.source == "nmpc"
    assert rig.arbiter.registry.get("decentral").inhibited == Reason()
    assert "readmitted by operator: decentral" in rig.events()


def test_a_switch_that_is_waited_for_goes_on_when_auto_is_asked_for_again(waiting):
    rig, request = waiting
    rig.arbiter.operator.ask_mode("auto", None, "operator")
    assert not request.done
    rig.silent.clear()
    rig.run(7)
    assert (request.ok, rig.last.source) == (True, "nmpc")


def test_manual_values_may_be_changed_while_in_manual(rig):
    desk = rig.arbiter.operator
    assert desk.ask_mode("manual", Command(79.0, 407.5), "operator")[0]
    rig.run(2)
    assert desk.ask_mode("manual", Command(200.0, 407.5), "operator")[0] is False
    rig.run(1)
    assert rig.last.command == Command(79.0, 407.5), "what was refused changes nothing"
    assert desk.ask_mode("manual", Command(78.5, 408.0), "operator") == (True, "manual already")
    rig.run(1)
    assert (rig.last.source, rig.last.command) == ("manual", Command(78.5, 408.0))


def test_what_the_operator_wants_is_noted_beside_what_is(rig):
    machine = rig.arbiter.machine
    rig.arbiter.operator.ask_mode("hold", None, "anna")
    assert (machine.mode, machine.target_mode, machine.who) == (Mode.HOLD, Mode.HOLD, "anna")
    assert (machine.reason, machine.who) == (Reason(ReasonCode.REQUESTED, subject="hold"), "anna")
    ask(rig)
    rig.arbiter.operator.ask_mode("auto", None, "berta")
    assert (machine.mode, machine.target_mode, machine.active) == (Mode.AUTO, Mode.AUTO, "nmpc")
    assert (machine.who, machine.cause) == ("berta", Cause.OPERATOR_AUTO)


def test_auto_takes_the_first_of_the_fallbacks_that_is_ready(rig):
    rig.arbiter.operator.ask_mode("hold", None, "operator")
    rig.silent.add("decentral")
    rig.run(2)
    assert rig.arbiter.operator.ask_mode("auto", None, "operator") == (
        True,
        "auto from the next command on, with nmpc",
    )


@pytest.mark.requirement("S25")
def test_an_acknowledgement_is_answered_and_logged_once(rig):
    desk, machine = rig.arbiter.operator, rig.arbiter.machine
    assert desk.acknowledge("anna") == (False, "there is no safe stop to acknowledge")
    desk.ask_mode("safe_stop", None, "operator")
    for _ in range(2):
        assert desk.acknowledge("anna") == (True, "acknowledged; now request a mode")
    assert rig.events().count("anna has acknowledged the safe stop") == 1
    revision = machine.revision
    machine.renew()
    assert machine.revision > revision, "the operator sees that it is void"
    assert not machine.acknowledged


@pytest.mark.requirement("S25")
def test_an_acknowledgement_that_is_refused_is_logged_with_the_cause(rig):
    rig.values["thermocouple"] = 930.0
    rig.run(10)
    ok, message = rig.arbiter.operator.acknowledge("anna")
    assert not ok
    assert f"warn anna: acknowledge: {message}" in rig.events()
