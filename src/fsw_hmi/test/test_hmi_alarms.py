"""The list of alarms and the rules that raise them."""

from math import nan

import pytest

from fsw_hmi.alarm_rules import AlarmRules, Part, Situation
from fsw_hmi.alarms import Alarm, AlarmList

LOW, MEDIUM, HIGH = (Alarm(f"{name} text", "do this", name) for name in ("low", "medium", "high"))


def row(alarms, name):
    return next((one for one in alarms.rows() if one["id"] == name), None)


@pytest.mark.requirement("S17")
def test_alarm_goes_through_its_states():
    alarms = AlarmList()
    assert alarms.update({"a": HIGH}, 1.0)
    assert row(alarms, "a") == {
        **{"id": "a", "text": "high text", "advice": "do this", "priority": "high", "state": "active"},
        **{"first_out": True, "raised_s": 1.0, "changed_s": 1.0},
    }
    assert not alarms.update({"a": HIGH}, 2.0)
    assert alarms.acknowledge(["a"], 3.0) == 1
    assert (row(alarms, "a")["state"], row(alarms, "a")["changed_s"]) == ("acknowledged", 3.0)
    assert alarms.update({}, 4.0)
    assert alarms.rows() == []


@pytest.mark.requirement("S17")
def test_alarm_that_is_gone_stays_until_acknowledged():
    alarms = AlarmList()
    alarms.update({"a": HIGH}, 1.0)
    alarms.update({}, 2.0)
    assert row(alarms, "a")["state"] == "cleared"
    alarms.update({"a": HIGH}, 3.0)
    assert (row(alarms, "a")["state"], row(alarms, "a")["raised_s"]) == ("active", 1.0)
    alarms.update({}, 4.0)
    assert alarms.acknowledge(["a", "unknown"], 5.0) == 1
    assert alarms.rows() == []


@pytest.mark.requirement("S17")
def test_the_first_of_a_group_is_marked():
    alarms = AlarmList()
    alarms.update({"first": LOW}, 1.0)
    alarms.update({"first": LOW, "second": HIGH}, 2.0)
    assert [one["id"] for one in alarms.rows()] == ["second", "first"]  # the most urgent on top
    assert [one["id"] for one in alarms.rows() if one["first_out"]] == ["first"]
    alarms.update({"second": HIGH}, 3.0)  # gone, but not acknowledged
    assert [one["id"] for one in alarms.rows() if one["first_out"]] == ["first"]
    alarms.acknowledge(["first"], 4.0)
    assert [one["id"] for one in alarms.rows() if one["first_out"]] == ["second"]


def test_alarm_that_becomes_worse_has_to_be_seen_again():
    alarms = AlarmList()
    alarms.update({"a": MEDIUM}, 1.0)
    alarms.acknowledge(["a"], 2.0)
    assert alarms.update({"a": HIGH}, 3.0)
    assert (row(alarms, "a")["state"], row(alarms, "a")["priority"]) == ("active", "high")
    alarms.acknowledge(["a"], 4.0)
    alarms.update({"a": MEDIUM}, 5.0)
    assert row(alarms, "a")["state"] == "acknowledged"


def controller(name="nmpc", ready=True, inhibited=False, reason=""):
    return {"name": name, "ready": ready, "inhibited": inhibited, "reason": reason}


def state(**changed):
    usual = {"target_controller": "nmpc", "actual_controller": "nmpc", "target_mode": "auto", "actual_mode": "auto"}
    return {
        **usual,
        "reason": "so",
        "requested_by": "operator",
        "controllers": [controller()],
        "interlocks": [],
        **changed,
    }


def situation(**changed):
    usual = {"state": state(), "state_age_s": 0.1, "tick_age_s": 0.05, "depth_error_mm": 0.0, "temperature_c": 816.0}
    usual["sample_age_s"] = {"depth": 0.0, "torque": 0.0, "thermocouple": 0.0}
    return Situation(**usual | changed)


