"""The rules that raise alarms."""

import pytest

from fsw_analysis.rule_book import Limit, default
from fsw_control.cause import Cause
from fsw_control.contract import Reference
from fsw_control.depth_channels import ChannelHealth
from fsw_control.parameters import defaults
from fsw_control.stop import StopCause
from fsw_hmi.alarm_rules import NO_REASON, AlarmRules, Part, Situation
from fsw_hmi.alarms import RANK, TEXTS, Alarm, AlarmList, flood
from fsw_hmi.frames import readable
from fsw_hmi.limits import limits
from fsw_hmi.parameters import HmiParameters
from fsw_hmi.requests import Acknowledge
from fsw_hmi.weld_view import Awake
from fsw_test_support.hmi_situation import (
    GOOD,
    controller,
    gateway,
    lock,
    procedure_left,
    situation,
    state,
)

SETTINGS = defaults(HmiParameters)


@pytest.fixture
def rules():
    return AlarmRules(SETTINGS.__getitem__)


def test_every_alarm_has_one_cause_one_consequence_and_one_action():
    for kind in TEXTS.kinds.values():
        assert kind.text and kind.consequence and kind.action
        assert kind.priority in RANK


@pytest.mark.requirement("S17")
def test_no_alarm_in_a_good_weld(rules):
    assert rules.present(situation(), 0.0) == {}
    assert rules.present(situation(parts=gateway()), 0.0) == {}
    assert rules.present(Situation(), 0.0) == {}


