"""Sensor validity: what is believed, for how long, and why not."""

import math
import random
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_control.common_parameters import ControllerParameters
from fsw_control.contract import Command, Measurement
from fsw_control.parameters import defaults, validate
from fsw_control.schema.errors import InputError
from fsw_control.sensors import OPTIONAL, REQUIRED, SENSORS
from fsw_control.validity import (
    Flaw,
    Frozen,
    SensorGuard,
    SensorLimits,
    SensorValidity,
    sensor_limits,
)

LIMITS = SensorLimits(0.0, 6.0, max_rate=10.0, hold_s=0.3, frozen_samples=10, confirm_samples=3)


def feed(sensor, values, start=0):
    return [sensor.update((start + k) * 0.1, value) for k, value in enumerate(values)]


def test_good_samples_pass_unchanged():
    readings = feed(SensorValidity(LIMITS), [2.66, 2.661, 2.659])
    assert [reading.value for reading in readings] == [2.66, 2.661, 2.659]
    assert all(reading.valid and not reading.reason for reading in readings)


@pytest.mark.requirement("S8")
@pytest.mark.parametrize(
    ("bad", "said"),
    [(None, "missing"), (math.nan, "not finite"), (math.inf, "not finite"), (7.0, "out of range")],
)
def test_bad_samples_are_bridged_then_invalid_with_the_reason(bad, said):
    sensor = SensorValidity(LIMITS)
    feed(sensor, [2.66])
    readings = feed(sensor, [bad] * 5, start=1)
    assert [reading.valid for reading in readings] == [True, True, True, False, False]
    assert [reading.value for reading in readings[:3]] == [2.66] * 3
    assert math.isnan(readings[4].value)
    assert (readings[0].reason, readings[0].held) == (said, True)
    assert readings[4].reason == said


def test_never_good_is_invalid_at_once():
    assert not SensorValidity(LIMITS).update(0.0, math.nan).valid


def test_spike_is_bridged():
    readings = feed(SensorValidity(LIMITS), [2.66, 2.66, 5.0, 2.67])
    assert [reading.value for reading in readings] == [2.66, 2.66, 2.66, 2.67]
    assert (readings[2].reason, readings[2].held) == ("too fast", True)


def test_a_step_that_stays_is_believed_after_three_samples():
    readings = feed(SensorValidity(LIMITS), [1.0, 1.0, 5.5, 5.5, 5.5, 5.5])
    assert [reading.value for reading in readings] == [1.0, 1.0, 1.0, 1.0, 5.5, 5.5]


JUMP = replace(LIMITS, max_jump=0.5)


@pytest.mark.requirement("S35")
@pytest.mark.parametrize("shown", [0.66, 4.66, 3.2])
def test_a_jump_stays_invalid_however_long_it_lasts(shown):
    sensor = SensorValidity(JUMP)
    readings = feed(sensor, [2.66] * 5 + [shown] * 3000)
    assert [reading.value for reading in readings[5:7]] == [2.66] * 2, "a spike is bridged"
    assert not any(reading.valid for reading in readings[7:])
    assert {reading.reason for reading in readings[7:]} == {Flaw.JUMPED}
    assert sensor.jumped


@pytest.mark.requirement("S35")
@pytest.mark.parametrize("step", [0.67, 0.55])
def test_a_jump_that_is_spread_over_some_samples_is_one(step):
    readings = feed(
        SensorValidity(JUMP), [2.66] * 5 + [2.66 - step, 2.66 - 2 * step] + [2.66 - 3 * step] * 20
    )
    assert not any(reading.valid and not reading.held for reading in readings[5:])
    assert readings[-1].reason == Flaw.JUMPED


def test_a_jump_that_no_limit_forbids_is_believed():
    readings = feed(SensorValidity(JUMP), [2.66] * 5 + [2.76] * 5)
    assert all(reading.valid and not reading.held for reading in readings)