@pytest.fixture
def rules():
    return AlarmRules(lambda: 2.0)


@pytest.mark.requirement("S17")
def test_no_alarm_in_a_good_weld(rules):
    assert rules.present(situation(), 0.0) == {}
    assert rules.present(Situation(), 0.0) == {}


@pytest.mark.requirement("S17")
@pytest.mark.parametrize(
    ("changed", "name", "priority"),
    [
        ({"tick_age_s": 0.6}, "measurements", "high"),
        ({"state_age_s": 4.0}, "supervisor", "high"),
        ({"state": state(actual_mode="safe_stop")}, "safe_stop", "high"),
        ({"state": state(actual_mode="hold")}, "hold", "medium"),
        ({"state": state(actual_controller="decentral")}, "failover", "medium"),
        ({"state": state(interlocks=["depth_high:warn"])}, "interlock:depth_high", "medium"),
        ({"state": state(interlocks=["depth_high:trip"])}, "interlock:depth_high", "high"),
        ({"state": state(interlocks=["new_one:trip"])}, "interlock:new_one", "high"),
        ({"state": state(controllers=[controller(ready=False, inhibited=True)])}, "controller:nmpc", "medium"),
        ({"sample_age_s": {"depth": 0.7}}, "sensor:depth", "medium"),
        ({"sensor_reasons": {"torque": "frozen"}}, "sensor:torque", "medium"),
        ({"parts": {"fsw_recorder: recording": Part("error", "disk full")}}, "part:fsw_recorder: recording", "medium"),
        ({"parts": {"fsw_nmpc: a": Part("stale", ""), "fsw_nmpc: b": Part("stale", "")}}, "node:fsw_nmpc", "low"),
    ],
)
def test_alarm_of_a_situation(rules, changed, name, priority):
    present = rules.present(situation(**changed), 0.0)
    assert {name: one.priority for name, one in present.items()} == {name: priority}
    assert all(one.text and one.advice for one in present.values())


@pytest.mark.parametrize(
    "changed",
    [
        {"state": state(actual_mode="hold", target_mode="hold")},  # somebody wants it
        {"state": state(actual_mode="hold", requested_by="start")},  # the weld has not begun
        {"parts": {"fsw_supervisor: controller nmpc": Part("error", "told by its health")}},
        {"parts": {"fsw_nmpc: a": Part("stale", ""), "fsw_nmpc: b": Part("ok", "")}},
        {"depth_error_mm": nan, "temperature_c": nan},
    ],
)
def test_no_alarm_of_what_is_wanted_or_told_otherwise(rules, changed):
    assert rules.present(situation(**changed), 0.0) == {}


def test_controller_has_time_to_become_ready(rules):
    waiting = situation(state=state(controllers=[controller(ready=False, reason="no set-point yet")]))
    assert "controller:nmpc" not in rules.present(waiting, 0.0)
    assert "controller:nmpc" not in rules.present(waiting, 2.9)
    assert "no set-point yet" in rules.present(waiting, 3.0)["controller:nmpc"].text
    assert rules.present(situation(), 3.1) == {}


def test_supervisor_that_never_reports_is_an_alarm_when_the_plant_runs(rules):
    def present(now_s, **changed):
        return list(rules.present(situation(state=None, state_age_s=None, **changed), now_s))

    assert present(0.0, tick_age_s=None) == []
    assert present(10.0) == []
    assert present(14.0) == ["supervisor"]


def test_quality_must_be_lost_for_a_while_and_regained_with_a_margin(rules):
    def alarm(error_mm, now_s):
        return "quality_depth" in rules.present(situation(depth_error_mm=error_mm), now_s)

    assert not alarm(0.15, 0.0)
    assert not alarm(0.05, 1.0)  # a spike
    assert not alarm(-0.15, 2.0)
    assert alarm(-0.15, 4.0)
    assert alarm(-0.09, 10.0)  # inside, but not by the margin
    assert alarm(-0.05, 11.0)
    assert not alarm(-0.05, 13.0)