@pytest.mark.requirement("S17")
@pytest.mark.parametrize(
    ("changed", "name", "priority"),
    [
        ({"tick_age_s": 0.21}, "measurements", "high"),
        (
            {"tick_age_s": 9.0, "command_age_s": 9.0},
            "measurements",
            "high",
        ),  # one cause: nothing to answer
        ({"command_age_s": 0.21}, "supervisor", "high"),
        ({"state_age_s": 4.0}, "supervisor", "high"),
        ({"state": state(actual_mode="safe_stop")}, "safe_stop", "high"),
        ({"state": state(actual_mode="hold")}, "hold", "medium"),
        ({"state": state(actual_controller="decentral")}, "failover", "medium"),
        ({"programme": "running", "programme_age_s": 5.1}, "programme", "medium"),
        ({"programme": "held", "programme_age_s": 5.1}, "programme", "medium"),
        (
            {
                "state": state(
                    actual_controller="decentral",
                    controllers=[controller(ready=False, inhibited=True)],
                )
            },
            "failover",
            "medium",
        ),
        (
            {"state": state(interlocks=[lock("depth_high", "warn")])},
            "interlock:depth_high",
            "medium",
        ),
        (
            {"state": state(interlocks=[lock("depth_high", "trip")])},
            "interlock:depth_high",
            "high",
        ),
        ({"state": state(interlocks=[lock("new_one", "trip")])}, "interlock:new_one", "high"),
        ({"state": state(interlocks=[lock("odd", "unknown")])}, "interlock:odd", "medium"),
        (
            {"state": state(controllers=[controller(ready=False, inhibited=True)])},
            "controller:nmpc",
            "medium",
        ),
        ({"state": state(controllers=[controller(ready=False)])}, "controller:nmpc", "low"),
        ({"sample_age_s": {"depth": 0.7}}, "sensor:depth", "medium"),
        ({"sensor_states": {"torque": "frozen"}}, "sensor:torque", "medium"),
        (
            {"channels": {"depth_axial": ChannelHealth.SLIP, "depth_laser": ChannelHealth.GOOD}},
            "channel:depth_axial",
            "medium",
        ),
        (
            {"channels": dict.fromkeys(("depth_axial", "depth_laser"), ChannelHealth.SUSPECT)},
            "depth_doubt",
            "high",
        ),
        ({"channels": {"depth_axial": ChannelHealth.MISSING}}, "depth_doubt", "high"),
        (
            {
                "sensor_states": {"torque": "frozen"},
                "state": state(
                    controllers=[
                        controller(
                            ready=False,
                            why="requires the sensor torque",
                            missing_sensors=["torque"],
                        )
                    ]
                ),
            },
            "sensor:torque",
            "medium",
        ),
        ({"parts": gateway(connection="error")}, "machine", "high"),
        ({"parts": gateway(machine="error")}, "machine", "high"),
        ({"parts": gateway(writes="error")}, "machine", "high"),
        ({"parts": gateway(machine="warn", permissive=False)}, "machine", "high"),
        ({"parts": gateway(permissive=False), "tick_age_s": 5.0}, "machine", "high"),
        (
            {"parts": {"fsw_plant": {"watchdog": Part("error", "no valid command for 2.0 s")}}},
            "machine",
            "high",
        ),
        (
            {"parts": {"fsw_recorder": {"recording": Part("error", "disk full")}}},
            "part:fsw_recorder",
            "medium",
        ),
        ({"parts": {"nmpc": {"solver": Part("error", "none")}}}, "part:nmpc", "medium"),
        (
            {"parts": {"rogue": {f"{i}": Part("error", "bad") for i in range(196)}}},
            "part:rogue",
            "low",
        ),
        (
            {"parts": {"fsw_nmpc": {"a": Part("stale", ""), "b": Part("stale", "")}}},
            "node:fsw_nmpc",
            "low",
        ),
        (
            {
                "parts": {"fsw_nmpc": {"a": Part("stale", "")}},
                "state": state(controllers=[controller(ready=False, why="has left the graph")]),
            },
            "controller:nmpc",
            "low",
        ),
        (
            {"parts": {"fsw_plant": {"a": Part("stale", "")}}, "tick_age_s": 9.0},
            "measurements",
            "high",
        ),
        (
            {"parts": {"fsw_supervisor": {"command topic": Part("error", "a foreign writer")}}},
            "foreign",
            "medium",
        ),
        (
            {"parts": {"fsw_plant": {"commands": Part("error", "2 publishers; 3 refused")}}},
            "foreign",
            "medium",
        ),
        (
            {
                "parts": {
                    "fsw_supervisor": {"arbiter": Part("ok", ""), "standby": Part("stale", "")}
                }
            },
            "standby",
            "low",
        ),
        ({"pages": 2}, "other_page", "medium"),
        ({"values": {"depth_mm": 2.77}}, "quality:depth_error_mm", "medium"),
        ({"values": {"temperature_c": 813.0}}, "quality:temperature_error_c", "medium"),
        ({"values": {"force_kn": 86.0}}, "deviation:force_kn", "medium"),
        ({"attainable": Reference(2.66, 849.0)}, "out_of_reach", "low"),
        ({"values": {"command_speed_rpm": 421.0}}, "deviation:speed_rpm", "medium"),
        (
            {"values": {"temperature_c": 911.0, "reference_temperature_c": 911.0}},
            "essential:temperature_c",
            "medium",
        ),
        (
            {
                "values": {"temperature_c": 911.0, "reference_temperature_c": 911.0},
                "state": state(interlocks=[lock("temperature_high", "trip")]),
            },
            "interlock:temperature_high",
            "high",
        ),
    ],
)
def test_alarm_of_a_situation(rules, changed, name, priority):
    present = rules.present(situation(**changed), 0.0)
    assert {name: alarm.priority for name, alarm in present.items()} == {name: priority}
    assert all(alarm.text and alarm.consequence and alarm.advice for alarm in present.values())


@pytest.mark.parametrize(
    "changed",
    [
        {"state": state(actual_mode="hold", target_mode="hold")},  # somebody wants it
        {
            "state": state(actual_mode="hold", cause=Cause.STARTED),
            "command_age_s": 60.0,
        },  # the weld has not begun
        {"command_age_s": None},
        {"parts": {"fsw_supervisor": {"controller nmpc": Part("error", "told by its health")}}},
        {"parts": {"fsw_nmpc": {"a": Part("stale", ""), "b": Part("ok", "")}}},
        {"parts": {"fsw_machine": {"machine": Part("stale", "", False), "clock": Part("ok", "")}}},
        {"values": dict.fromkeys(GOOD, float("nan"))},
        {"programme": "running", "programme_age_s": 4.9},
        {"programme": "done", "programme_age_s": 99.0},
        {"programme": "aborted", "programme_age_s": 99.0},
        {
            "parts": {
                "fsw_plant": {"commands": Part("warn", "2 publishers: a supervisor takes over")}
            }
        },
    ],
)
def test_no_alarm_of_what_is_wanted_or_told_otherwise(rules, changed):
    assert rules.present(situation(**changed), 0.0) == {}


