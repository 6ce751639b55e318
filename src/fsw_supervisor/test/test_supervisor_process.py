"""Sensors and interlocks: what the process forbids, whoever controls."""

import math
import random

import pytest

from fsw_control.cause import Cause, Severity
from fsw_control.reason import Reason, ReasonCode
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.safety_monitor import Interlock, SafetyMonitor
from fsw_supervisor.state_machine import Machine, Mode

NAN = math.nan


def test_a_controller_that_copes_stays(make_rig):
    rig = make_rig()
    rig.tolerated["decentral"] = ("thermocouple",)
    rig.run(10)
    rig.values["thermocouple"] = NAN
    rig.run(20)
    assert rig.arbiter.safety.invalid_sensors == ("thermocouple",)
    assert rig.last.source == "decentral"


@pytest.mark.requirement("S8")
@pytest.mark.parametrize("fault", ["nan", "missing"])
def test_a_controller_that_does_not_cope_gives_way_to_one_that_does(make_rig, fault):
    rig = make_rig()
    rig.tolerated["nmpc"] = ("depth",)
    rig.run(10)
    if fault == "missing":
        del rig.values["depth"]
    else:
        rig.values["depth"] = NAN
    rig.run(3)
    assert rig.last.source == "decentral", "the last good sample stands in for a moment"
    rig.run(2)
    assert rig.last.source == "nmpc"
    assert rig.arbiter.machine.reason.chain[1] == Reason(ReasonCode.SENSOR_REQUIRED, ("depth",))
    assert not rig.arbiter.registry.get("decentral").inhibited, "it has not failed"
    rig.values["depth"] = 2.66
    rig.run(5)
    assert rig.arbiter.safety.invalid_sensors == ()
    assert not rig.arbiter.operator.ask_switch("decentral", True, 1.0, "operator", rig.now_s).done


@pytest.mark.requirement("S7")
def test_nobody_copes_means_hold_then_safe_stop(make_rig):
    rig = make_rig(SupervisorParameters.from_values({"hold_timeout_s": 1.0})).run(10)
    rig.values["torque"] = NAN
    rig.run(6)
    assert rig.last.source == "hold"
    rig.run(12)
    assert rig.last.source == "safe_stop"


def test_a_short_dropout_changes_nothing(rig):
    rig.values["depth"] = NAN
    rig.run(2)
    rig.values["depth"] = 2.66
    rig.run(5)
    assert {tick[0].source for tick in rig.ticks} == {"decentral"}
    assert rig.arbiter.machine.transitions == 1


@pytest.mark.requirement("S8")
def test_a_frozen_sensor_is_noticed(make_rig):
    rig = make_rig()
    noise = random.Random(1)
    for _ in range(120):
        rig.values["depth"] = 2.66 + noise.gauss(0.0, 0.002)
        rig.run(1)
    rig.run(40)
    assert rig.arbiter.safety.invalid_sensors == ("depth",)
    assert "frozen" in [fact["flaw"] for fact in rig.facts("sensor_invalid")]


def test_with_all_sensors_gone_the_drives_keep_the_ticks_coming(rig):
    rig.values.clear()
    rig.run(10)
    assert rig.last.source == "hold"


def test_a_sensor_known_to_be_missing_costs_no_time(rig):
    del rig.values["depth"]
    rig.tolerated["decentral"] = ("depth",)
    rig.delays_s["decentral"] = 0.001
    rig.run(1)
    assert rig.last.latency_s == pytest.approx(rig.arbiter.settings.sensor_grace_s)
    rig.run(10)
    assert rig.last.latency_s == pytest.approx(0.001)


