"""The emulator as a whole: order of a tick, determinism, mismatch, end of the process, reset."""

import random
from itertools import pairwise
from math import exp, isfinite, nan, pi

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from fsw_control import Command
from fsw_control.schema.models import InputError
from fsw_control.sensors import REQUIRED
from fsw_control.weld import TICK_NS
from fsw_model import ProcessModel
from fsw_plant import FIRST_TICK, BeyondDrivesError, PlantConfig, PlantEmulator, PlantSchedule
from fsw_plant.event_schema import disturbance, fault


def plant_of(**values):
    return PlantEmulator(PlantConfig.from_values(values))


def run(plant, commands):
    """Readings of as many ticks as there are commands (None: none comes)."""
    readings = []
    for command in commands:
        readings.append(plant.measure())
        if command is not None:
            assert plant.apply(command) == ""
        plant.step()
    return readings


def values_of(readings):
    return [[s.value for name in REQUIRED for s in r.samples[name]] for r in readings]


def test_first_tick_shows_the_equilibrium():
    plant = plant_of(noise=False)
    reading = plant.measure()
    assert (reading.tick, reading.stamp_ns) == (FIRST_TICK, TICK_NS)
    assert reading.samples["depth"][0].value == pytest.approx(2.66)
    assert reading.samples["torque"][0].value == pytest.approx(1052.86, abs=5e-3)
    assert reading.samples["thermocouple"][0].value == 816.4
    assert plant.applied.force_kn == 78.4


def test_a_torque_that_is_added_heats_as_much_as_the_motor_shows():
    plant = plant_of(noise=False)
    plant.begin(disturbance("torque", "step", 25.0))
    for _ in range(60):  # the motor settles
        plant.measure()
        plant.apply(plant.applied)
        plant.step()
    memory = plant.core.memory  # the row before the oldest is the newest
    constant, rising, _, fading = memory.power[(memory.oldest - 1) % plant.core.model.delay_steps]
    lag = plant.config.model.motor_lag_s / 0.1
    sent_kw = constant + rising / 2.0 + fading * lag * (1.0 - exp(-1.0 / lag))
    shown_kw = plant.truth().process_power_kw - plant.config.model.operating_power_kw
    assert shown_kw > 0.9 and sent_kw == pytest.approx(shown_kw, abs=0.01)


def test_measurement_shows_the_state_before_the_command_of_its_tick():
    plant = plant_of(noise=False)
    start = plant.applied
    first = plant.measure()
    plant.apply(Command(start.force_kn + 1.0, start.speed_rpm))
    assert plant.measure() is first  # asked again at the same tick: the same, and no new noise
    assert plant.truth().force_kn == start.force_kn
    plant.step()
    assert plant.truth().force_kn == pytest.approx(start.force_kn + 1.0 - exp(-5.0))
    assert plant.truth().process_torque_nm == pytest.approx(1021.53 + 12.84, abs=0.2)
    assert (
        plant.measure().samples["torque"][0].value > first.samples["torque"][0].value + 3.0
    )  # the motor's lag is 0.27 s


def test_trajectory_without_lag_is_that_of_the_model():
    plant = plant_of(noise=False, actuators={"lag_s": 0.0})
    start = plant.applied
    generator = random.Random(4)
    force, speed, commands = start.force_kn, start.speed_rpm, []
    for _ in range(400):
        force = min(max(force + generator.uniform(-1, 1), 60.0), 95.0)
        speed = min(max(speed + generator.uniform(-3, 3), 300.0), 500.0)
        commands.append(Command(force, speed))
    readings = run(plant, commands)
    exact = ProcessModel().simulate(
        [c.force_kn for c in commands], [c.speed_rpm for c in commands]
    )
    for k, reading in enumerate(readings):
        assert reading.samples["depth"][0].value == pytest.approx(exact["depth_mm"][k], rel=1e-12)
        assert reading.samples["thermocouple"][0].value == pytest.approx(
            exact["temperature_c"][k], rel=1e-12
        )
        turn = (
            0.0
            if k == 0
            else commands[k - 1].speed_rpm
            - (commands[k - 2].speed_rpm if k > 1 else start.speed_rpm)
        )
        inertia = 2.0 * turn * pi / 30.0 / 0.1
        assert reading.samples["torque"][0].value == pytest.approx(
            exact["motor_torque_nm"][k] + inertia, rel=1e-12
        )