@pytest.mark.requirement("S35")
@pytest.mark.parametrize("between", [[], [None] * 600, [math.nan] * 600, [7.0] * 600])
def test_a_sensor_that_has_jumped_is_believed_where_it_was_before_or_once_readmitted(between):
    sensor = SensorValidity(JUMP)
    feed(sensor, [2.66] * 5 + [4.66] * 5 + between)
    back = len(between) + 10
    readings = feed(sensor, [4.0] * 5, back)
    assert not any(reading.valid for reading in readings)
    assert sensor.readmit()
    assert feed(sensor, [4.0], back + 5)[0].valid and not sensor.jumped

    sensor = SensorValidity(JUMP)
    feed(sensor, [2.66] * 5 + [4.66] * 5 + between)
    assert [reading.valid for reading in feed(sensor, [2.8] * 4, back)] == [
        False,
        False,
        True,
        True,
    ]
    assert not sensor.jumped


@pytest.mark.requirement("S35")
@pytest.mark.parametrize("last", [None, math.nan, 9.0, 4.0])
def test_a_sensor_that_is_not_steady_is_not_readmitted(last):
    sensor = SensorValidity(JUMP)
    feed(sensor, [2.66] * 5 + [4.66] * 5 + [1.0, last])
    assert not sensor.readmit()
    assert sensor.jumped


def test_a_sensor_that_has_not_jumped_is_not_readmitted():
    sensor = SensorValidity(JUMP)
    feed(sensor, [2.66] * 5 + [None] * 10)
    assert not sensor.readmit()


def test_a_longer_loss_explains_a_greater_change():
    for lost, valid in ((9, False), (19, True)):
        sensor = SensorValidity(JUMP)
        readings = feed(sensor, [2.66] * 5 + [None] * lost + [3.6] * 3)
        assert readings[-1].valid == valid


@pytest.mark.requirement("S15", "S35")
def test_a_jump_outlasts_a_clock_that_goes_back():
    guard = SensorGuard(dict.fromkeys(SENSORS, JUMP))
    for k in range(10):
        guard.measure(
            1000.0 + 0.1 * k, dict.fromkeys(SENSORS, 2.66) | {"depth": 2.66 if k < 5 else 0.66}
        )
    guard.forget_time()
    for k in range(10):
        measurement = guard.measure(0.1 * k, dict.fromkeys(SENSORS, 2.0) | {"depth": 0.66})
    assert guard.jumped == {"depth": 2.66}
    assert measurement.invalid_sensors() == ("depth",)
    assert guard.readmit() == {"depth": 0.66}
    assert guard.jumped == {}
    assert guard.readmit() == {}


def test_after_a_failure_three_good_samples_are_needed():
    sensor = SensorValidity(LIMITS)
    feed(sensor, [2.66] + [None] * 10)
    readings = feed(sensor, [2.7] * 4, start=11)
    assert [reading.valid for reading in readings] == [False, False, True, True]
    assert readings[0].reason == "recovering"


def noisy(count, quantum, seed=3, noise=0.002):
    generator = random.Random(seed)
    return [round((2.66 + generator.gauss(0.0, noise)) / quantum) * quantum for _ in range(count)]


@pytest.mark.requirement("S8")
@pytest.mark.parametrize(("quantum", "latest"), [(1e-9, 10), (1e-3, 25), (2e-3, 40), (5e-3, 90)])
def test_freeze_of_a_noisy_sensor_is_found(quantum, latest):
    values = noisy(200, quantum)
    readings = feed(SensorValidity(LIMITS), values + [values[-1]] * 100)
    assert all(reading.valid for reading in readings[:200])
    first_bad = next(k for k, reading in enumerate(readings) if not reading.valid) - 200
    assert first_bad <= latest
    assert readings[-1].reason == "frozen"


@pytest.mark.parametrize("quantum", [1e-3, 2e-3, 5e-3])
def test_quantised_noise_is_no_freeze_in_an_hour(quantum):
    frozen = Frozen()
    assert not any(frozen.update(value, 10) for value in noisy(36_000, quantum))


