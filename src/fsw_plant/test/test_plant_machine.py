"""The real machine: deflection, growth, hardness, and the channels of the depth."""

import json

import numpy as np
import pytest

from fsw_control import Command
from fsw_control.sensors import DEPTH_CHANNELS, REQUIRED, SENSORS
from fsw_plant import PlantConfig, PlantEmulator, PlantSchedule
from fsw_plant.event_schema import disturbance, fault
from fsw_plant.library import KERNEL

FOUR = {"machine.depth_channels": True, "noise": False}


def emulator(**machine):
    values = {f"machine.{name}": value for name, value in machine.items()}
    return PlantEmulator(PlantConfig.from_values(FOUR | values))


def welded(plant, ticks, command=None):
    """Samples, by sensor, and true depths of some ticks under a command."""
    rows, truth = [], []
    for _ in range(ticks):
        rows.append(plant.measure().values)
        truth.append(plant.truth().depth_mm)
        plant.apply(command or plant.applied)
        plant.step()
    return {name: np.array([row.get(name, np.nan) for row in rows]) for name in rows[0]}, truth


def test_table_fits_the_kernel():
    assert len(SENSORS) <= KERNEL.lib.FSW_PLANT_SENSORS


def test_one_sensor_unless_the_machine_has_more():
    assert tuple(PlantEmulator().measure().samples) == REQUIRED
    assert set(DEPTH_CHANNELS) < set(emulator().measure().samples)


def test_neutral_machine_with_more_sensors_shows_and_does_the_same():
    single, four = PlantEmulator(PlantConfig.from_values({"noise": False})), emulator()
    for k in range(50):
        readings = single.measure(), four.measure()
        assert readings[0].values["torque"] == readings[1].values["torque"]
        depth_mm = readings[0].values["depth"]
        assert all(readings[1].values[name] == depth_mm for name in DEPTH_CHANNELS)
        for plant in (single, four):
            plant.apply(Command(78.4 + 0.1 * k, 407.0))
            plant.step()


def test_axial_position_shows_deflection_as_depth():
    plant = emulator(compliance_mm_per_kn=0.03)
    shown, truth = welded(plant, 50, Command(84.4, 407.6))
    assert shown["depth_axial"][-1] - truth[-1] == pytest.approx(0.18, abs=1e-3)
    assert shown["depth_laser"] == pytest.approx(truth)
    _, its_truth = welded(emulator(), 50, Command(84.4, 407.6))
    assert truth == its_truth  # what is shown acts on nothing


def test_growth_follows_the_heat_and_is_missed_by_the_axial_position():
    plant = emulator(tool_growth_mm_per_kw=0.005, tool_growth_s=10.0)
    shown, truth = welded(plant, 400)
    missed = np.array(truth) - shown["depth_axial"]
    assert missed[0] == pytest.approx(0.0, abs=1e-9)
    assert missed[100] == pytest.approx(0.005 * 43.6 * (1.0 - np.exp(-1.0)), rel=1e-2)
    assert missed[-1] == pytest.approx(0.005 * 43.6, rel=3e-2)


def test_hard_copper_needs_more_force_and_torque_in_the_same_proportion():
    plain, hard = emulator(), emulator(hardness=1.1)
    assert hard.truth().process_torque_nm == pytest.approx(1.1 * plain.truth().process_torque_nm)
    assert hard.applied.force_kn == pytest.approx(1.1 * plain.applied.force_kn)
    for plant in (plain, hard):
        _, truth = welded(plant, 200)
        assert truth[-1] == pytest.approx(truth[0], abs=1e-9)  # both are at rest
    _, truth = welded(emulator(hardness=1.1), 200, plain.applied)
    assert truth[-1] < truth[0] - 0.1


def test_uneven_copper_is_the_same_after_a_turn_and_another_with_another_seed():
    def along(seed):
        plant = emulator(hardness_variation=0.03)
        plant.reset(seed)
        machine, hardness = plant.core.memory.machine, []
        for share in np.linspace(0.0, 1.0, 200):
            machine.travel_mm = share * machine.circumference_mm
            plant.step()
            hardness.append(machine.harder_here)
        return np.array(hardness)

    hardness = along(1)
    assert np.abs(hardness - along(2)).max() > 0.03
    assert hardness[-1] == pytest.approx(hardness[0], abs=1e-9)
    assert np.std(hardness[:-1]) == pytest.approx(0.03, rel=1e-2)


def test_friction_scales_the_torque_and_heats():
    plant = emulator()
    before = plant.truth()
    plant.begin(disturbance("friction", "step", 0.1))
    welded(plant, 30)
    after = plant.truth()
    assert after.process_torque_nm == pytest.approx(1.1 * before.process_torque_nm, rel=0.02)
    assert after.process_power_kw == pytest.approx(1.1 * before.process_power_kw, rel=0.02)


def test_edge_passes_below_the_leading_sensor_the_tool_and_the_trailing_one():
    plant = emulator(edge_mm=0.2, edge_at_mm=100.0)
    shown, truth = welded(plant, 1300)  # 186 mm
    travel_mm = 86.0 / 600.0 * np.arange(1300)
    off = {name: shown[name] - truth for name in DEPTH_CHANNELS}
    for name, begin, end, seen in (
        ("depth_lvdt_lead", 40.0, 100.0, 0.2),
        ("depth_lvdt_trail", 100.0, 160.0, -0.2),
        ("depth_axial", 100.0, 1e9, -0.2),
    ):
        inside = (travel_mm > begin + 0.1) & (travel_mm < end - 0.1)
        outside = (travel_mm < begin - 0.1) | (travel_mm > end + 0.1)
        assert off[name][inside] == pytest.approx(seen), name
        assert off[name][outside] == pytest.approx(0.0, abs=1e-9), name


