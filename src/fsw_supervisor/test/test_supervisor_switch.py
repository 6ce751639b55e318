"""The operator asks for a controller or a mode."""

from dataclasses import replace

import pytest

from fsw_control.cause import Cause
from fsw_control.contract import Command
from fsw_control.reason import Reason
from fsw_supervisor.settings import ArbiterSettings
from fsw_supervisor.state_machine import Mode


def ask(rig, name, strict=True, timeout_s=1.0):
    return rig.arbiter.operator.ask_switch(name, strict, timeout_s, "operator", rig.now_s)


def test_a_swap_happens_between_two_ticks_and_is_answered_when_it_is_applied(rig):
    request = ask(rig, "nmpc")
    assert not request.done
    rig.run(1)
    assert (request.ok, rig.last.source) == (True, "nmpc")
    assert "nmpc is applied" in request.message
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
    assert request.message == "unknown controller 'nobody'; known: decentral, nmpc"


def test_strict_is_refused_with_the_reason(rig):
    rig.spoil("nmpc", healthy=False, reason=Reason.of("no reference"))
    rig.run(1)
    assert ask(rig, "nmpc").message == "nmpc is not usable: no reference"
    rig.edit.clear()
    rig.run(2)
    assert ask(rig, "nmpc").message == "nmpc is not ready: 2 of 5 good proposals in a row"
    rig.delays_s["nmpc"] = 0.09
    rig.run(1)
    assert "late: 90 ms" in ask(rig, "nmpc").message
    assert rig.arbiter.machine.target == "decentral"
    rig.run(1)
    assert rig.last.source == "decentral"


def test_an_inhibited_controller_is_refused(rig):
    rig.silent.add("decentral")
    rig.run(1)
    rig.silent.clear()
    rig.run(10)
    assert "inhibited: no proposal at the deadline" in ask(rig, "decentral").message


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
    assert request.message.startswith("timed out: nmpc is not usable: no proposal at the deadline")
    assert rig.arbiter.machine.target == "decentral"


def test_a_request_without_measurements_times_out(rig):
    request = ask(rig, "nmpc", timeout_s=0.5)
    rig.arbiter.on_time(rig.now_s + 0.6)
    assert request.message == "timed out: no measurement has arrived for the swap"


def test_a_later_request_supersedes(rig):
    rig.silent.add("nmpc")
    rig.run(1)
    first = ask(rig, "nmpc", strict=False, timeout_s=5.0)
    assert ask(rig, "decentral").ok
    assert (first.done, first.ok) == (True, False)
    assert "superseded" in first.message


def test_operators_swaps_keep_a_distance(rig):
    ask(rig, "nmpc")
    rig.run(1)
    assert "only 0.0 s ago" in ask(rig, "decentral").message
    request = ask(rig, "decentral", strict=False)
    rig.run(3)
    assert request.ok
    assert [tick[0].source for tick in rig.ticks[-3:]] == ["nmpc", "nmpc", "decentral"]


def test_a_controller_that_fails_at_the_swap_is_told_so(rig):
    request = ask(rig, "nmpc")
    rig.silent.add("nmpc")
    rig.run(1)
    assert rig.last.source == "decentral"
    assert request.message == "swapped, but nmpc failed: no proposal at the deadline"


def test_a_controller_that_becomes_unready_before_the_swap_is_refused(rig):
    rig.delays_s["nmpc"] = 0.01
    rig.run(1)
    request = ask(rig, "nmpc")
    rig.arbiter.registry.get("nmpc").bad(Reason.of("gone"))
    rig.run(1)
    assert request.message == "nmpc is not usable: gone"
    assert rig.last.source == "decentral"


def test_a_third_controller_that_joins_later_can_be_selected(rig):
    rig.names.append("third")
    rig.run(5)
    assert "controller third has joined" in rig.events()
    request = ask(rig, "third")
    rig.run(1)
    assert request.ok
    assert rig.last.source == "third"
    rig.arbiter.registry.leave("third")
    assert "third has left" in rig.events()


@pytest.mark.requirement("S12")
def test_after_a_swap_the_output_slews_within_the_transition_limit(make_rig):
    rig = make_rig(
        ArbiterSettings.from_values({"force_transition_kn": 0.1, "speed_transition_rpm": 0.5})
    ).run(10)
    rig.edit["nmpc"] = lambda p: replace(
        p, command=Command(min(p.command.force_kn + 0.8, 80.0), p.command.speed_rpm)
    )
    ask(rig, "nmpc")
    rig.run(1)
    assert rig.last.command.force_kn == pytest.approx(78.5)
    assert rig.last.reason.words == "slewing after a swap"
    rig.run(rig.arbiter.settings.transition_ticks)
    assert rig.last.command.force_kn == pytest.approx(80.0)
    assert rig.last.reason.words == ""


@pytest.mark.requirement("S3")
def test_modes_an_operator_can_ask_for(rig):
    desk, machine = rig.arbiter.operator, rig.arbiter.machine
    assert desk.ask_mode("hold", None, "operator") == (True, "hold from the next command on")
    rig.run(3)
    assert rig.last.source == "hold"
    assert machine.active == ""
    rig.run(200)
    assert machine.mode is Mode.HOLD, "a hold that the operator wants lasts longer than another"
    ok, message = desk.ask_mode("manual", Command(82.0, 400.0), "operator")
    assert ok, message
    rig.run(1)
    assert (rig.last.source, rig.last.command) == ("manual", Command(79.4, 404.5))
    rig.run(5)
    assert rig.last.command == Command(82.0, 400.0)
    assert desk.ask_mode("auto", None, "operator") == (
        True,
        "auto from the next command on, with decentral",
    )
    rig.run(1)
    assert rig.last.source == "decentral"
    assert desk.ask_mode("safe_stop", None, "operator")[0]
    rig.run(2)
    assert rig.last.source == "safe_stop"
    assert [e.who for e in machine.events if "->" in e.text].count("operator") == 4


@pytest.mark.parametrize(
    ("mode", "manual", "words"),
    [
        ("full_speed", None, "unknown mode 'full_speed'; known: auto, manual, hold, safe_stop"),
        ("start", None, "unknown mode"),
        ("manual", None, "not finite"),
        ("manual", Command(120.0, 400.0), "outside 60 to 95 kN"),
        ("manual", Command(80.0, 0.0), "outside 300 to 500 rpm"),
    ],
)
def test_wrong_modes_are_refused_in_words(rig, mode, manual, words):
    ok, message = rig.arbiter.operator.ask_mode(mode, manual, "operator")
    assert not ok
    assert words in message
    rig.run(1)
    assert rig.last.source == "decentral"


def test_auto_is_refused_while_no_controller_is_ready(rig):
    rig.arbiter.operator.ask_mode("hold", None, "operator")
    rig.silent |= {"decentral", "nmpc"}
    rig.run(2)
    ok, message = rig.arbiter.operator.ask_mode("auto", None, "operator")
    assert not ok
    assert "decentral is not usable" in message


def test_a_switch_in_hold_is_for_later(rig):
    rig.arbiter.operator.ask_mode("hold", None, "operator")
    rig.run(1)
    request = ask(rig, "nmpc")
    assert request.ok
    assert "applied when auto begins" in request.message
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