def drifting(quantum, noise, seed):
    """An hour of a temperature that wanders slowly by 2 degC through steps of the resolution."""
    generator = random.Random(seed)
    true_c = (816.4 + 2.0 * math.sin(k / 400.0) for k in range(36_000))
    return [round((one + generator.gauss(0.0, noise)) / quantum) * quantum for one in true_c]


@pytest.mark.parametrize("quantum", [0.3, 1.0])
@pytest.mark.parametrize("seed", range(3))
def test_steps_coarser_than_the_noise_are_no_freeze(quantum, seed):
    """What is learnt at the edge of a step does not hold in its middle."""
    frozen = Frozen()
    assert not any(frozen.update(value, 10, 0.1) for value in drifting(quantum, 0.1, seed))


@pytest.mark.requirement("S8")
@pytest.mark.parametrize(("quantum", "latest"), [(0.01, 10), (0.1, 25), (0.2, 60), (0.3, 140)])
def test_freeze_in_steps_is_found_where_noise_would_show(quantum, latest):
    frozen, values = Frozen(), drifting(quantum, 0.1, 5)[:2000]
    assert not any(frozen.update(value, 10, 0.1) for value in values)
    assert [frozen.update(values[-1], 10, 0.1) for _ in range(400)].index(True) < latest


@pytest.mark.requirement("S8")
@pytest.mark.parametrize(("quantum", "latest"), [(0.5, 40), (1.0, 100)])
def test_freeze_is_found_where_noise_is_larger_than_expected(quantum, latest):
    for seed in range(6):
        frozen, values = Frozen(), drifting(quantum, 0.4, seed)[: 1500 + 137 * seed]
        assert not any(frozen.update(value, 10, 0.1) for value in values)
        assert [frozen.update(values[-1], 10, 0.1) for _ in range(latest)][-1]


def test_still_or_smooth_signals_without_noise_are_no_freeze():
    frozen = Frozen()
    still = [2.66] * 500
    smooth = [round(2.66 + 0.2 * (1.0 - math.exp(-k / 100.0)), 3) for k in range(3000)]
    assert not any(frozen.update(value, 10) for value in still + smooth + still)


@given(
    quantum=st.sampled_from([1e-12, 1e-9, 1e-6, 1e-5, 1e-4]),
    moves=st.lists(st.tuples(st.integers(-1, 1), st.integers(1, 60)), min_size=1, max_size=40),
    start=st.floats(0.5, 5.5),
)
def test_dither_far_below_the_expected_noise_is_no_freeze(quantum, moves, start):
    """A simulation without noise toggles by rounding or one step of its resolution, and then stands still."""
    frozen, value = Frozen(), start
    dither = [start + quantum * (k % 2) for k in range(40)]
    assert not any(frozen.update(one, 10, 0.002) for one in dither)
    for direction, count in moves:
        value += direction * quantum
        assert not any(frozen.update(value, 10, 0.002) for _ in range(count))


def test_a_tenth_of_the_expected_noise_is_not_judged_and_half_of_it_is():
    for noise, found in ((0.0002, False), (0.001, True)):
        values = noisy(200, 1e-9, noise=noise)
        frozen = Frozen()
        assert (
            any(frozen.update(value, 10, 0.002) for value in values + [values[-1]] * 100) == found
        )


def test_zero_switches_the_frozen_test_off():
    frozen = Frozen()
    values = noisy(200, 1e-9)
    assert not any(frozen.update(value, 0) for value in values + [values[-1]] * 1000)


def test_a_frozen_sensor_recovers():
    sensor = SensorValidity(LIMITS)
    values = noisy(200, 1e-9)
    feed(sensor, values + [values[-1]] * 30)
    readings = feed(sensor, noisy(5, 1e-9, seed=4), start=230)
    assert readings[-1].valid and not readings[0].valid