def test_failover_tells_why_the_selected_controller_was_left_whatever_happens_then(rules):
    def failover(**changed):
        alarm = rules.present(situation(state=state(**changed)), 0.0).get("failover")
        return alarm and (alarm.what.split()[0], alarm.what.split()[-1], alarm.why)

    first = ("decentral", "nmpc", "late")
    late, jump = (
        controller(inhibited=True, why="late"),
        controller("decentral", inhibited=True, why="jump"),
    )
    assert failover(actual_controller="decentral", controllers=[late]) == first
    failover(actual_mode="hold", actual_controller="", controllers=[late, jump])
    others = {
        "actual_controller": "other",
        "controllers": [controller(why="2 of 5 good proposals in a row"), jump],
    }
    assert failover(**others) == ("other", "nmpc", "late")
    assert failover() is None


def test_failover_at_the_start_tells_what_the_selected_controller_lacks_not_that_the_other_is_there(
    rules,
):
    waiting = controller(ready=False, why="3 of 5 good proposals in a row")
    begun = state(
        actual_controller="decentral", reason="decentral is configured", controllers=[waiting]
    )
    alarms = rules.present(situation(state=begun), 0.0)
    assert alarms["failover"].why == waiting["why"]


def test_a_swap_that_is_asked_for_is_an_alarm_only_when_it_does_not_come(rules):
    listed = AlarmList(lambda count: Alarm("", "", "", "low"))

    def texts(now_s, **changed):
        listed.update(rules.present(situation(state=state(**changed)), now_s), now_s)
        return [entry.alarm.text for entry in listed.entries.values()]

    waits = {
        "target_controller": "decentral",
        "reason": "nmpc is configured to start with",
        "cause": Cause.READY,
    }
    assert texts(0.0) == texts(1.0, **waits) == texts(11.0, **waits) == []
    assert (
        texts(12.0, actual_controller="decentral", target_controller="decentral")
        == texts(13.0)
        == []
    )
    assert texts(20.0, **waits) == []
    late = ["nmpc commands instead of decentral: it was asked for, and is not ready"]
    assert texts(33.0, **waits) == late
    assert texts(40.0) == texts(42.0) == late, "until it is acknowledged"
    listed.acknowledge(["failover"], "Anna")
    late = controller(inhibited=True, why="late")
    [text] = texts(43.0, actual_controller="other", controllers=[late])
    assert "other" in text and text.endswith("nmpc: late")


def test_alarm_of_a_sensor_tells_what_it_began_with(rules):
    def cause(reason):
        alarm = rules.present(situation(sensor_states={"depth": reason}), 0.0).get("sensor:depth")
        return alarm and alarm.cause

    assert cause("frozen") == cause("recovering") == "frozen"
    assert cause("missing") == cause("recovering") == "missing"
    assert cause("good") is None
    assert cause("recovering") == "recovering"


@pytest.mark.parametrize("cause", [StopCause.INTERLOCK, StopCause.WATCHDOG, StopCause.OPERATOR])
def test_safe_stop_of_an_operator_is_no_trip(rules, cause):
    stopped = state(actual_mode="safe_stop", cause=Cause.STOP_HEARD, stop_cause=cause)
    assert rules.present(situation(state=stopped), 0.0)["safe_stop"].trip == (
        cause is not StopCause.OPERATOR
    )


def test_interlock_that_trips_with_the_safe_stop_is_the_first(rules):
    alarms = AlarmList(lambda count: Alarm("", "", "", "low"))
    tripped = state(
        actual_mode="safe_stop",
        cause=Cause.INTERLOCK_TRIP,
        interlocks=[lock("depth_high", "trip")],
    )
    alarms.update(rules.present(situation(state=tripped), 0.0), 0.0)
    assert alarms.entries["safe_stop"].first == alarms.entries["interlock:depth_high"].alarm.text


def test_a_stop_by_an_interlock_names_it_as_people_do(rules):
    def why(*tripped):
        present = [lock("depth_low", "trip"), *(lock(name, "trip") for name in tripped)]
        stopped = state(
            actual_mode="safe_stop",
            cause=Cause.INTERLOCK_TRIP,
            reason="so",
            interlocks=present,
            tripped=list(tripped),
        )
        return rules.present(situation(state=stopped), 0.0)["safe_stop"].text.removeprefix(
            "Safe stop: "
        )

    assert why("torque_high") == "Torque too high", "what trips later is no cause"
    assert why("new_one") == why() == "so"


