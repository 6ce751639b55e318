"""How requests of the operator end: answered once, with the reason, and never left open."""

import math

import pytest

from fsw_control.cause import Cause
from fsw_control.command_gate import Flaw
from fsw_control.contract import Command
from fsw_control.reason import Reason, ReasonCode
from fsw_supervisor.facts import Answer, Code
from fsw_supervisor.parameters import SupervisorParameters
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
    assert request.reply.fact.code == ("accepted" if ready else "not_ready")
    if not ready:
        assert request.reply.fact.data["readiness"].reason.code is ReasonCode.NO_PROPOSAL
    assert rig.arbiter.operator.waiting == ready
    assert rig.arbiter.machine.target == ("nmpc" if ready else "decentral")
    rig.run(1)
    assert rig.last.source == ("nmpc" if ready else "decentral")
    assert len(rig.facts("switch_answered")) == 1


def test_an_accepted_switch_that_cannot_be_made_is_told_though_it_was_answered(rig):
    request = ask(rig, timeout_s=0.0)
    rig.arbiter.registry.get("nmpc").bad(Reason.of("gone"))
    rig.run(2)
    assert rig.last.source == "decentral"
    assert not rig.arbiter.operator.waiting
    assert rig.arbiter.machine.target == "decentral"
    assert request.reply.fact.code == "accepted"
    assert rig.facts("switch_answered")[-1]["answer"].data["readiness"].reason == Reason.of("gone")


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


def timed_out(request):
    """Why it timed out, as a code."""
    assert (request.reply.ok, request.reply.fact.code) == (False, "timed_out")
    return request.reply.fact.data["reason"].code


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
    assert (request.ok, request.reply.fact.code) == (True, "applied")


def test_a_swap_to_a_controller_that_then_fails_is_told_as_such_though_its_time_is_over(rig):
    request = swapping(rig)
    rig.arbiter.on_time(rig.now_s + 0.08)
    assert request.reply.fact.code == "swap_failed"
    assert request.reply.fact.data["reason"].because.code is ReasonCode.NO_PROPOSAL


def test_a_swap_after_which_no_measurement_comes_is_told_as_such(rig):
    request = swapping(rig)
    rig.arbiter.on_command(1, "x", Command(61.0, 310.0))
    rig.spoil("nmpc", command=Command(61.0, 310.0))
    out = rig.arbiter.on_proposal("nmpc", rig.edit["nmpc"](rig.proposal("nmpc")), rig.now_s + 0.03)
    assert [decision.source for decision in out] == ["hold"]
    rig.arbiter.on_time(rig.now_s + 0.089)
    assert not request.done
    rig.arbiter.on_time(rig.now_s + 0.091)
    assert timed_out(request) == "not_applied"


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
    assert timed_out(request) == "not_ready"


def test_in_lockstep_a_request_ends_when_no_tick_comes_for_long(make_rig):
    rig = make_rig(lockstep=True)
    for _ in range(20):
        rig.tick()
    request = ask(rig, timeout_s=1.0)
    for after_s, done in ((1.01, False), (2.49, False), (2.51, True)):
        rig.arbiter.on_time(rig.now_s + after_s)
        assert request.done == done
    assert timed_out(request) == "no_measurement_yet"


def test_to_ask_for_the_active_one_takes_back_what_was_asked_before(waiting):
    rig, request = waiting
    again = ask(rig, "decentral")
    assert again.reply == Answer.done(Code.ACTIVE_ALREADY, controller="decentral")
    assert request.reply == Answer.refused(Code.SUPERSEDED, controller="decentral")
    assert rig.arbiter.machine.target == "decentral"
    assert not rig.arbiter.operator.waiting
    rig.silent.clear()
    rig.run(8)
    assert rig.last.source == "decentral"


def test_without_any_controller_it_is_told_that_none_is_known(make_rig):
    answer = ask(make_rig()).reply
    assert answer == Answer.refused(Code.UNKNOWN_CONTROLLER, controller="nmpc", known=())


