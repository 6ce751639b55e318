"""Sensors that fail: the worse the fault, the sooner the stop.

Jumps and blindness are causes of their own.
"""

import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fsw_control.cause import Severity
from fsw_control.contract import Command
from fsw_control.parameters import defaults
from fsw_control.sensors import REQUIRED
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.safety_monitor import Blindness, SafetyMonitor
from fsw_supervisor.state_machine import Machine, Mode
from fsw_supervisor.tick import Tick

NAN = math.nan
GOOD = {"depth": 2.66, "torque": 1052.0, "thermocouple": 850.0}
START = Command(78.4, 407.5)
TOLERANT = ("depth", "torque", "thermocouple")
BLIND_LIMIT_S = defaults(SupervisorParameters)["blind_limit_s"]


@pytest.fixture
def rig(make_rig):
    """A weld in auto whose controllers do without any sensor."""
    rig = make_rig()
    rig.tolerated = dict.fromkeys(rig.names, TOLERANT)
    return rig.run(20)


def stopped_after(rig, ticks):
    """Number of the tick in which the safe stop began; None if it did not."""
    for tick in range(1, ticks + 1):
        rig.run(1)
        if rig.last.source == "safe_stop":
            return tick
    return None


# ---------------------------------------------------------------- out of range


@pytest.mark.requirement("S36")
@pytest.mark.parametrize(
    ("sensor", "value", "interlock"),
    [
        ("torque", 1700.0, "torque_high"),
        ("torque", 3500.0, "torque_high"),
        ("torque", 1e9, "torque_high"),
        ("torque", 50.0, "torque_low"),
        ("torque", -1e9, "torque_low"),
        ("thermocouple", 950.0, "temperature_high"),
        ("thermocouple", 1100.0, "temperature_high"),
        ("thermocouple", 200.0, "temperature_low"),
        ("depth", 5.0, "depth_high"),
        ("depth", 50.0, "depth_high"),
        ("depth", 1.0, "depth_low"),
        ("depth", -3.0, "depth_low"),
    ],
)
def test_a_worse_value_stops_no_later(rig, sensor, value, interlock):
    rig.values[sensor] = value
    assert stopped_after(rig, 10) == 3
    assert rig.arbiter.safety.active[interlock] is Severity.TRIP


@pytest.mark.requirement("S36")
@given(st.floats(1600.0), st.lists(st.sampled_from([NAN, None]), min_size=0, max_size=2))
def test_a_value_beyond_the_trip_stops_whatever_is_missing_between(value, between):
    machine, count = Machine(SupervisorParameters.from_values({})), itertools.count(1)
    monitor = SafetyMonitor(machine)

    def show(torque):
        samples = {
            name: value for name, value in (GOOD | {"torque": torque}).items() if value is not None
        }
        stamp_ns = next(count) * 10**8
        machine.advance(stamp_ns)
        monitor.judge(Tick(stamp_ns, 0.0, 0.08, None, samples=samples), START)

    for _ in range(10):
        show(1052.0)
    for _ in range(3):
        show(value)
        for sample in between:
            show(sample)
    assert "torque_high" in monitor.tripped


@pytest.mark.requirement("S2")
@pytest.mark.parametrize(
    ("sensor", "value"), [("torque", 3500.0), ("thermocouple", 1100.0), ("depth", 50.0)]
)
def test_a_spike_out_of_range_trips_nothing(rig, sensor, value):
    good = rig.values[sensor]
    for _ in range(20):
        rig.values[sensor] = value
        rig.run(2)
        rig.values[sensor] = good
        rig.run(5)
    assert rig.arbiter.machine.mode is Mode.AUTO


def test_rejected_value_within_limits_clears_no_trip(rig):
    rig.values["torque"] = 3500.0
    rig.run(5)
    rig.values["torque"] = 1450.0  # further from the last good value than the drives can move it
    rig.run(20)
    assert "torque_high" in rig.arbiter.safety.tripped


# ---------------------------------------------------------------- jumps


@pytest.mark.requirement("S35")
@pytest.mark.parametrize(
    ("sensor", "step", "interlock"),
    [
        ("depth", -2.0, "depth_jump"),
        ("depth", 2.0, "depth_jump"),
        ("depth", -0.6, "depth_jump"),
        ("torque", -450.0, "torque_jump"),
        ("torque", -250.0, "torque_jump"),
        ("thermocouple", 50.0, "thermocouple_jump"),
    ],
)
def test_a_jump_stops_and_stays_a_cause_until_it_is_acknowledged(rig, sensor, step, interlock):
    good = rig.values[sensor]
    rig.values[sensor] = good + step
    assert stopped_after(rig, 10) == 3
    assert interlock in rig.arbiter.safety.tripped
    assert interlock in rig.arbiter.machine.reason.interlocks
    rig.run(300)
    assert interlock in rig.arbiter.safety.tripped, "it is not believed with time"
    assert rig.arbiter.safety.invalid_sensors == (sensor,)


@pytest.mark.requirement("S35", "S25")
def test_acknowledging_believes_a_steady_sensor(rig):
    rig.values["thermocouple"] = 895.0
    assert stopped_after(rig, 10) == 3
    operator = rig.arbiter.operator
    assert not operator.ask_mode("auto", None, "operator")[0]
    assert operator.acknowledge("operator")[0]
    rig.run(3)
    assert rig.arbiter.safety.invalid_sensors == ()
    assert operator.ask_mode("auto", None, "operator")[0]
    assert rig.run(5).last.source == "decentral"


