"""The process on a canister.

What takes the place of (16), the tool's path, the programme, the start.
"""

from dataclasses import replace
from math import exp

import pytest

from fsw_control.schema.models import InputError
from fsw_model import ModelParameters, OperatingPointError
from fsw_plant import BeyondDrivesError, PlantConfig, PlantEmulator, PlantSchedule
from fsw_plant.canister import CanisterParameters
from fsw_plant.event_schema import disturbance
from fsw_plant.library import KERNEL
from fsw_plant.tool_path import Motion, ToolPath, Waypoint

STILL = Motion(0.0, 0.0)


def plant_of(schedule="", **values):
    values = {"process": "canister", "noise": False, "start.temperature_c": 800.0} | values
    return PlantEmulator(
        PlantConfig.from_values(values), PlantSchedule.from_yaml(schedule) if schedule else None
    )


def advance(plant, ticks):
    for _ in range(ticks):
        plant.measure()
        plant.apply(plant.applied)
        plant.step()


def energy_kj(plant):
    return plant.core.field.memory.amplitude[0]


def copper_c(plant):
    """The stir zone within the dead time, as it deviates from the operating temperature."""
    return list(plant.core.field.memory.copper)[: plant.core.model.delay_steps + 1]


@pytest.mark.parametrize(("dead_time_s", "met"), [(2.8, 28), (2.75, 27.5), (0.1, 1), (0.15, 1.5)])
def test_the_tool_meets_the_copper_a_dead_time_late(block, dead_time_s, met):
    config = PlantConfig.from_values({"process": "canister", "start.power_kw": 50.0})
    plant = PlantEmulator(replace(config, model=ModelParameters(dead_time_s=dead_time_s)))
    copper, ends = copper_c(plant), KERNEL.ffi.new("double[2]")
    rate = copper[-1] - copper[-2]  # of a block under constant power
    KERNEL.lib.fsw_plant_meet(plant.core.field.memory, plant.core.model, ends)
    first, second = ends
    assert first == pytest.approx(copper[-1] - met * rate)
    assert second == pytest.approx(first + rate)


def test_thermocouple_lags_the_met_temperature_by_the_tool(block):
    p, plant = ModelParameters(), plant_of(**{"start.power_kw": 50.0})
    advance(plant, 1)
    copper = copper_c(plant)
    rate = (copper[-2] - copper[-3]) / 0.1
    # behind a steady ramp by dead time and lag
    truth = plant.truth()
    assert truth.copper_temperature_c - truth.temperature_c == pytest.approx(
        rate * (p.dead_time_s + p.tool_lag_s), rel=2e-3
    )
    tool = plant.core.memory.x[4]  # not how it comes about, but a step for the tool
    plant.core.field.memory.copper = [tool + 10.0] * len(copper)
    advance(plant, 1)
    assert plant.core.memory.x[4] - tool == pytest.approx(
        10.0 * (1.0 - exp(-0.1 / p.tool_lag_s)), rel=1e-9
    )


def test_the_power_of_24_heats_the_canister_and_nothing_else_does(block):
    plant = plant_of()
    before = energy_kj(plant)
    advance(plant, 100)
    powers = plant.truth().process_power_kw
    assert energy_kj(plant) - before == pytest.approx(10.0 * powers, rel=0.05)
    assert plant.truth().copper_temperature_c == pytest.approx(20.0 + 0.1 * energy_kj(plant))


def test_hard_copper_starts_at_rest(block):
    """The first step begins with the torque of the copper that is there."""
    plant = plant_of(**{"machine.hardness": 1.1})
    before = plant.truth().motor_torque_nm
    advance(plant, 1)
    assert plant.truth().motor_torque_nm == pytest.approx(before, rel=1e-3)


def test_a_torque_that_is_added_heats_the_canister_as_much_as_the_motor_shows(block):
    plants = plant_of(), plant_of()
    plants[0].begin(disturbance("torque", "step", 25.0))
    for plant in plants:
        advance(plant, 60)  # the motor settles
    before, powers = [energy_kj(plant) for plant in plants], []
    for _ in range(10):
        for plant in plants:
            advance(plant, 1)
        powers.append(plants[0].truth().process_power_kw - plants[1].truth().process_power_kw)
    more, less = (energy_kj(plant) - was for plant, was in zip(plants, before, strict=True))
    assert sum(powers) > 8.0 and more - less == pytest.approx(0.1 * sum(powers), rel=0.02)


def test_it_starts_where_the_thermocouple_shows_the_start_and_the_drives_give_the_heating_power(
    block,
):
    plant = plant_of(**{"start.power_kw": 48.0, "start.depth_mm": 2.7})
    truth = plant.truth()
    assert 800.0 <= truth.temperature_c < 801.0
    assert truth.depth_mm == pytest.approx(2.7)
    assert truth.process_power_kw == pytest.approx(48.0)


def test_a_start_that_cannot_be_is_one_line(block):
    with pytest.raises(OperatingPointError, match=r"800 degC: 1 kW .* start\.power_kw"):
        plant_of(**{"start.power_kw": 1.0})
    with pytest.raises(BeyondDrivesError):
        plant_of(**{"start.power_kw": 80.0})