def test_manual_without_values_is_refused(rig):
    ok, why = rig.arbiter.operator.ask_mode("manual", None, "operator")
    assert (ok, why.code, why.data["refusal"].flaw) == (False, "bad_values", Flaw.NOT_FINITE)


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
    assert request.reply.fact.code == "applied"


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
    assert request.reply == Answer.refused(Code.MODE_CHANGED, mode="hold")
    assert not rig.arbiter.operator.waiting


def test_a_strict_request_is_refused_at_the_tick_at_which_the_controller_is_not_ready(rig):
    request = ask(rig, strict=True, timeout_s=5.0)
    rig.arbiter.registry.get("nmpc").bad(Reason.of("gone"))
    rig.run(1)
    assert (request.done, request.ok) == (True, False)


@pytest.mark.parametrize("interval_s", [0.3, 0.6])
def test_swaps_of_the_operator_keep_the_interval_that_is_set(make_rig, interval_s):
    rig = make_rig(SupervisorParameters.from_values({"switch_interval_s": interval_s})).run(10)
    assert not ask(rig).done
    rig.run(1)
    for elapsed in range(round(interval_s / 0.1)):
        refused = ask(rig, "decentral", strict=True)
        assert refused.reply.fact.code == "too_soon"
        assert refused.reply.fact.data["elapsed_s"] == pytest.approx(elapsed / 10)
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


def test_refused_mode_is_logged_with_its_reason(rig):
    rig.arbiter.operator.ask_mode("full_speed" * 10, None, "someone")
    (fact,) = rig.facts("mode_refused")
    assert (fact["mode"], fact["answer"].code) == (("full_speed" * 10)[:40], "unknown_mode")
    rig.arbiter.machine.events.clear()
    rig.arbiter.operator.ask_mode("hold", None, "someone")
    assert rig.facts("mode_refused") == []


def test_auto_while_in_auto_goes_on_with_the_active_one_and_readmits_the_others(rig):
    rig.silent.add("decentral")
    rig.run(1)
    rig.silent.clear()
    rig.run(8)
    assert rig.last.source == "nmpc"
    assert rig.arbiter.operator.ask_mode("auto", None, "operator") == Answer.done(
        Code.MODE_ALREADY, mode="auto"
    )
    rig.run(2)
    assert rig.last.source == "nmpc"
    assert rig.arbiter.registry.get("decentral").inhibited == Reason()
    assert rig.facts("readmitted")[-1]["controllers"] == ("decentral",)


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
    assert desk.ask_mode("manual", Command(78.5, 408.0), "operator") == Answer.done(
        Code.MODE_ALREADY, mode="manual"
    )
    rig.run(1)
    assert (rig.last.source, rig.last.command) == ("manual", Command(78.5, 408.0))


def test_target_is_reported_beside_the_actual_state(rig):
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
    assert rig.arbiter.operator.ask_mode("auto", None, "operator") == Answer.done(
        Code.AUTO_NEXT, controller="nmpc"
    )


@pytest.mark.requirement("S25")
def test_an_acknowledgement_is_answered_and_logged_once(rig):
    desk, machine = rig.arbiter.operator, rig.arbiter.machine
    assert desk.acknowledge("anna") == Answer.refused(Code.NO_STOP)
    desk.ask_mode("safe_stop", None, "operator")
    for _ in range(2):
        assert desk.acknowledge("anna") == Answer.done(Code.ACKNOWLEDGED)
    assert rig.facts("stop_acknowledged") == [{"who": "anna"}]
    revision = machine.revision
    machine.renew()
    assert machine.revision > revision, "the operator sees that it is void"
    assert not machine.acknowledged


@pytest.mark.requirement("S25")
def test_an_acknowledgement_that_is_refused_is_logged_with_the_cause(rig):
    rig.values["thermocouple"] = 930.0
    rig.run(10)
    ok, why = rig.arbiter.operator.acknowledge("anna")
    assert not ok
    assert rig.facts("acknowledge_refused") == [{"answer": why}]
