"""Each interlock by itself: where its levels begin and end, what it watches, and what is told."""

import pytest

from fsw_control.cause import Cause, Severity
from fsw_control.contract import Command
from fsw_control.parameters import defaults, validate
from fsw_control.reason import Reason, ReasonCode
from fsw_control.schema.errors import InputError
from fsw_supervisor.facts import Code, Fact
from fsw_supervisor.in_force import CommandInForce
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.safety_monitor import Interlock, SafetyMonitor, interlocks_from
from fsw_supervisor.state_machine import Level, Machine, Mode
from fsw_supervisor.tick import Tick

OK, WARN, TRIP = Severity.OK, Severity.WARN, Severity.TRIP
NAN = float("nan")
#: by interlock: what it watches, a warning, a trip, and the sensor that it needs
CASES = {
    "temperature_low": ("temperature_c", 795.0, 780.0, "thermocouple"),
    "temperature_high": ("temperature_c", 905.0, 930.0, "thermocouple"),
    "depth_high": ("depth_mm", 3.5, 3.8, "depth"),
    "depth_low": ("depth_mm", 1.6, 1.3, "depth"),
    "depth_deviation_high": ("depth_deviation_mm", 0.15, 0.25, ""),
    "force_high": ("force_kn", 96.0, 98.0, ""),
    "torque_low": ("torque_nm", 450.0, 390.0, "torque"),
    "torque_high": ("torque_nm", 1500.0, 1700.0, "torque"),
    "power_high": ("power_kw", 63.0, 70.0, "torque"),
    "torque_model_low": ("torque_residual_percent", -7.0, -9.0, ""),
    "torque_model_high": ("torque_residual_percent", 7.0, 9.0, ""),
    "depth_model_low": ("depth_residual_mm", -0.35, -0.45, ""),
    "depth_model_high": ("depth_residual_mm", 0.35, 0.45, ""),
    "temperature_model_low": ("temperature_residual_c", -80.0, -95.0, ""),
    "temperature_model_high": ("temperature_residual_c", 80.0, 95.0, ""),
}


@pytest.fixture
def monitor():
    """A monitor with the default limits, which believes a level after 3 ticks."""
    return SafetyMonitor(Machine(SupervisorParameters.from_values({})))


def last_told(monitor):
    """The last event about an interlock, but not of the safe stop that it led to."""
    return [
        event
        for event in monitor.machine.events
        if event.fact.code in (Code.INTERLOCK, Code.CLEARED)
    ][-1]


