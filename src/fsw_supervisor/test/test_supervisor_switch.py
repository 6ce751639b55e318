"""The operator asks for a controller or a mode."""

from dataclasses import replace

import pytest

from fsw_control.cause import Cause
from fsw_control.command_gate import Flaw
from fsw_control.contract import Command
from fsw_control.reason import Lack, Readiness, Reason, ReasonCode
from fsw_supervisor.facts import Answer, Code, Fact
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.state_machine import Mode


def ask(rig, name, strict=True, timeout_s=1.0):
    return rig.arbiter.operator.ask_switch(name, strict, timeout_s, "operator", rig.now_s)


def lacks(request):
    assert not request.ok
    return request.reply.fact.data["readiness"]


def test_a_swap_happens_between_two_ticks_and_is_answered_when_it_is_applied(rig):
    request = ask(rig, "nmpc")
    assert not request.done
    rig.run(1)
    assert (request.ok, rig.last.source) == (True, "nmpc")
    assert request.reply == Answer.done(Code.APPLIED, controller="nmpc")
    assert rig.arbiter.machine.cause is Cause.SWAP_REQUESTED
    assert len({tick[0].stamp_ns for tick in rig.ticks}) == len(rig.ticks)


def test_timeout_zero_answers_at_once(rig):
    request = ask(rig, "nmpc", timeout_s=0.0)
    assert (request.done, request.ok) == (True, True)
    rig.run(1)
    assert rig.last.source == "nmpc"


@pytest.mark.parametrize("strict", [True, False])
def test_unknown_controllers_are_refused(rig, strict):
    request = ask(rig, "nobody", strict)
    assert (request.done, request.ok) == (True, False)
    assert request.reply.fact == Fact.of(
        Code.UNKNOWN_CONTROLLER, controller="nobody", known=("decentral", "nmpc")
    )


def test_strict_is_refused_with_the_reason(rig):
    rig.spoil("nmpc", healthy=False, reason=Reason.of("no reference"))
    rig.run(1)
    assert lacks(ask(rig, "nmpc")) == Readiness(Lack.UNUSABLE, Reason.of("no reference"))
    rig.edit.clear()
    rig.run(2)
    assert lacks(ask(rig, "nmpc")) == Readiness(Lack.WARMING, good=2, required=5)
    rig.delays_s["nmpc"] = 0.09
    rig.run(1)
    late = lacks(ask(rig, "nmpc")).reason
    assert (late.code, late.limit_s) == (ReasonCode.LATE, pytest.approx(0.09))
    assert rig.arbiter.machine.target == "decentral"
    rig.run(1)
    assert rig.last.source == "decentral"


def test_an_inhibited_controller_is_refused(rig):
    rig.silent.add("decentral")
    rig.run(1)
    rig.silent.clear()
    rig.run(10)
    silent = Reason(ReasonCode.NO_PROPOSAL)
    assert lacks(ask(rig, "decentral")) == Readiness(Lack.INHIBITED, silent)


def test_best_effort_waits_until_the_controller_is_warm(rig):
    rig.silent.add("nmpc")
    rig.run(1)
    rig.silent.clear()
    request = ask(rig, "nmpc", strict=False, timeout_s=2.0)
    assert not request.done
    assert rig.arbiter.machine.target == "nmpc"
    rig.run(5)
    assert not request.done
    rig.run(1)
    assert request.ok
    assert rig.last.source == "nmpc"


def test_best_effort_times_out_with_the_reason(rig):
    rig.silent.add("nmpc")
    rig.run(1)
    request = ask(rig, "nmpc", strict=False, timeout_s=0.5)
    rig.run(7)
    assert (request.done, request.ok) == (True, False)
    assert request.reply.fact.code is Code.TIMED_OUT
    why = request.reply.fact.data["reason"]
    assert why.data["readiness"] == Readiness(Lack.UNUSABLE, Reason(ReasonCode.NO_PROPOSAL))
    assert rig.arbiter.machine.target == "decentral"


def test_a_request_without_measurements_times_out(rig):
    request = ask(rig, "nmpc", timeout_s=0.5)
    rig.arbiter.on_time(rig.now_s + 0.6)
    assert request.reply.fact == Fact.of(Code.TIMED_OUT, reason=Fact.of(Code.NO_MEASUREMENT_YET))


def test_a_later_request_supersedes(rig):
    rig.silent.add("nmpc")
    rig.run(1)
    first = ask(rig, "nmpc", strict=False, timeout_s=5.0)
    assert ask(rig, "decentral").ok
    assert (first.done, first.ok) == (True, False)
    assert first.reply.fact.code is Code.SUPERSEDED


def test_operators_swaps_keep_a_distance(rig):
    ask(rig, "nmpc")
    rig.run(1)
    assert ask(rig, "decentral").reply == Answer.refused(Code.TOO_SOON, elapsed_s=0.0)
    request = ask(rig, "decentral", strict=False)
    rig.run(3)
    assert request.ok
    assert [tick[0].source for tick in rig.ticks[-3:]] == ["nmpc", "nmpc", "decentral"]