def test_supervisor_that_never_reports_is_an_alarm_when_the_plant_runs(rules):
    def present(now_s, **changed):
        return list(
            rules.present(
                situation(state=None, state_age_s=None, command_age_s=None, **changed), now_s
            )
        )

    assert present(0.0, tick_age_s=None) == []
    assert present(10.0) == []
    assert present(14.0) == ["supervisor"]


@pytest.mark.parametrize(
    ("age", "name"), [("tick_age_s", "measurements"), ("command_age_s", "supervisor")]
)
def test_silence_is_told_within_three_tenths_of_a_second(rules, age, name):
    alarms = AlarmList(lambda count: Alarm("", "", "", "low"))
    for look in range(100):  # the node looks every 0.05 s; here at the worst moment
        now_s = 0.049 + 0.05 * look
        alarms.update(rules.present(situation(**{age: now_s}), now_s), now_s)
        if name in alarms.entries:
            break
    assert now_s < 0.3


def test_one_look_after_a_stall_of_the_page_is_no_alarm(rules):
    alarms = AlarmList(lambda count: Alarm("", "", "", "low"))
    alarms.update(rules.present(situation(tick_age_s=1.0), 1.0), 1.0)
    alarms.update(rules.present(situation(), 1.05), 1.05)
    assert alarms.entries == {}


@pytest.mark.parametrize(
    ("values", "name", "lasts_s"),
    [
        ({"depth_mm": 2.55}, "quality:depth_error_mm", 2.0),
        ({"temperature_c": 815.0}, "quality:temperature_error_c", 10.0),
        ({"depth_mm": 1.3}, "essential:depth_mm", 2.0),  # and off its set-point, which is less
        ({"force_kn": 60.0}, "deviation:force_kn", 10.0),
    ],
)
def test_value_outside_and_its_return_must_last(rules, values, name, lasts_s):
    alarms = rules.present(situation(values), 0.0)
    assert {key: (alarm.on_s, alarm.off_s) for key, alarm in alarms.items()} == {
        name: (lasts_s, lasts_s)
    }


SILENT = {"fsw_supervisor": {"arbiter": Part("stale", "")}}
ENDED = {"tick_age_s": 60.0, "command_age_s": 60.0, "state_age_s": 60.0, "parts": SILENT}


INTERLOCKS = {
    "interlocks.temperature_high.trip": 910.0,
    "interlocks.temperature_high.warn": 900.0,
    "interlocks.force_high.warn": 95.5,
}


@pytest.mark.requirement("S17")
@pytest.mark.parametrize(
    "changed",
    [{}, {"state": None, "state_age_s": None}, {"state_age_s": 60.0}],
    ids=["heard", "never heard", "silent"],
)
def test_a_value_beyond_a_trip_is_an_alarm_though_no_supervisor_says_so(rules, changed):
    values = {"temperature_c": 930.0, "force_kn": 96.0, "command_force_kn": 85.0}
    present = rules.present(situation(values, interlocks=INTERLOCKS, **changed), 60.0)
    assert {"essential:temperature_c", "deviation:force_kn"} <= present.keys()


def test_a_drive_off_its_command_is_an_alarm_beside_a_limit_of_its_quantity(rules):
    limit = Limit(variable="speed_rpm", min=380.0, max=420.0, source="test")
    book = default().model_copy(update={"quality": (limit,)})
    present = rules.present(situation({"speed_rpm": 360.0}, book=book), 0.0)
    assert {"quality:speed_rpm", "deviation:speed_rpm"} <= present.keys()


def test_what_the_end_of_a_weld_explains_is_no_alarm(rules):
    assert rules.present(situation(programme="done", **ENDED), 0.0) == {}
    assert rules.present(situation(programme="running", **ENDED), 0.0)
    assert "machine" in rules.present(situation(programme="done", parts=gateway("error")), 0.0)