def test_inertia_spike_is_in_the_sensor_and_not_in_the_truth_or_the_process():
    plant, still = (
        plant_of(noise=False),
        plant_of(noise=False, factors={"spindle_inertia_kgm2": 0.1}),
    )
    start = plant.applied
    faster = Command(start.force_kn, start.speed_rpm + 3.0)
    shown = run(plant, [faster] * 5)
    shown_still = run(still, [faster] * 5)
    assert shown[1].samples["torque"][0].value - shown_still[1].samples["torque"][
        0
    ].value == pytest.approx(1.8 * pi, rel=0.01)
    assert shown[4].samples["torque"][0].value == pytest.approx(
        shown_still[4].samples["torque"][0].value, abs=1e-3
    )
    assert plant.truth().motor_torque_nm == still.truth().motor_torque_nm
    assert plant.truth().temperature_c == still.truth().temperature_c


def test_same_seed_same_run_and_other_seed_other_noise():
    hold = [PlantEmulator().applied] * 1500  # longer than a block of random numbers
    first, same, other = (values_of(run(plant_of(seed=seed), hold)) for seed in (7, 7, 8))
    assert first == same
    assert all(a != b for a, b in zip(first, other, strict=True))


def test_noise_has_the_size_of_the_settings():
    readings = values_of(run(PlantEmulator(), [PlantEmulator().applied] * 4000))
    for column, size in zip(zip(*readings, strict=True), (0.002, 2.0, 0.1), strict=True):
        mean = sum(column) / len(column)
        deviation = (sum((v - mean) ** 2 for v in column) / len(column)) ** 0.5
        assert deviation == pytest.approx(size, rel=0.05)


@pytest.mark.parametrize("kind", ["freeze", "dropout", "nan", "delay", "duplicate", "bias"])
def test_noise_does_not_depend_on_faults(kind):
    plain, faulty = PlantEmulator(), PlantEmulator()
    hold = [plain.applied] * 10
    assert values_of(run(plain, hold)) == values_of(run(faulty, hold))
    faulty.begin(fault("depth", kind, 0.3, duration_s=2.0))
    assert values_of(run(plain, hold * 2)) != values_of(run(faulty, hold * 2))
    assert values_of(run(plain, hold)) == values_of(run(faulty, hold))


SLOW = {"temperature_lag_s": 2.0}


def temperatures(readings):
    return [r.samples["thermocouple"][0].value for r in readings]


def test_slow_probe_starts_at_rest_and_lags_the_truth():
    plant, quick = (plant_of(noise=False, sensors=sensors) for sensors in (SLOW, {}))
    hold = [plant.applied] * 10
    assert temperatures(run(plant, hold)) == pytest.approx(
        temperatures(run(quick, hold)), abs=1e-6
    )
    start_c = quick.truth().temperature_c
    for each in (plant, quick):
        each.begin(disturbance("temperature", "step", 10.0))
    shown = temperatures(run(plant, hold * 5))
    assert temperatures(run(quick, hold * 5))[0] == pytest.approx(start_c + 10.0, abs=1e-6)
    expected = [start_c + 10.0 * (1.0 - exp(-0.1 * tick / 2.0)) for tick in range(50)]
    assert shown == pytest.approx(expected, abs=1e-4)
    assert plant.truth() == quick.truth()


def test_slow_probe_feels_a_disturbance_until_the_next_tick():
    """One that is cleared after it was measured acts on the step that begins there."""
    plant = plant_of(noise=False, sensors=SLOW)
    start_c = plant.truth().temperature_c
    plant.begin(disturbance("temperature", "step", 10.0))
    plant.measure()
    plant.begin(disturbance("temperature", "none", 0.0))
    plant.step()
    assert temperatures(run(plant, [plant.applied])) == [
        pytest.approx(start_c + 10.0 * (1.0 - exp(-0.05)), abs=1e-4)
    ]


@pytest.mark.parametrize("kind", ["nan", "freeze", "dropout"])
def test_slow_probe_continues_during_a_fault(kind):
    plant, faulty = (plant_of(sensors=SLOW) for _ in range(2))
    harder = [Command(plant.applied.force_kn, plant.applied.speed_rpm + 20.0)] * 60
    faulty.begin(fault("thermocouple", kind, duration_s=3.0))
    run(plant, harder), run(faulty, harder)
    assert temperatures(run(plant, harder)) == temperatures(run(faulty, harder))


