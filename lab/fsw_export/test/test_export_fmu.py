"""FMUs: valid, with a state that can be restored, and with clear errors.

The plant is the emulator.
"""

import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from copy import copy
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fsw_control import Command, units
from fsw_control.sensors import REQUIRED, SENSORS
from fsw_export import fmu
from fsw_export.choice import Choice
from fsw_export.fmu_description import UNITS
from fsw_plant import PlantConfig, PlantEmulator
from fsw_plant.event_schema import disturbance
from fsw_test_support.c_code import STRICT, compile_c
from fsw_test_support.exports import fmu_file
from fsw_test_support.fmus import Units, fmpy, fmu_loop

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """An FMU of each unit with nothing changed."""
    return {name: fmu_file(tmp_path_factory, name) for name in fmu.UNITS}


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Units]:
    units = Units(tmp_path)
    yield units
    units.end_all()


def run(units: dict[str, Any], begin: int, ticks: int = 100) -> list[Any]:
    """Outputs of plant and controller in closed loop, tick by tick."""
    rows = []
    plant, controller = units.values()
    for number in range(begin, begin + ticks):
        fmu_loop.step(plant, controller, number)
        rows += [
            unit.get(name)
            for unit in (plant, controller)
            for name, v in unit.variables.items()
            if v.causality == "output"
        ]
    return rows


def initialised(unit: Any, **parameters: Any) -> None:
    unit.fmu.reset()
    unit.set(**parameters)
    unit.fmu.setupExperiment()
    unit.fmu.enterInitializationMode()
    unit.fmu.exitInitializationMode()