def test_while_something_is_measured_the_end_of_a_programme_explains_nothing(rules):
    silent = {"command_age_s": 60.0, "state_age_s": 60.0, "parts": SILENT}
    jumped = {"sensor_states": {"depth": "jump"}}
    for programme in ("running", "done"):
        present = rules.present(situation(programme=programme, **silent, **jumped), 0.0)
        assert {"supervisor", "sensor:depth"} <= present.keys()


def test_alarm_before_the_end_stays_after_it(rules):
    silent = {"command_age_s": 60.0, "state_age_s": 60.0, "parts": SILENT}
    rules.present(situation(programme="running", **silent), 0.0)
    assert "supervisor" in rules.present(situation(programme="done", **ENDED), 1.0)


COLD = {"temperature_c": 700.0, "temperature_error_c": -150.0, "depth_mm": 2.0}
LOW = [lock("temperature_low", "trip")]


def test_what_a_stop_explains_is_no_alarm_but_what_led_to_it_is(rules):
    stopped = situation(COLD, state=state(actual_mode="safe_stop", interlocks=LOW))
    cooling = rules.present(situation(COLD, state=state(interlocks=LOW)), 0.0)
    assert "interlock:temperature_low" in cooling
    assert rules.present(stopped, 1.0).keys() == {*cooling, "safe_stop"}
    rules.present(situation(), 2.0)
    assert rules.present(stopped, 3.0).keys() == {"safe_stop"}
    other = state(actual_mode="safe_stop", interlocks=[lock("depth_high", "trip"), *LOW])
    assert rules.present(situation(COLD, state=other), 4.0).keys() == {
        "safe_stop",
        "interlock:depth_high",
    }


def test_cold_weld_is_an_alarm_if_it_led_to_the_stop(rules):
    cause = {"actual_mode": "safe_stop", "cause": Cause.INTERLOCK_TRIP}
    two = [lock("depth_high", "trip"), *LOW]
    for name, is_cause in (("temperature_low", True), ("depth_high", False)):
        stopped = state(interlocks=two, tripped=[name], **cause)
        shown = rules.present(situation(COLD, state=stopped), 0.0)
        assert ("interlock:temperature_low" in shown) is is_cause


@pytest.mark.parametrize("blocked_by", [[], ["temperature_low"]])
def test_alarm_that_refuses_the_acknowledgement_is_listed(rules, blocked_by):
    """After a restart of the supervisor in mid-stop its consequences refuse, too."""
    stopped = state(actual_mode="safe_stop", interlocks=LOW, acknowledgement_blocked_by=blocked_by)
    shown = rules.present(situation(COLD, state=stopped), 0.0)
    assert shown.keys() == {"safe_stop", *(f"interlock:{name}" for name in blocked_by)}


def test_recorder_that_ended_by_an_error_keeps_its_cause(rules):
    part = Part("stale", "writing failed: No space left on device", code="failed")
    raised = rules.present(situation(parts={"fsw_recorder": {"recording": part}}), 0.0)["recorder"]
    assert (raised.cause, raised.why, raised.action) == ("failed", part.text, "mend_recorder")


def test_a_leader_of_the_weld_before_has_not_failed(rules):
    stale = {"fsw_supervisor": {"standby": Part("stale", ""), "process": Part("ok", "")}}
    for programme in ("running", "done"):
        rules.present(situation(leader="a", programme=programme), 0.0)
    next_weld = situation(leader="b", programme="running", parts=stale)
    assert rules.present(next_weld, 0.0)["standby"].cause == "lost"


def test_recorder_that_is_killed_is_an_alarm(rules):
    parts = {"fsw_recorder": {"recording": Part("stale", "recording")}}
    raised = rules.present(situation(parts=parts), 0.0)
    assert {name: alarm.priority for name, alarm in raised.items()} == {"recorder": "medium"}


@pytest.mark.parametrize(("standby", "on_s"), [("ok", 0.6), ("error", 0.04), ("stale", 0.04)])
def test_takeover_by_a_supervisor_that_stands_by_is_no_alarm_while_it_may_last(
    rules, standby, on_s
):
    parts = {"fsw_supervisor_standby": {"standby": Part(standby, "standing by")}}
    silent = situation(command_age_s=0.3, parts=parts)
    assert rules.present(silent, 0.0)["supervisor"].on_s == on_s