@pytest.mark.requirement("S8")
@given(
    st.lists(
        st.one_of(st.none(), st.floats(), st.floats(-1.0, 7.0)),
        max_size=60,
    )
)
def test_a_valid_reading_is_always_finite_and_in_range(values):
    for reading in feed(SensorValidity(LIMITS), values):
        assert reading.valid == (not math.isnan(reading.value))
        if reading.valid:
            assert LIMITS.minimum <= reading.value <= LIMITS.maximum
        else:
            assert reading.reason


@given(st.lists(st.floats(2.6, 2.7), min_size=1, max_size=60))
def test_slow_signals_in_range_pass_or_are_frozen(values):
    for value, reading in zip(values, feed(SensorValidity(LIMITS), values), strict=True):
        assert reading.reason == "frozen" or (reading.valid and reading.value == value)


def test_a_held_value_is_marked_in_the_measurement():
    guard = SensorGuard()
    good = {"depth": 2.66, "torque": 1030.0, "thermocouple": 816.4}
    assert guard.measure(0.1, good).held == ()
    spike = guard.measure(0.2, good | {"depth": 5.5})
    assert spike.held == ("depth",) and spike.depth_valid and spike.depth_mm == 2.66
    missing = [
        guard.measure(0.1 * k, {"torque": 1030.0, "thermocouple": math.nan}) for k in range(3, 7)
    ]
    assert [measurement.held for measurement in missing] == [("depth", "thermocouple")] * 2 + [
        ("thermocouple",),
        (),
    ]
    assert missing[-1].invalid_sensors() == ("depth", "thermocouple")


def test_the_drives_feedback_is_part_of_the_measurement():
    guard = SensorGuard()
    with_drives = guard.measure(0.1, {}, Command(81.5, 402.0))
    assert (with_drives.force_kn, with_drives.speed_rpm) == (81.5, 402.0)
    assert math.isnan(guard.measure(0.2, {}).force_kn)


def test_limits_that_make_no_sense_are_refused():
    with pytest.raises(InputError, match=r"validity\.torque minimum 3000\.0 "):
        validate(ControllerParameters, {"validity.torque.minimum": 3000.0})


def test_guard_gives_a_measurement_and_the_reasons():
    guard = SensorGuard()
    good = {"depth": 2.66, "torque": 1052.0, "thermocouple": 850.0}
    assert guard.measure(0.0, good).invalid_sensors() == ()
    for k in range(1, 6):
        measurement = guard.measure(k * 0.1, {"depth": 2.66, "torque": math.nan})
    assert measurement.invalid_sensors() == ("torque", "thermocouple")
    flaws = {name: flaw for name, flaw in guard.reasons.items() if flaw}
    assert flaws == {"torque": "not finite", "thermocouple": "missing"}
    guard.reset()
    assert guard.measure(0.0, good).invalid_sensors() == ()


def test_guard_takes_new_limits_without_forgetting():
    guard = SensorGuard()
    good = {"depth": 2.66, "torque": 1052.0, "thermocouple": 850.0}
    guard.measure(0.0, good)
    guard.configure({name: SensorLimits(0.0, 1.0, 1.0, 0.2, 10, 3) for name in SENSORS})
    assert guard.measure(0.1, good).depth_mm == 2.66
    assert guard.reasons["depth"] == "out of range" and "depth" in guard.held


def test_rounding_is_no_noise_that_could_freeze():
    sensor = SensorValidity(sensor_limits()["torque"])
    readings = [
        sensor.update(0.1 * k, 1052.86 * (1.0 + 2e-16 * (-1) ** k if k < 40 else 1.0))
        for k in range(200)
    ]
    assert all(reading.valid and not reading.held for reading in readings)


@pytest.mark.parametrize(
    ("value", "valid"), [(0.0, True), (6.0, True), (-1e-9, False), (6.0 + 1e-9, False)]
)
def test_the_ends_of_the_range_belong_to_it(value, valid):
    assert SensorValidity(LIMITS).update(0.0, value).valid == valid