@pytest.mark.parametrize("name", fmu.UNITS)
def test_fmpy_validates_every_fmu(fmus: dict[str, Path], name: str) -> None:
    assert fmpy.validation.validate_fmu(str(fmus[name])) == []
    model = fmpy.read_model_description(str(fmus[name]))
    assert all(v.description for v in model.modelVariables)
    assert model.coSimulation.canGetAndSetFMUstate and model.coSimulation.canSerializeFMUstate
    assert not model.coSimulation.canHandleVariableCommunicationStepSize


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["nmpc", "decentral"])
def test_the_example_runs_with_each_controller(fmus: dict[str, Path], controller: str) -> None:
    example = Path(__file__).resolve().parents[3] / "examples" / "fmu_loop.py"
    ran = subprocess.run(
        [sys.executable, example, fmus["plant"], fmus[controller]], capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stderr
    assert float(ran.stdout.splitlines()[-1].split()[2]) == pytest.approx(2.76, abs=0.002)


def test_units_of_variables_match_the_project() -> None:
    assert UNITS["rpm"]["factor"] == units.rad_s_from_rpm(1.0)
    assert UNITS["kN"]["factor"] == units.n_from_kn(1.0)
    assert UNITS["mm"]["factor"] == units.m_from_mm(1.0)
    assert UNITS["kW"]["factor"] == units.w_from_kw(1.0)


@pytest.mark.parametrize(
    "values",
    [
        {},
        {
            "factors.thermal_gain_c_per_kw": 1.2,
            "actuators.lag_s": 0.3,
            "sensors.temperature_lag_s": 1.5,
        },
        {"factors.dead_time_s": 0.1},
    ],
)
def test_plant_fmu_matches_the_emulator(
    tmp_path: Path, running: Units, values: dict[str, float]
) -> None:
    """Also with a start, drives and a sensor that are set as the FMU's parameters, and with all disturbances."""
    fmu.write(fmu.make(Choice("plant", values=values)), tmp_path / "plant.fmu")
    own = {"start.depth_mm": 2.8, "start.temperature_c": 820.0, "limits.force_rate_kn_per_s": 5.0}
    own |= {"sensors.torque_drop_nm_per_rpm": 0.5}
    emulator = PlantEmulator(PlantConfig.from_values({**values, **own, "noise": False}))
    plant = running.start(tmp_path / "plant.fmu", **own)
    random = np.random.default_rng(1)
    channels = {"axial_force": "kn", "spindle_speed": "rpm", "depth": "mm", "temperature": "k"}
    for tick in range(300):
        reading, truth = emulator.measure(), emulator.truth()
        same = {SENSORS[name].signal: reading.values[name] for name in REQUIRED}
        same |= {
            "acting_force_kn": reading.drives.force_kn,
            "acting_speed_rpm": reading.drives.speed_rpm,
        }
        same |= {
            name: getattr(truth, name)
            for name in ("process_torque_nm", "friction_torque_nm", "copper_temperature_c")
        }
        same["power_kw"] = truth.process_power_kw
        assert {name: plant.get(name) for name in same} == same  # bit for bit
        for (channel, unit), value in zip(
            channels.items(), (0.1 * random.normal(size=4)).round(6), strict=True
        ):
            if tick % 10 == 0:
                emulator.begin(disturbance(channel, "step", value))
                plant.set(**{f"{channel}_disturbance_{unit}": value})
        command = Command(78.4 + random.uniform(-3.0, 3.0), 405.0 + random.uniform(-9.0, 9.0))
        assert emulator.apply(command) == ""
        emulator.step()
        plant.set(force_kn=command.force_kn, speed_rpm=command.speed_rpm)
        plant.fmu.doStep(0.1 * tick, 0.1)


def test_command_beyond_the_limits_is_clipped(fmus: dict[str, Path], running: Units) -> None:
    """Also to a limit that is changed meanwhile."""
    plant = running.start(fmus["plant"])
    plant.set(force_kn=100.0)
    for number in range(60):
        if number == 30:
            assert plant.get("acting_force_kn") == pytest.approx(95.0, abs=1e-9)
            plant.set(**{"limits.force_max_kn": 80.0})
        plant.fmu.doStep(0.1 * number, 0.1)
    assert plant.get("acting_force_kn") == pytest.approx(80.0, abs=1e-9)


@pytest.mark.parametrize("name", fmu.UNITS)
def test_restored_state_gives_the_same_bits(
    fmus: dict[str, Path], running: Units, name: str
) -> None:
    """Also another instance with a binary of its own, which is given the serialized state after the first has ended."""
    other = "nmpc" if name == "plant" else name
    units = {"plant": running.start(fmus["plant"]), other: running.start(fmus[other])}
    twin = running.start(fmus[name])
    units[other].set(reference_depth_mm=2.8)
    run(units, 0)
    states = {name: unit.fmu.getFMUstate() for name, unit in units.items()}
    first = run(units, 100)
    for variable, unit in units.items():
        unit.fmu.setFMUstate(states[variable])
    assert run(units, 100) == first

    saved = units[name].fmu.serializeFMUstate(states[name])
    units[name].fmu.freeFMUstate(states.pop(name))
    running.end(units[name])
    units[name] = twin
    states[name] = twin.fmu.deSerializeFMUstate(saved)
    for variable, unit in units.items():
        unit.fmu.setFMUstate(states[variable])
        unit.fmu.freeFMUstate(states[variable])
    assert run(units, 100) == first


@pytest.mark.parametrize("name", fmu.UNITS)
def test_damaged_state_is_refused(
    fmus: dict[str, Path], running: Units, capfd: pytest.CaptureFixture[str], name: str
) -> None:
    unit = running.start(fmus[name])
    state = unit.fmu.getFMUstate()
    saved = bytes(unit.fmu.serializeFMUstate(state))
    unit.fmu.freeFMUstate(state)
    reasons = ("no state of this FMU", "of a binary for another platform", "its checksum is wrong")
    places = [*range(200), *range(200, len(saved), max(1, len(saved) // 4000)), len(saved) - 1]
    for place in places:
        damaged = bytearray(saved)
        damaged[place] ^= 1 + place % 255
        with pytest.raises(fmpy.fmi2.FMICallException):
            unit.fmu.deSerializeFMUstate(bytes(damaged))
    lines = capfd.readouterr().out.splitlines()
    assert len(lines) == len(places) and all(
        any(reason in line for reason in reasons) for line in lines
    )
    for other in (saved[:-1], saved + b"\0", saved[:40], b""):
        with pytest.raises(fmpy.fmi2.FMICallException):
            unit.fmu.deSerializeFMUstate(other)
    unit.fmu.freeFMUstate(unit.fmu.deSerializeFMUstate(saved))


def test_instances_share_no_state(fmus: dict[str, Path], running: Units, tmp_path: Path) -> None:
    """Two of each in one binary, stepped in turn, one pair with another set-point."""
    pairs = []
    for name in ("plant", "nmpc"):
        first = running.start(fmus[name])
        second = copy(first)
        model = fmpy.read_model_description(str(fmus[name]))
        second.fmu = fmpy.simulation.instantiate_fmu(
            first.fmu.unzipDirectory, model, "CoSimulation"
        )
        initialised(second)
        pairs.append((first, second))
    moved, still = ({"plant": plant, "nmpc": nmpc} for plant, nmpc in zip(*pairs, strict=True))
    moved["nmpc"].set(reference_depth_mm=2.8)
    for number in range(100):
        run(moved, number, 1)
        run(still, number, 1)
    assert moved["plant"].get("depth_mm") > 2.79
    assert still["plant"].get("depth_mm") == pytest.approx(2.66, abs=1e-4)


def test_reset_restores_the_start(fmus: dict[str, Path], running: Units) -> None:
    units = {name: running.start(fmus[name]) for name in ("plant", "nmpc")}
    units["nmpc"].set(reference_depth_mm=2.8)
    first = run(units, 0)
    for unit in units.values():
        unit.fmu.reset()
        unit.fmu.setupExperiment(startTime=5.0)
        unit.fmu.enterInitializationMode()
        unit.fmu.exitInitializationMode()
    units["nmpc"].set(reference_depth_mm=2.8)
    assert run(units, 50) == first


@pytest.mark.parametrize("name", fmu.UNITS)
def test_exported_sources_are_complete(
    fmus: dict[str, Path], running: Units, tmp_path: Path, name: str
) -> None:
    """fmpy compiles them, in its own way, to a binary that computes the same."""
    bare, compiled = tmp_path / "bare.fmu", tmp_path / "compiled.fmu"
    with zipfile.ZipFile(fmus[name]) as whole, zipfile.ZipFile(bare, "w") as part:
        for entry in whole.namelist():
            if not entry.startswith("binaries/"):
                part.writestr(entry, whole.read(entry))
    fmpy.util.compile_platform_binary(str(bare), str(compiled))
    other = "nmpc" if name == "plant" else name
    loops = []
    for path in (fmus[name], compiled):
        units = {"plant": running.start(fmus["plant"]), other: running.start(fmus[other])}
        units[name] = running.start(path)
        units[other].set(reference_depth_mm=2.8)
        loops.append(run(units, 0))
    assert loops[1] == pytest.approx(loops[0], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("name", fmu.UNITS)
def test_exported_sources_are_strict_c99(fmus: dict[str, Path], tmp_path: Path, name: str) -> None:
    folder = Path(fmpy.extract(str(fmus[name]), str(tmp_path / name))) / "sources"
    for file in sorted(folder.glob("*.c")):
        built = compile_c(
            [*STRICT, "-Wno-unused-parameter", "-c", str(file), "-o", str(tmp_path / "object")]
        )
        assert built.returncode == 0, built.stderr


@pytest.mark.skipif(find_spec("ziglang") is None, reason="ziglang is not installed")
@pytest.mark.timeout(400)
def test_binary_for_another_platform(tmp_path: Path) -> None:
    """It can only be compiled here, not run."""
    fmu.write(fmu.make(Choice("plant")), tmp_path / "plant.fmu", others=["win64"])
    with zipfile.ZipFile(tmp_path / "plant.fmu") as whole:
        library = whole.read("binaries/win64/fsw_plant.dll")
    assert library.startswith(b"MZ") and b"fmi2DoStep\0" in library


@pytest.mark.full
def test_repeated_export_gives_the_same_file(fmus: dict[str, Path], tmp_path: Path) -> None:
    fmu.write(fmu.make(Choice("nmpc")), tmp_path / "again.fmu")
    with zipfile.ZipFile(fmus["nmpc"]) as first, zipfile.ZipFile(tmp_path / "again.fmu") as second:
        assert {name: first.read(name) for name in first.namelist()} == {
            name: second.read(name) for name in second.namelist()
        }


def pressed_out(plant: Any) -> None:
    """Force until the shoulder has left the copper."""
    initialised(plant, **{"limits.force_min_kn": 0.0, "start.depth_mm": 1.0})
    plant.set(force_kn=0.0)
    for number in range(2000):
        plant.fmu.doStep(0.1 * number, 0.1)


ERRORS: list[tuple[str, Callable[[Any], object], str]] = [
    (
        "plant",
        lambda u: u.fmu.doStep(0.0, 0.1),
        "fmi2DoStep from 0 s, but the time is 0.1 s: to go back use fmi2SetFMUstate",
    ),
    (
        "plant",
        lambda u: u.fmu.doStep(0.2, 0.1),
        "fmi2DoStep from 0.2 s, but the time is 0.1 s: no step can be left out",
    ),
    (
        "plant",
        lambda u: u.fmu.doStep(0.1, 0.2),
        "fmi2DoStep over 0.2 s: the communication step must be 0.1 s",
    ),
    (
        "plant",
        lambda u: u.fmu.doStep(0.1, 0.0),
        "fmi2DoStep over 0 s: the communication step must be 0.1 s",
    ),
    (
        "plant",
        lambda u: u.fmu.doStep(float("nan"), 0.1),
        "fmi2DoStep from nan s, but the time is 0.1 s",
    ),
    ("plant", pressed_out, "the model holds while the shoulder is in the copper, above 0 mm"),
    (
        "plant",
        lambda u: (u.set(force_kn=float("nan")), u.fmu.doStep(0.1, 0.1)),
        "input force_kn is not a finite number",
    ),
    ("plant", lambda u: u.set(depth_mm=1.0), "depth_mm is an output"),
    ("plant", lambda u: u.set(**{"start.depth_mm": 2.0}), "start.depth_mm is a fixed parameter"),
    (
        "plant",
        lambda u: u.set(**{"actuators.lag_s": -1.0}),
        "actuators.lag_s = -1 is outside 0 to 10",
    ),
    (
        "plant",
        lambda u: initialised(u, **{"start.temperature_c": 1000.0}),
        "beyond the drives' limits",
    ),
    (
        "plant",
        lambda u: (u.set(**{"limits.force_max_kn": 50.0}), u.fmu.doStep(0.1, 0.1)),
        "limits: force 60 to 50 kN, speed 300 to 500 rpm; minimum must be below maximum",
    ),
    (
        "plant",
        lambda u: u.fmu.getReal([999]),
        "there is no variable with this type and value reference",
    ),
    ("plant", lambda u: u.fmu.deSerializeFMUstate(b"x" * 10), "this is no state of this FMU"),
    ("nmpc", lambda u: u.set(max_iterations=1000), "max_iterations = 1000 is outside 5 to 200"),
    (
        "nmpc",
        lambda u: (u.set(temperature_aggressiveness=5.0), u.fmu.doStep(0.1, 0.1)),
        "temperature_aggressiveness: with 5 the approach takes 0.168 s; it takes at least 0.2 s",
    ),
    (
        "nmpc",
        lambda u: (u.set(speed_min=600.0), u.fmu.doStep(0.1, 0.1)),
        "each minimum must be below its maximum",
    ),
]


@pytest.mark.parametrize(("name", "mistake", "words"), ERRORS, ids=[words for *_, words in ERRORS])
def test_misuse_is_one_line(
    fmus: dict[str, Path],
    running: Units,
    capfd: pytest.CaptureFixture[str],
    name: str,
    mistake: Callable[[Any], object],
    words: str,
) -> None:
    unit = running.start(fmus[name])
    unit.fmu.doStep(0.0, 0.1)
    with pytest.raises(fmpy.fmi2.FMICallException):
        mistake(unit)
    lines = capfd.readouterr().out.splitlines()
    assert len(lines) == 1 and words in lines[0]


def test_instance_works_after_misuse(fmus: dict[str, Path], running: Units) -> None:
    """A refused step changes nothing."""
    plant, other = (running.start(fmus["plant"]) for _ in range(2))
    for unit in (plant, other):
        unit.fmu.doStep(0.0, 0.1)
    for values in ({"force_kn": float("inf")}, {"axial_force_disturbance_kn": -1e5}):
        plant.set(**values)
        with pytest.raises(fmpy.fmi2.FMICallException):
            plant.fmu.doStep(0.1, 0.1)
        plant.set(force_kn=80.0, axial_force_disturbance_kn=0.0)
    other.set(force_kn=80.0)
    for unit in (plant, other):
        unit.fmu.doStep(0.1, 0.1)
    outputs = [name for name, v in plant.variables.items() if v.causality == "output"]
    assert [plant.get(name) for name in outputs] == [other.get(name) for name in outputs]


def test_description_of_another_fmu_is_refused(
    fmus: dict[str, Path], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with (
        zipfile.ZipFile(fmus["plant"]) as whole,
        zipfile.ZipFile(tmp_path / "other.fmu", "w") as other,
    ):
        for entry in whole.namelist():
            text = whole.read(entry)
            other.writestr(
                entry,
                text.replace(b'guid="{', b'guid="{f') if entry == "modelDescription.xml" else text,
            )
    with pytest.raises(Exception, match="Failed to instantiate"):
        fmu_loop.Unit(str(tmp_path / "other.fmu"), tmp_path / "unpacked")
    assert "guid" in capfd.readouterr().out


def test_nmpc_without_sensors_holds_and_reports_it(fmus: dict[str, Path], running: Units) -> None:
    plant, nmpc = running.start(fmus["plant"]), running.start(fmus["nmpc"])
    run({"plant": plant, "nmpc": nmpc}, 0)
    nmpc.set(depth_fresh=False)
    for number in range(100, 140):
        fmu_loop.step(plant, nmpc, number)
        assert nmpc.get("healthy") == (number < 130)
    force = nmpc.get("force_kn")
    nmpc.set(reference_depth_mm=2.9)
    fmu_loop.step(plant, nmpc, 140)
    assert nmpc.get("force_kn") == force and nmpc.get("reason") == 4


def test_controller_on_standby_follows_the_applied_command(
    fmus: dict[str, Path], running: Units
) -> None:
    """What is applied is another's command: the output is never more than a step away from it."""
    plant, nmpc = running.start(fmus["plant"]), running.start(fmus["nmpc"])
    nmpc.set(applied_valid=True, reference_depth_mm=2.9)
    for number in range(50):
        force = 78.4 + 0.05 * number
        plant.feed(nmpc)
        nmpc.set(applied_force_kn=force, applied_speed_rpm=407.576)
        nmpc.fmu.doStep(0.1 * number, 0.1)
        assert abs(nmpc.get("force_kn") - force) <= 1.0 + 1e-9
        plant.set(force_kn=force)
        plant.fmu.doStep(0.1 * number, 0.1)


@pytest.mark.parametrize("name", ["nmpc", "decentral"])
def test_any_fmu_input_keeps_the_command_within_the_limits(
    fmus: dict[str, Path], running: Units, name: str
) -> None:
    unit = running.start(fmus[name])
    random = np.random.default_rng(3)
    junk = [float("nan"), float("inf"), -float("inf"), 1e300, -1e300, 1e12, 5e-324, -1.0, 0.0]
    for number in range(400):
        for input in unit.inputs:
            v = unit.variables[input]
            usual = float(v.start) if v.type == "Real" else v.start == "true"
            odd = random.choice(junk) if v.type == "Real" else bool(random.integers(2))
            unit.set(
                **{input: odd if random.random() < (0.02 if number < 200 else 0.3) else usual}
            )
        unit.set(applied_valid=bool(random.integers(2)))
        unit.fmu.doStep(0.1 * number, 0.1)
        assert 60.0 <= unit.get("force_kn") <= 95.0 and 300.0 <= unit.get("speed_rpm") <= 500.0