@pytest.mark.requirement("S35", "S25")
def test_a_sensor_that_is_not_steady_is_not_acknowledged(rig):
    rig.values["thermocouple"] = 895.0
    rig.run(5)
    rig.values["thermocouple"] = NAN
    rig.run(1)
    assert not rig.arbiter.operator.acknowledge("operator")[0]
    assert rig.arbiter.safety.tripped == ("thermocouple_jump",)


@pytest.mark.requirement("S35")
@pytest.mark.parametrize(("slip_mm", "cause"), [(-2.0, "depth_low"), (2.0, "depth_high")])
def test_a_refused_acknowledgement_readmits_nothing(rig, slip_mm, cause):
    """A value beyond a trip is refused, and the jump stays."""
    rig.values["depth"] = 2.66 + slip_mm
    rig.run(10)
    assert not rig.arbiter.operator.acknowledge("operator")[0]
    rig.run(10)
    assert rig.arbiter.safety.invalid_sensors == ("depth",)
    assert set(rig.arbiter.safety.tripped) == {cause, "depth_jump"}


@pytest.mark.requirement("S35")
@pytest.mark.parametrize(
    ("slip_mm", "cause"), [(-1.0, "torque_model_high"), (0.9, "torque_model_low")]
)
def test_a_slip_that_was_acknowledged_is_still_caught(rig, slip_mm, cause):
    """By the torque."""
    rig.values["depth"] = 2.66 + slip_mm
    rig.run(10)
    rig.arbiter.operator.acknowledge("operator")
    rig.run(10)
    assert rig.arbiter.safety.invalid_sensors == (), "it was readmitted"
    assert cause in rig.arbiter.safety.tripped
    rig.run(1200)
    assert not rig.arbiter.operator.acknowledge("operator")[0], "it is not learnt as normal"


@pytest.mark.requirement("S35")
def test_a_sensor_that_returns_is_believed_but_the_stop_stays(rig):
    rig.values["depth"] = 0.66
    rig.run(10)
    rig.values["depth"] = 2.6
    rig.run(10)
    assert rig.arbiter.safety.invalid_sensors == ()
    assert rig.arbiter.safety.tripped == ()
    assert rig.last.source == "safe_stop"


# ---------------------------------------------------------------- blindness


@pytest.mark.requirement("S37")
@pytest.mark.parametrize("sensor", REQUIRED)
@pytest.mark.parametrize("good_ticks", [0, 4])
def test_the_time_without_a_sensor_adds_up(rig, sensor, good_ticks):
    """0.4 s of good samples in every 14 s do not give the weld away for ever."""
    good = rig.values[sensor]
    stopped = 0
    for _ in range(20):
        rig.values[sensor] = NAN
        stopped = stopped or stopped_after(rig, 40)
        rig.values[sensor] = good
        rig.run(good_ticks)
    assert stopped
    assert f"{sensor}_blind" in rig.arbiter.machine.reason.interlocks


@pytest.mark.requirement("S37")
def test_a_blind_stop_is_acknowledged_once_the_sensor_is_back(rig):
    rig.values["torque"] = NAN
    rig.run(140)
    assert rig.last.source == "safe_stop"
    assert not rig.arbiter.operator.acknowledge("operator")[0]
    rig.values["torque"] = GOOD["torque"]
    rig.run(10)
    assert rig.arbiter.operator.acknowledge("operator")[0]
    assert rig.arbiter.operator.ask_mode("auto", None, "operator")[0]
    assert rig.run(3).last.source == "decentral"


@pytest.mark.requirement("S37")
def test_a_hold_between_does_not_restart_the_time(make_rig):
    """Nobody does without the torque: auto, hold, auto, hold ..."""
    rig = make_rig().run(20)
    stopped = None
    for _ in range(20):
        rig.values["torque"] = NAN
        stopped = stopped or stopped_after(rig, 50)
        rig.values["torque"] = GOOD["torque"]
        stopped = stopped or stopped_after(rig, 6)
    assert stopped
    assert "torque_blind" in rig.arbiter.machine.reason.interlocks


def test_an_operator_may_weld_by_hand_without_a_sensor(rig):
    rig.values["torque"] = NAN
    assert rig.arbiter.operator.ask_mode("manual", START, "operator")[0]
    rig.run(300)
    assert rig.last.source == "manual"
    rig.values["torque"] = GOOD["torque"]
    rig.run(5)
    assert rig.arbiter.operator.ask_mode("auto", None, "operator")[0]
    assert rig.run(5).last.source == "decentral"


@settings(max_examples=200)
@given(st.lists(st.tuples(st.booleans(), st.integers(1, 40), st.floats(0.01, 0.9)), max_size=60))
def test_blind_time_is_bounded_however_it_is_spread(spells):
    blindness = Blindness()
    blindness.limit_s = BLIND_LIMIT_S
    stamp_ns, blind_s, good_s, ever = 0, 0.0, 0.0, False
    blindness.add(stamp_ns, (), True)
    for blind, count, period_s in spells:
        for _ in range(count):
            stamp_ns += round(period_s * 1e9)
            blindness.add(stamp_ns, ("depth",) if blind else (), True)
            blind_s, good_s = blind_s + period_s * blind, good_s + period_s * (not blind)
            ever = ever or blindness.exceeded == ("depth",)
            assert ever or blind_s - 0.1 * good_s < BLIND_LIMIT_S + 1e-3
            if blind_s < BLIND_LIMIT_S - 1e-3:
                assert blindness.exceeded == ()