def test_sensors_that_are_late_but_before_the_proposal_are_not_missing(rig):
    arbiter = rig.arbiter
    late_s = arbiter.settings.sensor_grace_s + 0.01
    for _ in range(5):  # longer than the last good samples stand in
        rig.stamp_ns += 100_000_000
        rig.now_s += 0.1
        arbiter.on_sample("depth", rig.stamp_ns, rig.values["depth"], rig.now_s)
        arbiter.on_time(rig.now_s + late_s)
        for sensor in ("torque", "thermocouple"):
            arbiter.on_sample(sensor, rig.stamp_ns, rig.values[sensor], rig.now_s + late_s)
        assert arbiter.on_proposal("decentral", rig.proposal("decentral"), rig.now_s + late_s)
    assert arbiter.safety.invalid_sensors == ()
    assert "missing" not in [fact["flaw"] for fact in rig.facts("sensor_invalid")]


@pytest.mark.requirement("S1", "S3")
@pytest.mark.parametrize(
    ("sensor", "value", "name"),
    [
        ("thermocouple", 911.0, "temperature_high"),
        ("thermocouple", 789.0, "temperature_low"),
        ("depth", 3.8, "depth_high"),
        ("torque", 1750.0, "torque_high"),
    ],
)
def test_an_interlock_trips_into_safe_stop_whoever_controls(rig, sensor, value, name):
    start = rig.values[sensor]
    for step in range(1, 21):
        rig.values[sensor] = start + (value - start) * step / 20
        rig.run(1)
    rig.run(3)
    assert rig.last.source == "safe_stop"
    assert rig.arbiter.machine.cause is Cause.INTERLOCK_TRIP
    assert rig.arbiter.safety.active[name] is Severity.TRIP
    ok, why = rig.arbiter.operator.ask_mode("auto", None, "operator")
    assert (ok, why.code) == (False, "cause_present")
    assert name in [cause.data["interlock"] for cause in why.data["causes"]]
    for step in range(21):
        rig.values[sensor] = value + (start - value) * step / 20
        rig.run(1)
    assert rig.arbiter.safety.active == {}
    assert rig.last.source == "safe_stop", "only the operator leads out"
    assert rig.arbiter.operator.acknowledge("operator")[0]
    assert rig.arbiter.operator.ask_mode("auto", None, "operator")[0]
    rig.run(1)
    assert rig.arbiter.machine.mode is Mode.AUTO


@pytest.mark.requirement("S2")
def test_a_spike_trips_nothing(rig):
    rig.values["thermocouple"] = 920.0
    rig.run(1)
    rig.values["thermocouple"] = 850.0
    rig.run(5)
    assert rig.arbiter.machine.mode is Mode.AUTO


@pytest.fixture
def monitor():
    """A monitor with the default limits, which believes a level after 3 ticks."""
    return SafetyMonitor(Machine(SupervisorParameters.from_values({})))


def test_hysteresis_of_warning_and_trip(monitor):
    seen = []
    for value in (
        899.9,
        900.0,
        900.0,
        900.0,
        898.1,
        897.9,
        910.0,
        910.0,
        910.0,
        908.1,
        908.0,
        899.0,
        898.0,
    ):
        monitor.watch({"temperature_c": value})
        seen.append(monitor.active.get("temperature_high", Severity.OK).word)
    assert seen == ["ok"] * 3 + [
        "warn",
        "warn",
        "ok",
        "ok",
        "ok",
        "trip",
        "trip",
        "trip",
        "trip",
        "ok",
    ]


@pytest.mark.requirement("S1")
def test_low_interlocks_mirror_high_ones():
    interlock = Interlock("temperature_low", "temperature_c", 800.0, 790.0, 2.0)
    levels = [interlock.level(value, Severity.OK) for value in (801.0, 800.0, 790.1, 790.0)]
    assert levels == [Severity.OK, Severity.WARN, Severity.WARN, Severity.TRIP]
    assert interlock.level(791.0, Severity.TRIP) is Severity.TRIP
    assert interlock.level(792.1, Severity.TRIP) is Severity.WARN


@pytest.mark.requirement("S2")
def test_a_value_that_is_not_finite_leaves_the_level(monitor):
    for value in (905.0, 905.0, 905.0, NAN, NAN):
        monitor.watch({"temperature_c": value})
    assert monitor.active == {"temperature_high": Severity.WARN}