def test_slow_probe_is_at_rest_after_a_reset_and_where_it_was_after_a_change():
    plant = plant_of(noise=False)
    hotter = [Command(plant.applied.force_kn, plant.applied.speed_rpm + 40.0)] * 100
    last = temperatures(run(plant, hotter))[-1]
    plant.reconfigure(PlantConfig.from_values({"noise": False, "sensors.temperature_lag_s": 30.0}))
    shown = temperatures(run(plant, hotter[:3]))
    assert last + 0.05 < shown[-1] < last + 0.25 < plant.truth().temperature_c
    plant.reset()
    assert temperatures(run(plant, [plant.applied] * 5)) == pytest.approx([816.4] * 5, abs=1e-6)


def test_quantisation():
    plant = plant_of(
        sensors={
            "depth_resolution_mm": 0.01,
            "temperature_noise_c": 0.0,
            "temperature_resolution_c": 0.5,
        }
    )
    for depth, _, temperature in values_of(run(plant, [plant.applied] * 20)):
        assert depth * 100 == pytest.approx(round(depth * 100), abs=1e-9)
        assert temperature == 816.5


def test_output_disturbance_is_seen_but_not_felt():
    plain, disturbed = plant_of(noise=False), plant_of(noise=False)
    disturbed.begin(disturbance("depth", "step", 0.1))
    disturbed.begin(disturbance("temperature", "step", -5.0))
    hold = [plain.applied] * 100
    for a, b in zip(values_of(run(plain, hold)), values_of(run(disturbed, hold)), strict=True):
        assert b == pytest.approx([a[0] + 0.1, a[1], a[2] - 5.0], rel=1e-12)
    truth = disturbed.truth()
    assert truth.depth_mm == pytest.approx(plain.truth().depth_mm + 0.1)
    assert (truth.depth_disturbance_mm, truth.temperature_disturbance_c) == (0.1, -5.0)


def test_random_disturbance_acts_beside_another_one_and_follows_the_seed():
    def added(seed, *shapes):
        plant = plant_of(noise=False, seed=seed)
        for shape, period_s in shapes:
            plant.begin(disturbance("temperature", shape, 5.0, period_s=period_s))
        values = []
        for _ in range(100):
            plant.measure()
            values.append(plant.truth().temperature_disturbance_c)
            plant.step()
        plant.begin(disturbance("temperature", "none", 0.0))
        assert not plant.disturbances
        return np.array(values)

    background, step = ("random", 2.0), ("step", 0.0)
    alone = added(1, background)
    assert np.ptp(alone) > 1.0 and (alone != added(2, background)).any()
    assert added(1, background, step) == pytest.approx(alone + 5.0)


def test_a_channel_and_a_sensor_carry_one_event_at_a_time():
    plant = plant_of(noise=False)
    for amplitude in (0.1, 0.3):
        plant.begin(disturbance("depth", "step", amplitude))
        plant.begin(fault("torque", "bias", amplitude))
    assert plant.measure().samples["depth"][0].value == pytest.approx(2.96)
    assert (list(plant.disturbances), plant.truth().active_faults) == (["depth"], ("torque:bias",))
    plant.begin(disturbance("depth", "none", 0.0))
    plant.begin(fault("torque", "none"))
    assert not plant.disturbances and not plant.faults
    plant.begin(fault("depth", "dropout", duration_s=0.1))
    plant.step()
    assert plant.measure().samples["depth"] == () and plant.truth().active_faults == (
        "depth:dropout",
    )
    plant.step()
    assert (
        plant.measure().samples["depth"][0].value == pytest.approx(2.66)
        and plant.truth().active_faults == ()
    )


def test_input_disturbance_acts_on_the_process():
    plant = plant_of(noise=False)
    plant.begin(disturbance("axial_force", "pulse", 2.0, duration_s=1.0))
    plant.begin(disturbance("spindle_speed", "step", -5.0))
    before = plant.truth()
    run(plant, [plant.applied])
    truth = plant.truth()
    assert truth.force_kn == before.force_kn + 2.0 and truth.force_disturbance_kn == 2.0
    assert truth.speed_rpm == before.speed_rpm - 5.0 and truth.speed_disturbance_rpm == -5.0
    assert truth.process_torque_nm > before.process_torque_nm + 20.0
    run(plant, [plant.applied] * 10)
    assert plant.truth().force_kn == before.force_kn and plant.truth().force_disturbance_kn == 0.0
    assert plant.truth().depth_mm != before.depth_mm