@pytest.mark.parametrize("start", [0, 1000])
def test_jumps_that_do_not_agree_with_each_other_are_never_believed(start):
    sensor = SensorValidity(replace(LIMITS, max_rate=1.0))
    feed(sensor, [1.0, 1.0], start)
    readings = feed(sensor, [5.5, 3.4] * 10, start + 2)
    assert [reading.valid for reading in readings] == [True] * 3 + [False] * 17


def test_a_jump_begins_to_be_counted_anew_after_good_samples():
    readings = feed(SensorValidity(LIMITS), [1.0, 5.5, 5.5, 1.0, 5.5, 5.5, 5.5])
    assert [reading.value for reading in readings] == [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 5.5]


@pytest.mark.parametrize("between", [1.0, None, math.nan, 7.0])
def test_samples_agree_only_in_a_row(between):
    """A spike, a sample that is good or none, and the same spike.

    It is as if the first had not been.
    """
    sensor = SensorValidity(replace(LIMITS, max_rate=2.0, hold_s=10.0))
    readings = feed(sensor, [1.0, 5.0, 5.0, between, 5.0, 5.0, 5.0])
    assert [reading.value for reading in readings] == [1.0] * 6 + [5.0]


def test_limits_and_measurement_have_every_value_at_its_place():
    values = defaults(ControllerParameters)
    changed = values | {
        "validity.hold": 0.7,
        "validity.frozen_samples": 33,
        "validity.confirm_samples": 4,
    }
    for number, sensor in enumerate(SENSORS):
        ends = {"minimum": -1.0 - number, "maximum": 1.0 + number, "max_rate": 2.0 + number}
        ends |= {"max_jump": 3.0 + number, "noise": 4.0 + number}
        changed |= {f"validity.{sensor}.{name}": value for name, value in ends.items()}
    limits = sensor_limits(changed)
    assert limits == {
        s: SensorLimits(-1.0 - n, 1.0 + n, 2.0 + n, 0.7, 33, 4, 3.0 + n, 4.0 + n)
        for n, s in enumerate(SENSORS)
    }
    guard = SensorGuard(limits)
    assert guard.reasons == dict.fromkeys(SENSORS, "")
    samples = dict(zip(REQUIRED, (0.9, 1.9, 2.9), strict=True))
    unknown = dict.fromkeys(OPTIONAL, math.nan)
    expected = Measurement(5.0, 0.9, 1.9, 2.9, True, True, True, (), 80.0, 400.0, unknown)
    assert guard.measure(5.0, samples, Command(80.0, 400.0)) == expected
    guard.configure({name: SensorLimits(-9.0, -8.0, 1.0, 0.2, 10, 3) for name in SENSORS})
    guard.reset()
    assert guard.measure(5.1, samples).invalid_sensors() == REQUIRED


@pytest.mark.parametrize(
    ("learnt", "samples", "runs"),
    [(200, 10, 9), (200, 2, 6), (31, 2, 10), (21, 2, 12), (20, 2, None), (200, 0, None)],
)
def test_how_many_equal_samples_are_a_freeze(learnt, samples, runs):
    """As many as chance has once in 1e9, from the share of equal neighbours that so few samples allow; and samples."""
    frozen = Frozen()
    values = [2.66 + 0.001 * (k % 2) for k in range(learnt)]
    assert not any(frozen.update(value, samples) for value in values)
    found = [frozen.update(values[-1], samples) for _ in range(40)]
    assert found.index(True) + 1 == runs if runs else not any(found)


def test_a_signal_that_seldom_turns_is_smooth():
    frozen = Frozen()
    values = [0.1 * (k % 10) + 0.001 * k for k in range(1000)]
    assert not any(frozen.update(value, 2) for value in values + [values[-1]] * 100)


def test_a_freeze_does_not_teach_that_standing_still_is_normal():
    frozen = Frozen()
    values = noisy(200, 1e-9)
    assert not any(frozen.update(value, 10) for value in values)
    for again in (values[-1], 2.0):
        assert [frozen.update(again, 10) for _ in range(100)].index(True) < 12
        assert not any(frozen.update(value, 10) for value in noisy(3, 1e-9))