@pytest.mark.requirement("S26")
@pytest.mark.parametrize(
    ("excess", "present", "level"),
    [
        (-0.1, OK, OK),
        (0.0, OK, WARN),
        (9.9, OK, WARN),
        (10.0, OK, TRIP),
        (-1.9, WARN, WARN),
        (-2.0, WARN, OK),
        (10.0, WARN, TRIP),
        (8.1, WARN, WARN),
        (8.1, TRIP, TRIP),
        (8.0, TRIP, WARN),
        (-1.9, TRIP, WARN),
        (-2.0, TRIP, OK),
    ],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_level_begins_at_its_limit_and_ends_a_hysteresis_before_it(excess, present, level, sign):
    name = "temperature_high" if sign > 0.0 else "temperature_low"
    item = Interlock(name, "temperature_c", sign * 900.0, sign * 910.0, 2.0)
    assert item.level(sign * (900.0 + excess), present) is level


@pytest.mark.parametrize(
    ("name", "warn", "trip"),
    [
        ("depth_high", 5.0, 5.0),
        ("depth_low", 5.0, 5.0),
        ("depth_high", 6.0, 5.0),
        ("depth_low", 4.0, 5.0),
        ("depth_high", 3.0, float("nan")),
    ],
)
def test_a_warning_comes_before_its_trip(name, warn, trip):
    changes = {f"interlocks.{name}.warn": warn, f"interlocks.{name}.trip": trip}
    with pytest.raises(InputError, match=f"interlocks.{name}[. ]"):
        validate(SupervisorParameters, changes)


def test_every_parameter_of_an_interlock_reaches_it():
    values = defaults(SupervisorParameters)
    for item in interlocks_from(values):
        limits = [
            values[f"interlocks.{item.name}.{key}"] for key in ("warn", "trip", "hysteresis")
        ]
        assert [item.warn, item.trip, item.hysteresis] == limits
    assert {item.name: item.quantity for item in interlocks_from(values)} == {
        name: case[0] for name, case in CASES.items()
    }


@pytest.mark.requirement("S26")
@pytest.mark.parametrize("name", CASES)
def test_each_interlock_warns_and_trips_after_three_values_and_it_is_told_with_the_value(
    monitor, name
):
    quantity, warning, trip, _ = CASES[name]
    for value, level in ((warning, WARN), (trip, TRIP)):
        for count in range(1, 4):
            monitor.watch({quantity: value})
            assert (monitor.active.get(name) is level) == (count == 3)
        event = last_told(monitor)
        assert event.fact == Fact.of(
            Code.INTERLOCK, interlock=name, level=level, quantity=quantity, value=value
        )
        assert event.level is (Level.WARN if level is WARN else Level.ERROR)
    assert monitor.tripped == (name,)


@pytest.mark.requirement("S2")
@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("held", ["depth", "torque", "thermocouple"])
def test_a_trip_is_not_cleared_by_values_of_a_sensor_that_is_held(monitor, name, held):
    quantity, _, trip, sensor = CASES[name]
    good = {"temperature_c": 850.0, "depth_mm": 2.66, "torque_nm": 1050.0}.get(quantity, 0.0)
    for _ in range(3):
        monitor.watch({quantity: trip})
    for _ in range(10):
        monitor.watch({quantity: good}, (held,))
    assert bool(monitor.tripped) == (sensor == held)
    for count in range(1, 4):
        monitor.watch({quantity: good})
        assert bool(monitor.tripped) == (sensor == held and count < 3)


@pytest.mark.requirement("S26")
def test_a_warning_is_gone_with_the_first_value_without_it(monitor):
    for _ in range(3):
        monitor.watch({"temperature_c": 905.0})
    monitor.watch({"temperature_c": 890.0})
    assert monitor.active == {}
    event = last_told(monitor)
    assert (event.level, event.fact.data["level"], event.fact.data["value"]) == (
        Level.INFO,
        OK,
        890.0,
    )


@pytest.mark.requirement("S26")
def test_a_trip_may_become_a_warning(monitor):
    for value in (911.0, 911.0, 911.0, 905.0, 905.0):
        monitor.watch({"temperature_c": value})
    assert monitor.active == {"temperature_high": TRIP}
    monitor.watch({"temperature_c": 905.0})
    assert monitor.active == {"temperature_high": WARN}


def test_simultaneous_causes_are_logged_together(monitor):
    for _ in range(3):
        monitor.watch({"temperature_c": 930.0, "depth_mm": 3.8, "torque_nm": NAN})
    assert monitor.tripped == ("temperature_high", "depth_high")
    why = monitor.why_stop()
    assert why.code is Code.CAUSE_PRESENT
    assert [(cause.data["interlock"], cause.data["value"]) for cause in why.data["causes"]] == [
        ("temperature_high", 930.0),
        ("depth_high", 3.8),
    ]


def judged(monitor, count=1, acting=None, **samples):
    """Some ticks in a row; the last."""
    for _ in range(count):
        monitor.stamp_ns = getattr(monitor, "stamp_ns", 10**12) + 10**8
        tick = Tick(monitor.stamp_ns, 0.0, 0.08, None, samples=dict(samples))
        monitor.machine.advance(monitor.stamp_ns)
        tick = monitor.judge(tick, acting)
    return tick


GOOD = {"depth": 2.66, "torque": 1050.0, "thermocouple": 850.0}


@pytest.mark.requirement("S3")
@pytest.mark.parametrize(
    ("samples", "acting", "tripped"),
    [
        (GOOD, Command(80.0, 410.0), ()),
        (GOOD, Command(98.0, 410.0), ("force_high",)),
        (GOOD | {"torque": 1500.0}, Command(80.0, 430.0), ("power_high",)),
        (GOOD | {"torque": 1500.0}, None, ()),
        (GOOD | {"torque": 1650.0}, Command(80.0, 310.0), ("torque_high", "torque_model_high")),
        (GOOD | {"depth": 3.8}, Command(80.0, 410.0), ("depth_high",)),
        (GOOD | {"thermocouple": 780.0}, Command(80.0, 410.0), ("temperature_low",)),
    ],
)
def test_measurements_of_a_tick_and_what_acts_are_held_against_the_interlocks(
    monitor, samples, acting, tripped
):
    assert judged(monitor, 3, acting, **samples).judged
    assert monitor.tripped == tripped
    assert (monitor.machine.mode is Mode.SAFE_STOP) == bool(tripped)
    if tripped:
        assert monitor.machine.cause is Cause.INTERLOCK_TRIP
        assert monitor.machine.reason == Reason(ReasonCode.INTERLOCKS, interlocks=monitor.tripped)


@pytest.mark.requirement("S2")
def test_a_sensor_that_becomes_invalid_and_valid_again_is_told_once_each(monitor):
    judged(monitor, 3, **GOOD)
    good = {"depth": 2.66, "torque": 1050.0}
    assert judged(monitor, **good).dropouts == ("thermocouple",), "it may come in the next tick"
    assert judged(monitor, **good).dropouts == ()
    assert monitor.invalid_sensors == ()
    judged(monitor, 4, **good)
    assert monitor.invalid_sensors == ("thermocouple",) and monitor.blind_since_ns is not None
    judged(monitor, 4, **GOOD)
    assert (monitor.invalid_sensors, monitor.blind_since_ns) == ((), None)
    logged = [
        (event.level, event.fact) for event in monitor.machine.events if event.who == "sensors"
    ]
    assert logged == [
        (Level.WARN, Fact.of(Code.SENSOR_INVALID, sensor="thermocouple", flaw="missing")),
        (Level.INFO, Fact.of(Code.SENSOR_VALID, sensor="thermocouple")),
    ]


@pytest.mark.requirement("S15")
def test_sensor_judgement_restarts_when_time_goes_back(monitor):
    judged(monitor, 10, **GOOD)
    monitor.forget_time()
    monitor.stamp_ns = 10**9
    judged(monitor, **(GOOD | {"depth": 1.0}))
    assert monitor.invalid_sensors == ()
    assert not any(monitor.sensor_flaws.values())


# ---------------------------------------------------------------- what acts


@pytest.mark.parametrize(
    ("age_ns", "is_feedback"), [(0, True), (300_000_000, True), (300_000_001, False), (-1, False)]
)
def test_recent_feedback_acts_else_the_command(age_ns, is_feedback):
    in_force, stamp_ns = CommandInForce(), 10**12
    tick = Tick(stamp_ns, 0.0, 0.08, None)
    assert in_force.acting(tick, 0.3) is None
    in_force.on_sent(Command(80.0, 410.0))
    assert in_force.acting(tick, 0.3) == Command(80.0, 410.0)
    in_force.on_drives(stamp_ns - age_ns, Command(82.0, 412.0))
    assert in_force.acting(tick, 0.3) == (
        Command(82.0, 412.0) if is_feedback else Command(80.0, 410.0)
    )
    tick = tick._replace(drives=Command(83.0, 413.0))
    assert in_force.acting(tick, 0.3) == Command(83.0, 413.0)