def test_laser_sees_the_swollen_copper_and_run_out_is_aliased():
    plant = emulator(swelling_mm_per_mm=0.5, swelling_from_mm=2.46, runout_mm=0.02)
    shown, truth = welded(plant, 1000)
    off = shown["depth_laser"] - truth
    assert np.mean(off) == pytest.approx(0.1, abs=2e-3)
    spectrum = np.abs(np.fft.rfft(shown["depth_lvdt_lead"] - truth))
    turns_hz = plant.applied.speed_rpm / 60.0
    assert np.argmax(spectrum) / 100.0 == pytest.approx(10.0 - turns_hz, abs=0.02)


def test_one_sensor_may_be_that_of_a_real_machine():
    plant = emulator(depth_channels=False, depth_sensor="depth_axial", compliance_mm_per_kn=0.03)
    shown, truth = welded(plant, 50, Command(84.4, 407.6))
    assert shown["depth"][-1] - truth[-1] == pytest.approx(0.18, abs=1e-3)


def test_faults_of_channels_are_seen_by_the_fusion():
    plant = emulator()
    plant.begin(fault("depth_laser", "dropout"))
    reading = plant.measure()
    assert reading.fused.used and "laser" not in reading.fused.used
    assert reading.values["depth"] == pytest.approx(plant.truth().depth_mm, abs=0.01)


@pytest.mark.parametrize(("channels", "sensor"), [(False, "depth"), (True, "depth_axial")])
def test_biases_of_a_footprint_are_taken_off(tmp_path, channels, sensor):
    """By the angle of the tool; the channels stay as they are."""
    bias = [{"sensor": "depth", "bias_mm": [0.0, 0.36], "deviation_mm": [0.0, 0.0]}]
    path = tmp_path / "footprint.json"
    content = {"weld": "w", "sha256": "0" * 64, "angle_deg": [0.0, 360.0], "depth_mm": [2.7, 2.7]}
    path.write_text(json.dumps(content | {"deviation_mm": 0.0, "sensors": bias}))
    plant = PlantEmulator(
        PlantConfig.from_values(
            {"noise": False, "machine.depth_channels": channels}
            | {"machine.footprint_file": str(path)}
        )
    )
    shown, truth = welded(plant, 400)
    assert plant.core.angle_deg == pytest.approx(6.0, rel=0.2)
    taken_off = plant.measure().footprint_bias_mm
    assert truth[-1] - shown["depth"][-1] == pytest.approx(taken_off, abs=1e-3)
    assert taken_off == pytest.approx(1e-3 * plant.core.angle_deg, rel=0.3 if channels else 1e-6)
    if channels:
        assert shown[sensor][-1] == pytest.approx(truth[-1])
    path.unlink()
    kept = PlantConfig.from_values(plant.config.values, plant.config)
    assert kept.footprint is plant.config.footprint


@pytest.mark.parametrize(("changes", "follows"), [({}, False), (FOUR, True)])
def test_a_machine_with_an_uneven_path_follows_the_programme(changes, follows):
    """Its tool stands where the programme is held, as the footprint's angles do."""
    points = "{path: [{at_s: 0.0, arc_mm: 0.0}, {at_s: 1000.0, arc_mm: 2000.0}]}"
    schedule = PlantSchedule.from_yaml(points)
    plant = PlantEmulator(PlantConfig.from_values(changes), schedule)
    assert plant.follows_programme is follows
    assert not PlantEmulator(PlantConfig.from_values(changes)).follows_programme
    welded(plant, 10)
    before_mm = plant.core.travel_mm
    plant.follow_programme(1.0, standing=True)
    welded(plant, 10)
    assert plant.core.travel_mm == before_mm > 0.0


def test_a_reset_is_a_touch_off():
    """A channel that drifted is used again, and growth and deviation begin as at the start."""
    plant = emulator(tool_growth_mm_per_kw=0.005, tool_growth_s=150.0)
    first = plant.measure()
    plant.begin(fault("depth_laser", "drift", 0.02))
    welded(plant, 300)
    assert "laser" not in plant.measure().fused.used
    plant.begin(fault("depth_laser", "none"))
    welded(plant, 200)
    assert "laser" not in plant.measure().fused.used
    plant.reset()
    plant.step()
    again = plant.measure()
    assert set(again.fused.used) == set(DEPTH_CHANNELS.values())
    assert again.fused.deviation_mm == pytest.approx(first.fused.deviation_mm, rel=1e-3)
    shown, truth = welded(plant, 100)
    assert shown["depth"] == pytest.approx(truth, abs=0.02)
    assert set(plant.measure().fused.used) == set(DEPTH_CHANNELS.values())


def test_faults_of_the_depth_act_on_the_fused_value_once():
    plant = emulator()
    plant.begin(fault("depth", "spike", 1.0))
    shown = [plant.measure().values["depth"]]
    plant.apply(plant.applied)
    plant.step()
    shown.append(plant.measure().values["depth"])
    assert shown[0] - shown[1] == pytest.approx(1.0, abs=1e-3)
    plant.begin(fault("depth", "delay", 0.3))
    late = []
    for _ in range(8):
        plant.apply(plant.applied)
        plant.step()
        reading = plant.measure()
        late += [reading.stamp_ns - sample.stamp_ns for sample in reading.samples["depth"]]
    assert set(late[-4:]) == {300_000_000}


def test_channels_agree_wherever_the_touch_off_was():
    plant = emulator(compliance_mm_per_kn=0.03, touch_off_kn=40.0)
    for _ in range(100):
        plant.measure()
        plant.apply(plant.applied)
        plant.step()
    assert {health.word for health in plant.measure().fused.health.values()} == {"good"}
