"""The plant on a canister as an FMU.

It is the emulator wherever the tool goes, and says in a line what cannot be.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip(
    "skfem", reason="scikit-fem is not installed: pip install -r requirements/canister.lock"
)

from fsw_control import Command
from fsw_control.sensors import REQUIRED, SENSORS
from fsw_export import fmu
from fsw_export.choice import Choice
from fsw_plant import PlantConfig, PlantEmulator, PlantSchedule
from fsw_test_support.exports import made_once
from fsw_test_support.fmus import Units, fmpy

pytestmark = pytest.mark.slow

#: small and coarse, so that it is reduced in a second
VALUES: dict[str, Any] = {
    "process": "canister",
    "start.temperature_c": 780.0,
    "tool.axial_mm": 60.0,
    "tool.traverse_mm_per_min": 0.0,
    "factors.dead_time_s": 0.95,
    **{
        f"canister.{name}": value
        for name, value in {
            "outer_radius_mm": 200.0, "rim_mm": 120.0, "tube_mm": 320.0, "lid_from_mm": 60.0, "clamp_from_mm": 150.0,
            "clamp_to_mm": 200.0, "probe_radius_mm": 24.0, "element_mm": 12.0, "modes": 24,
        }.items()
    },
}  # fmt: skip
PATH = """
path:
  - {at_s: 0.0, arc_mm: 0.0, axial_mm: 60.0}
  - {at_s: 5.0, arc_mm: 0.0, axial_mm: 60.0}
  - {at_s: 15.0, arc_mm: 30.0, axial_mm: 0.0}
  - {at_s: 25.0, arc_mm: 40.0, axial_mm: 0.0}
"""
SAME = ("process_torque_nm", "friction_torque_nm", "copper_temperature_c")


@pytest.fixture(scope="module")
def unit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_once(
        tmp_path_factory,
        "canister.fmu",
        lambda out: fmu.write(fmu.make(Choice("plant", values=VALUES)), out),
    )


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Units]:
    units = Units(tmp_path)
    yield units
    units.end_all()


def test_canister_fmu_matches_the_emulator_along_a_path(unit: Path, running: Units) -> None:
    """From the heating on.

    Standing, on the way down, at two speeds, with a dead time of a broken number of steps.
    """
    assert fmpy.validation.validate_fmu(str(unit)) == []
    own = {"start.temperature_c": 800.0, "start.power_kw": 45.0}
    emulator = PlantEmulator(
        PlantConfig.from_values({**VALUES, **own, "noise": False}), PlantSchedule.from_yaml(PATH)
    )
    plant = running.start(unit, **own)
    random, seen = np.random.default_rng(1), []
    for tick in range(280):
        reading, truth = emulator.measure(), emulator.truth()
        same = {SENSORS[name].signal: reading.values[name] for name in REQUIRED}
        same |= {name: getattr(truth, name) for name in SAME} | {
            "power_kw": truth.process_power_kw
        }
        assert {name: plant.get(name) for name in same} == same
        seen.append(truth.copper_temperature_c)
        command = Command(78.4 + random.uniform(-3.0, 3.0), 405.0 + random.uniform(-30.0, 30.0))
        assert emulator.apply(command) == ""
        motion = emulator.travel.motion(emulator.tick)
        emulator.step()
        plant.set(force_kn=command.force_kn, speed_rpm=command.speed_rpm)
        plant.set(traverse_mm_per_min=60.0 * motion.traverse_mm_per_s, axial_mm=motion.axial_mm)
        plant.fmu.doStep(0.1 * tick, 0.1)
    assert np.ptp(seen) > 50.0


def test_restored_state_gives_the_same_bits(unit: Path, running: Units) -> None:
    plant = running.start(unit)

    def run(begin: int) -> list[float]:
        rows = []
        for tick in range(begin, begin + 20):
            plant.set(
                speed_rpm=400.0 + tick, traverse_mm_per_min=40.0 * (tick % 3), axial_mm=60.0 - tick
            )
            plant.fmu.doStep(0.1 * tick, 0.1)
            rows.append(plant.get("copper_temperature_c"))
        return rows

    run(0)
    state = plant.fmu.getFMUstate()
    first = run(20)
    plant.fmu.setFMUstate(state)
    assert run(20) == first and np.ptp(first) > 0.1
    plant.fmu.freeFMUstate(state)


MISTAKES: list[tuple[Callable[[Any], object], str]] = [
    (
        lambda u: u.set(axial_mm=-31.0),
        "canister: tool at -31 mm is off the copper; -30 to 85 mm above the joint",
    ),
    (lambda u: u.set(axial_mm=float("nan")), "tool at nan mm is off the copper"),
    (
        lambda u: u.set(traverse_mm_per_min=-1.0),
        "traverse_mm_per_min is -1; the tool travels one way: at least 0",
    ),
    (lambda u: u.set(traverse_mm_per_min=float("inf")), "traverse_mm_per_min is inf"),
]


@pytest.mark.parametrize(("mistake", "words"), MISTAKES, ids=[words for _, words in MISTAKES])
def test_misuse_is_one_line_and_changes_nothing(
    unit: Path,
    running: Units,
    capfd: pytest.CaptureFixture[str],
    mistake: Callable[[Any], object],
    words: str,
) -> None:
    plant = running.start(unit)
    before = plant.get("copper_temperature_c")
    mistake(plant)
    with pytest.raises(fmpy.fmi2.FMICallException):
        plant.fmu.doStep(0.0, 0.1)
    lines = capfd.readouterr().out.splitlines()
    assert len(lines) == 1 and words in lines[0]
    assert plant.get("copper_temperature_c") == before


def test_unreachable_start_is_reported(
    unit: Path, running: Units, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(fmpy.fmi2.FMICallException):
        running.start(unit, **{"start.power_kw": 3.0})
    lines = capfd.readouterr().out.splitlines()
    assert "3 kW" in lines[0] and "start.power_kw" in lines[0]