def test_who_is_always_late_does_not_hide_that_nothing_comes():
    awake = Awake()
    for now_s in range(21):
        awake.look(float(now_s))
    assert awake.age_s(0.0, 20.0) >= 20.0 - 3 * 2.0


def test_own_lateness_does_not_make_what_waits_in_the_queues_old():
    awake = Awake()
    for look in range(20):
        awake.look(0.05 * look)
    assert awake.age_s(0.9, 0.95) == pytest.approx(0.05)
    awake.look(3.0)  # this process stood still
    assert awake.age_s(0.9, 3.0) == pytest.approx(0.1)
    for look in range(1, 21):
        awake.look(3.0 + 0.05 * look)
    assert awake.age_s(0.9, 4.0) == pytest.approx(1.1)  # really missing
    assert awake.age_s(3.5, 4.0) == pytest.approx(0.5)


def test_whether_commands_reach_the_machine_is_told(rules):
    def reach(**changed):
        now = situation(**changed)
        return rules.reach(now, rules.present(now, 0.0))

    assert reach()["ok"] is True and reach()["text"]
    permitted = reach(parts=gateway())
    assert permitted["ok"] is True and permitted["text"] != reach()["text"]
    assert reach(command_age_s=None)["ok"] is None
    refused = reach(parts=gateway(permissive=False))
    assert refused["ok"] is False and refused["text"] != reach()["text"]
    assert reach(command_age_s=1.0)["ok"] is False
    ended = reach(programme="done", tick_age_s=5.0, command_age_s=5.0)
    assert ended["ok"] is None and ended["text"] == reach(command_age_s=None)["text"]


def test_the_process_window_is_told_as_it_is_in_force(rules):
    narrow = Limit(
        variable="temperature_c", min=805.0, max=870.0, phases=("joint_line",), source="test"
    )
    book = default().model_copy(update={"quality": (narrow,)})
    values = {"temperature_c": 871.0, "reference_temperature_c": 850.0}
    for phase, is_there in (("", True), ("joint_line", True), ("dwell", False)):
        alarms = rules.present(situation(values, phase, book), 0.0)
        assert list(alarms) == ["quality:temperature_c"] * is_there
        assert [alarm.text for alarm in alarms.values()] == [
            "Temperature: outside 805 to 870 °C"
        ] * is_there


def test_a_controller_that_tells_no_reason_is_told_as_such(rules):
    inhibited = state(controllers=[controller(inhibited=True)])
    alarm = rules.present(situation(state=inhibited), 0.0)["controller:nmpc"]
    assert alarm.why == NO_REASON


@pytest.mark.parametrize(
    "name", ["näme", "a" * 300, "tab\there", "\udcff\ud800", "", "{why}", "x:warn:trip", "\n"]
)
def test_odd_names_become_alarms_that_can_be_acknowledged(rules, name):
    name = readable(name)
    odd = state(
        **dict.fromkeys(("reason", "actual_controller"), name),
        interlocks=[lock(name, "trip")],
        controllers=[controller(name, ready=False, why=name)],
    )
    alarms = rules.present(situation(state=odd, parts={name: {name: Part("error", name)}}), 0.0)
    assert len(alarms) >= 3
    Acknowledge(ids=tuple(alarms))


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("nmpc is applied from 1795369262.973 s on", "nmpc is applied from 17:41:02 UTC on"),
        ("it answers 1795369262 s, which", "it answers 17:41:02 UTC, which"),
        ("counter 4294967295, 2.5 s", "counter 4294967295, 2.5 s"),
        ("a\nb\u202e\udcff", "a?b??"),
        ("x" * 500, "x" * 199 + "…"),
    ],
)
def test_texts_of_others_are_made_readable(text, shown):
    assert readable(text) == shown


def test_page_gets_the_limits_that_the_alarms_have():
    bands = limits({}, default())
    assert bands["depth_mm"]["kept"][-1] == {"low": -0.1, "high": 0.1, "of_aim": True}
    assert bands["temperature_c"]["kept"][0] == {"low": 790.0, "high": 910.0, "of_aim": False}
    assert [bands[name]["deviation"] for name in ("force_kn", "speed_rpm")] == [5.0, 20.0]