def test_without_a_path_the_tool_moves_evenly(block):
    plant = plant_of(**{"tool.traverse_mm_per_min": 60.0, "tool.axial_mm": 30.0})
    advance(plant, 3)
    assert set(block.moved) == {(1.0, 30.0)}


PATH = """
path:
  - {at_s: 0.0, arc_mm: 0.0, axial_mm: 70.0}
  - {at_s: 1.0, arc_mm: 0.0, axial_mm: 70.0}
  - {at_s: 2.0, arc_mm: 5.0, axial_mm: 0.0}
events:
  - {at_s: 1.5, disturbance: {channel: depth, shape: ramp, amplitude_mm: 0.1, duration_s: 1.0}}
"""


def test_the_tool_follows_the_path_and_heats_where_it_begins(block):
    plant = plant_of(PATH)
    assert set(block.moved) == {(0.0, 70.0)}
    block.moved.clear()
    advance(plant, 21)  # tick 1 is at 0.1 s
    assert block.moved[:9] == [(0.0, 70.0)] * 9
    assert block.moved[9:19] == [(5.0, pytest.approx(70.0 - 7.0 * i)) for i in range(1, 11)]
    assert block.moved[19:] == [(0.0, 0.0)] * 2


def test_a_held_programme_keeps_the_tool_and_the_events_and_a_jump_moves_them(block):
    plant = plant_of(PATH)
    advance(plant, 13)
    plant.follow_programme(1.4, standing=True)
    block.moved.clear()
    advance(plant, 20)
    assert {traverse for traverse, _ in block.moved} == {0.0}
    assert plant.truth().depth_disturbance_mm == 0.0
    plant.follow_programme(1.4, standing=False)
    advance(plant, 3)
    plant.measure()
    assert block.moved[-3:] == [(5.0, pytest.approx(70.0 - 7.0 * i)) for i in (5, 6, 7)]
    assert plant.truth().depth_disturbance_mm == pytest.approx(0.02)  # 0.2 s of the ramp
    plant = plant_of(PATH)
    advance(plant, 3)
    plant.follow_programme(1.4, standing=False)
    advance(plant, 2)
    plant.measure()
    assert plant.truth().depth_disturbance_mm == pytest.approx(0.01)


def test_late_programme_report_counts_for_its_tick(block):
    plant = plant_of(PATH)
    advance(plant, 4)
    plant.follow_programme(0.3, standing=False, age_ticks=2)
    assert plant.travel.programme_s(plant.tick) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("[{at_s: 1.0, arc_mm: 0.0}, {at_s: 1.0, arc_mm: 1.0}]", "not later"),
        ("[{at_s: 0.0, arc_mm: 2.0}, {at_s: 1.0, arc_mm: 1.0}]", "goes back"),
        ("[{at_s: 0.0, arc_mm: 2.0, axial_mm: 900.0}]", "axial_mm = 900"),
    ],
)
def test_a_path_that_cannot_be_is_one_line(path, words):
    with pytest.raises(InputError, match=words):
        PlantSchedule.from_yaml(f"path: {path}")


def test_the_path_between_and_beyond_its_points():
    path = ToolPath(
        [Waypoint(at_s=1.0, arc_mm=0.0), Waypoint(at_s=3.0, arc_mm=4.0, axial_mm=2.0)], STILL
    )
    assert path.motion(0.0) == (0.0, 0.0)
    assert path.motion(1.9) == (pytest.approx(2.0), pytest.approx(1.0))
    assert path.motion(2.0, standing=True) == (0.0, pytest.approx(1.0))
    assert path.motion(9.0) == (0.0, 2.0)


def test_parameters_of_the_canister_are_parameters_of_the_plant():
    config = PlantConfig.from_values({"process": "canister", "canister": {"wall_mm": 52.0}})
    assert config.canister == CanisterParameters(wall_mm=52.0)
    assert PlantConfig.from_values({"canister.wall_mm": 52.0}).canister is None
    with pytest.raises(InputError, match=r"canister\.wall_mm = -1 "):
        PlantConfig.from_values({"canister.wall_mm": -1})
    with pytest.raises(InputError, match="than outer_radius_mm"):
        PlantConfig.from_values(
            {"process": "canister", "canister": {"wall_mm": 400.0, "outer_radius_mm": 300.0}}
        )
    with pytest.raises(InputError, match=r"'steel'.*canister"):
        PlantConfig.from_values({"process": "steel"})


def test_a_change_of_the_dead_time_while_running_keeps_the_history(block):
    plant = plant_of()
    newest = copper_c(plant)[-5:]
    plant.reconfigure(
        PlantConfig.from_values(
            {"process": "canister", "noise": False, "factors.dead_time_s": 0.5}
        )
    )
    assert copper_c(plant)[-5:] == newest
    assert len(copper_c(plant)) == 15
    advance(plant, 5)
    assert plant.stopped == ""