def test_torque_disturbance_acts_on_the_motor_torque_through_its_lag_and_heats():
    worn, new = plant_of(noise=False), plant_of(noise=False)
    worn.begin(disturbance("torque", "step", 20.0))
    for plant in (worn, new):
        run(plant, [plant.applied] * 5)
    assert worn.truth().process_torque_nm == pytest.approx(new.truth().process_torque_nm + 20.0)
    torque = worn.truth().motor_torque_nm - new.truth().motor_torque_nm
    assert torque == pytest.approx(20.0 * (1.0 - exp(-0.5 / 0.27)))
    for plant in (worn, new):
        run(plant, [plant.applied] * 100)
    assert worn.truth().temperature_c > new.truth().temperature_c + 1.0


def test_replacing_an_input_disturbance_leaves_no_gap():
    plant = plant_of(noise=False)
    for amplitude in (1.0, 2.0, 3.0):
        plant.measure()
        plant.begin(disturbance("axial_force", "step", amplitude))
        plant.apply(plant.applied)
        plant.step()
        assert plant.truth().force_kn == pytest.approx(78.4 + amplitude)


def test_events_act_at_their_tick():
    events = [
        {"at_s": 0.5, "disturbance": {"channel": "depth", "shape": "step", "amplitude_mm": 0.1}},
        {
            "at_s": 0.5,
            "disturbance": {"channel": "axial_force", "shape": "step", "amplitude_kn": 1.0},
        },
        {"at_s": 0.65, "fault": {"sensor": "thermocouple", "kind": "dropout", "duration_s": 0.2}},
        {"at_s": 0.2, "reference": {"depth_mm": 2.7}},
    ]
    plant = PlantEmulator(
        PlantConfig.from_values({"noise": False}), PlantSchedule.from_yaml(yaml.safe_dump(events))
    )
    readings, forces = [], []
    for _ in range(12):
        readings.append(plant.measure())
        forces.append(plant.truth().force_kn)
        plant.apply(plant.applied)
        plant.step()
    assert [r.tick for r in readings if r.samples["depth"][0].value > 2.7] == list(range(5, 13))
    assert [r.tick for r in readings if not r.samples["thermocouple"]] == [7, 8]
    assert [r.tick for r, f in zip(readings, forces, strict=True) if f > 79.0] == list(
        range(6, 13)
    )


def test_drive_feedback_includes_the_disturbance():
    plant = plant_of(noise=False, actuators={"lag_s": 0.0})
    plant.begin(disturbance("axial_force", "step", 3.0))
    plant.begin(disturbance("spindle_speed", "step", -5.0))
    start = plant.applied
    assert plant.measure().drives == start
    plant.step()
    drives = plant.measure().drives
    assert drives == Command(start.force_kn + 3.0, start.speed_rpm - 5.0)
    assert (plant.truth().force_kn, plant.truth().speed_rpm) == (drives.force_kn, drives.speed_rpm)


def test_torque_drop_with_speed_is_in_the_sensor_only():
    plant, plain = (
        plant_of(noise=False, sensors={"torque_drop_nm_per_rpm": 0.4}),
        plant_of(noise=False),
    )
    faster = Command(plant.applied.force_kn, plant.applied.speed_rpm + 30.0)
    shown, shown_plain = run(plant, [faster] * 30), run(plain, [faster] * 30)
    assert shown[0].samples["torque"][0].value == pytest.approx(
        shown_plain[0].samples["torque"][0].value, abs=1e-4
    )
    assert shown[29].samples["torque"][0].value == pytest.approx(
        shown_plain[29].samples["torque"][0].value - 12.0, abs=1e-3
    )
    assert plant.truth() == plain.truth()


def test_mismatch_changes_the_plant_and_its_equilibrium():
    plant = plant_of(
        noise=False, factors={"thermal_gain_c_per_kw": 1.2}, start={"temperature_c": 826.4}
    )
    power_kw = 43.6 + 10.0 / (18.1 * 1.2)
    assert plant.truth().process_power_kw == pytest.approx(power_kw)
    assert plant.applied.speed_rpm == pytest.approx(407.576 * power_kw / 43.6, abs=1e-3)
    run(plant, [plant.applied] * 100)
    assert plant.truth().temperature_c == pytest.approx(826.4, abs=1e-6)


def test_own_model_parameters_from_a_file(tmp_path):
    file = tmp_path / "model.yaml"
    file.write_text("copper_lag_s: 70\nsliding_friction: 4.0e-1\n")
    plant = plant_of(model_file=str(file), factors={"copper_lag_s": 2.0})
    assert plant.config.model.copper_lag_s == 140.0 and plant.config.model.sliding_friction == 0.4
    with pytest.raises(InputError, match=r"model .*none\.yaml"):
        plant_of(model_file=str(tmp_path / "none.yaml"))
    file.write_text("coper_lag_s: 70")
    with pytest.raises(InputError, match=r"coper_lag_s .*unknown key"):
        plant_of(model_file=str(file))