def test_set_point_out_of_reach_is_told_with_what_is_attainable(rules):
    def alarm_of(depth_mm, temperature_c, **changed):
        alarms = rules.present(
            situation(attainable=Reference(depth_mm, temperature_c), **changed), 0.0
        )
        return alarms.get("out_of_reach")

    assert alarm_of(2.66, 850.0) is None and alarm_of(2.66, 850.4) is None  # the estimates' noise
    below = alarm_of(2.66, 835.2)
    assert (below.cause, below.advice.split()[0]) == ("upper_bound", "Lower")
    assert "850 °C" in below.why and "835 °C" in below.why
    assert rules.replaced == Reference(2.66, 835.2)
    assert alarm_of(2.66, 849.8) is None and rules.replaced is None
    other = alarm_of(2.60, 852.0)
    assert (other.cause, other.advice.split()[0]) == ("lower_bound", "Raise")
    assert "852 °C" in other.why and "2.60 mm" in other.why
    assert alarm_of(2.66, 835.0, tick_age_s=9.0) is None, "what is measured is old"


def test_set_point_out_of_reach_is_raised_when_it_lasts_and_goes_by_itself(rules):
    kinds = []
    listed = AlarmList(lambda count: None, lambda _, kind, *__: kinds.append(kind.word))

    def states(attainable, now_s):
        listed.update(rules.present(situation(attainable=attainable), now_s), now_s)
        return {name: entry.state for name, entry in listed.entries.items()}

    out, within = Reference(2.66, 835.0), Reference(2.66, 850.0)
    assert states(out, 0.0) == states(out, 1.9) == {}
    assert states(out, 2.1) == {"out_of_reach": "active"}
    assert states(within, 3.0) == states(within, 4.9) == {"out_of_reach": "active"}
    assert states(within, 5.1) == {"out_of_reach": "cleared"}
    listed.acknowledge(["out_of_reach"], "anna")
    assert states(within, 6.0) == {}
    assert kinds == ["raised", "cleared", "acknowledged"]


def test_what_the_monitor_tells_is_an_alarm_with_its_cause_and_advice(rules):
    parts = {
        "fsw_monitor": {
            "thermocouple_drift": Part(
                "warn", "It drifts", action="replace_thermocouple", code="alarm"
            ),
            "later": Part("warn", "It is new", action="of_a_later_version"),
            "foreign": Part("warn", "It is odd", action="swap_back"),
            "watch": Part("ok", ""),
        }
    }
    alarms = rules.present(situation(parts=parts), 0.0)
    assert {name: (alarm.text, alarm.action, alarm.cause) for name, alarm in alarms.items()} == {
        "watch:thermocouple_drift": ("It drifts", "replace_thermocouple", "thermocouple_drift"),
        "watch:later": ("It is new", "see_trends", "later"),
        "watch:foreign": ("It is odd", "see_trends", "foreign"),
    }


def test_shelved_alarm_of_the_monitor_stays_so_until_the_cause_is_another(rules):
    listed = AlarmList(lambda count: None)

    def states(now_s, **codes):
        parts = {cause: Part("warn", code, code=code) for cause, code in codes.items()}
        alarms = rules.present(situation(parts={"fsw_monitor": parts}), now_s)
        listed.update(alarms, now_s)
        return {name: entry.state for name, entry in listed.entries.items()}

    assert states(0.0, tool_wear="alarm") == {"watch:tool_wear": "active"}
    listed.shelve("watch:tool_wear", 10.0, "anna", "known", 1.0)
    # only the causes that cannot be distinguished from it differ
    assert states(2.0, tool_wear="alarm_or") == {"watch:tool_wear": "shelved"}
    other = states(3.0, tool_wear="alarm_or", torque_gain="alarm")
    assert other == {"watch:tool_wear": "shelved", "watch:torque_gain": "active"}


def test_a_shelved_deviation_from_the_procedure_comes_back_with_another_one(rules):
    listed = AlarmList(flood)

    def shown(now_s, **set_points):
        parts = procedure_left(**set_points)
        listed.update(rules.present(situation(parts=parts), now_s), now_s)
        return listed.rows(now_s, 0.0)[0]["state"]

    assert shown(0.0, temperature_c=905.0) == "active"
    assert listed.shelve("procedure", 60.0, "anna", "it is known", 0.0).outcome == "done"
    assert shown(1.0, temperature_c=906.0) == "shelved"
    assert shown(2.0, temperature_c=906.0, depth_mm=3.45) == "active"