def test_failure_at_the_swap_is_reported(rig):
    request = ask(rig, "nmpc")
    rig.silent.add("nmpc")
    rig.run(1)
    assert rig.last.source == "decentral"
    failed = Reason(ReasonCode.FAILED, subject="nmpc", because=Reason(ReasonCode.NO_PROPOSAL))
    assert request.reply == Answer.refused(Code.SWAP_FAILED, reason=failed)


def test_a_controller_that_becomes_unready_before_the_swap_is_refused(rig):
    rig.delays_s["nmpc"] = 0.01
    rig.run(1)
    request = ask(rig, "nmpc")
    rig.arbiter.registry.get("nmpc").bad(Reason.of("gone"))
    rig.run(1)
    assert lacks(request) == Readiness(Lack.UNUSABLE, Reason.of("gone"))
    assert rig.last.source == "decentral"


def test_a_third_controller_that_joins_later_can_be_selected(rig):
    rig.names.append("third")
    rig.run(5)
    assert {"controller": "third"} in rig.facts("joined")
    request = ask(rig, "third")
    rig.run(1)
    assert request.ok
    assert rig.last.source == "third"
    rig.arbiter.registry.leave("third")
    assert rig.facts("left") == [{"controller": "third"}]


@pytest.mark.requirement("S12")
def test_after_a_swap_the_output_slews_within_the_transition_limit(make_rig):
    rig = make_rig(
        SupervisorParameters.from_values({"force_transition_kn": 0.1, "speed_transition_rpm": 0.5})
    ).run(10)
    rig.edit["nmpc"] = lambda p: replace(
        p, command=Command(min(p.command.force_kn + 0.8, 80.0), p.command.speed_rpm)
    )
    ask(rig, "nmpc")
    rig.run(1)
    assert rig.last.command.force_kn == pytest.approx(78.5)
    assert rig.last.reason == Reason(ReasonCode.SLEWING)
    rig.run(rig.arbiter.settings.transition_ticks)
    assert rig.last.command.force_kn == pytest.approx(80.0)
    assert rig.last.reason == Reason()


@pytest.mark.requirement("S3")
def test_modes_an_operator_can_ask_for(rig):
    desk, machine = rig.arbiter.operator, rig.arbiter.machine
    assert desk.ask_mode("hold", None, "operator") == Answer.done(Code.MODE_NEXT, mode="hold")
    rig.run(3)
    assert rig.last.source == "hold"
    assert machine.active == ""
    rig.run(200)
    assert machine.mode is Mode.HOLD, "a hold that the operator wants lasts longer than another"
    assert desk.ask_mode("manual", Command(82.0, 400.0), "operator").ok
    rig.run(1)
    assert (rig.last.source, rig.last.command) == ("manual", Command(79.4, 404.5))
    rig.run(5)
    assert rig.last.command == Command(82.0, 400.0)
    assert desk.ask_mode("auto", None, "operator") == Answer.done(
        Code.AUTO_NEXT, controller="decentral"
    )
    rig.run(1)
    assert rig.last.source == "decentral"
    assert desk.ask_mode("safe_stop", None, "operator")[0]
    rig.run(2)
    assert rig.last.source == "safe_stop"
    changes = (Code.MODE, Code.MODE_WITH, Code.SWAP)
    origins = [event.who for event in machine.events if event.fact.code in changes]
    assert origins.count("operator") == 4


@pytest.mark.parametrize(
    ("mode", "manual", "why"),
    [
        ("full_speed", None, Code.UNKNOWN_MODE),
        ("start", None, Code.UNKNOWN_MODE),
        ("manual", None, (Flaw.NOT_FINITE, "force")),
        ("manual", Command(120.0, 400.0), (Flaw.OUT_OF_RANGE, "force")),
        ("manual", Command(80.0, 0.0), (Flaw.OUT_OF_RANGE, "speed")),
    ],
)
def test_wrong_modes_are_refused_with_the_reason(rig, mode, manual, why):
    ok, fact = rig.arbiter.operator.ask_mode(mode, manual, "operator")
    assert not ok
    refused = fact.data.get("refusal")
    assert why == (fact.code if refused is None else refused[:2])
    rig.run(1)
    assert rig.last.source == "decentral"


def test_auto_is_refused_while_no_controller_is_ready(rig):
    rig.arbiter.operator.ask_mode("hold", None, "operator")
    rig.silent |= {"decentral", "nmpc"}
    rig.run(2)
    ok, why = rig.arbiter.operator.ask_mode("auto", None, "operator")
    assert (ok, why.data["readiness"].lack) == (False, Lack.UNUSABLE)


def test_a_switch_in_hold_is_for_later(rig):
    rig.arbiter.operator.ask_mode("hold", None, "operator")
    rig.run(1)
    request = ask(rig, "nmpc")
    assert request.ok
    assert request.reply.fact.code is Code.SELECTED
    rig.run(1)
    assert rig.last.source == "hold"
    rig.arbiter.operator.ask_mode("auto", None, "operator")
    rig.run(1)
    assert rig.last.source == "nmpc"


def test_a_mode_change_ends_a_pending_switch(rig):
    rig.silent.add("nmpc")
    rig.run(1)
    request = ask(rig, "nmpc", strict=False, timeout_s=9.0)
    rig.arbiter.operator.ask_mode("hold", None, "operator")
    assert (request.done, request.ok) == (True, False)