def test_settings_change_while_running():
    plant = plant_of(noise=False)
    run(plant, [plant.applied] * 40)
    slow = {
        "noise": False,
        "limits": {"force_rate_kn_per_s": 1.0},
        "factors": {"dead_time_s": 3.0 / 2.8},
    }
    plant.reconfigure(PlantConfig.from_values(slow))
    run(plant, [Command(80.0, plant.applied.speed_rpm)] * 10)
    assert plant.truth().force_kn == pytest.approx(79.4, abs=2e-3)
    plant.reconfigure(PlantConfig.from_values({"factors": {"dead_time_s": 2.0 / 2.8}}))
    assert all(
        isfinite(v) for row in values_of(run(plant, [Command(80.0, 410.0)] * 40)) for v in row
    )


def test_process_that_leaves_the_copper_stops_and_is_still_measured():
    config = {
        "noise": False,
        "watchdog": {"timeout_s": 60.0},
        "start": {"depth_mm": 1.0, "temperature_c": 816.4},
    }
    plant = plant_of(
        **config,
        limits={"force_min_kn": 10.0, "force_rate_kn_per_s": 1000.0, "speed_max_rpm": 2000.0},
    )
    low = Command(10.0, plant.applied.speed_rpm)
    for _ in range(5000):
        plant.measure()
        plant.apply(low)
        plant.step()
    assert "stopped" in plant.stopped and "0 mm" in plant.stopped
    first, second = values_of(run(plant, [low] * 2))
    assert first == second and all(isfinite(value) for value in first)
    plant.reset()
    assert plant.stopped == "" and plant.truth().depth_mm == pytest.approx(1.0)


def test_reset():
    plant = PlantEmulator()
    begin = values_of(run(plant, [Command(79.0, 410.0)] * 30))
    plant.begin(disturbance("depth", "step", 0.1))
    plant.begin(fault("depth", "bias", 1.0))
    plant.apply(Command(nan, 400.0))
    plant.reset(seed=1)
    assert plant.tick == FIRST_TICK + 30  # time advances
    again = values_of(run(plant, [Command(79.0, 410.0)] * 30))
    assert again == begin
    assert plant.gate.total() == 0 and not plant.faults and not plant.disturbances
    plant.reset(seed=2, depth_mm=2.8, temperature_c=830.0)
    assert plant.config["seed"] == 2
    assert (plant.truth().depth_mm, plant.truth().temperature_c) == pytest.approx((2.8, 830.0))
    with pytest.raises(BeyondDrivesError):
        plant.reset(temperature_c=560.0)
    assert plant.truth().depth_mm == pytest.approx(2.8)


def test_reset_between_measurement_and_command():
    plant = PlantEmulator()
    stamp = plant.measure().stamp_ns
    plant.reset()
    assert plant.apply(Command(79.0, 410.0), stamp) == ""
    assert plant.apply(Command(79.0, 410.0), stamp) == "repeated"


def test_start_beyond_the_drives_is_refused():
    with pytest.raises(BeyondDrivesError, match=r"2\.66 mm, 560 degC") as raised:
        plant_of(start={"temperature_c": 560.0})
    assert raised.value.required == pytest.approx((78.4, 275.0), abs=0.5)


@pytest.mark.requirement("S4")
@settings(deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(), st.floats(), st.integers()),
        max_size=30,
    )
)
def test_whatever_comes_the_drives_stay_within_their_limits(junk):
    plant = PLANT
    plant.reset()
    speeds, forces = [], []
    for force, speed, stamp in junk:
        plant.measure()
        plant.apply(Command(force, speed), stamp)
        plant.apply(Command(force, speed))
        plant.step()
        truth = plant.truth()
        forces.append(truth.force_kn)
        speeds.append(truth.speed_rpm)
    assert all(60.0 <= force <= 95.0 for force in forces) and all(
        300.0 <= speed <= 500.0 for speed in speeds
    )
    assert all(abs(b - a) <= 1.0 + 1e-9 for a, b in pairwise(forces))
    assert all(abs(b - a) <= 3.0 + 1e-9 for a, b in pairwise(speeds))
    assert plant.stopped == ""


PLANT = PlantEmulator()
