"""FMUs of plant and controller in closed loop are the offline loop.

``fsw.py export fmu`` and its errors.
"""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fsw.main import main
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make
from fsw_scenario.scenario_file import parse
from fsw_test_support.exports import fmu_file
from fsw_test_support.fmus import Units, fmu_loop

SCENARIO = """
name: fmu
duration_s: 240.0
controller: {name}
plant: {{noise: false, model_file: '{model}', start: {{depth_mm: {depth}}}}}
events:
  - {{at_s: 10.0, reference: {{depth_mm: 2.86}}}}
  - {{at_s: 60.0, reference: {{temperature_c: 826.4}}}}
  - {{at_s: 120.0, disturbance: {{channel: depth, shape: step, amplitude_mm: 0.1}}}}
  - {{at_s: 160.0, disturbance: {{channel: temperature, shape: step, amplitude_c: -5.0}}}}
  - {{at_s: 200.0, disturbance: {{channel: axial_force, shape: step, amplitude_kn: 1.0}}}}
"""
#: the same events, by the number of the step before which they are set: what a sensor shows is at
#: the end of a step
STEPS: dict[int, tuple[str, dict[str, float]]] = {
    99: ("controller", {"reference_depth_mm": 2.86}),
    599: ("controller", {"reference_temperature_c": 826.4}),
    1198: ("plant", {"depth_disturbance_mm": 0.1}),
    1598: ("plant", {"temperature_disturbance_k": -5.0}),
    1999: ("plant", {"axial_force_disturbance_kn": 1.0}),
}
SENSORS = ("depth_mm", "torque_nm", "temperature_c")
#: controller, its parameters at the export, those set in the FMU, those offline
CASES: list[tuple[str, dict[str, Any], dict[str, Any], str]] = [
    ("nmpc", {}, {}, ""),
    ("nmpc", {}, {}, "thermal_gain_c_per_kw: 19.0\ndead_time_s: 2.55\n"),
    ("nmpc", {"preset": "paper", "speed_max": 480.0}, {}, ""),
    (
        "nmpc",
        {},
        {
            "depth_aggressiveness": 0.5,
            "temperature_aggressiveness": 2.0,
            "force_step": 0.5,
            "calmness": 2.0,
        },
        "",
    ),
    ("decentral", {}, {}, ""),
    ("decentral", {"tuning": "tight"}, {"depth_gain": 80.0, "speed_max": 480.0}, ""),
    (
        "decentral",
        {"tuning": "smith"},
        {"predictor_dead_time": 2.5, "decoupling_torque": 10.0},
        "",
    ),
]


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Units]:
    units = Units(tmp_path)
    yield units
    units.end_all()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "exported", "tuned", "model"), CASES)
@pytest.mark.full
def test_two_fmus_are_the_offline_loop(
    tmp_path: Path,
    running: Units,
    name: str,
    exported: dict[str, Any],
    tuned: dict[str, Any],
    model: str,
) -> None:
    options = [f"--parameter={key}={value}" for key, value in exported.items()]
    files = []
    if model:
        (tmp_path / "model.yaml").write_text(model)
        files = ["--model", str(tmp_path / "model.yaml")]
    used = files if name == "nmpc" else []
    assert main(["export", "fmu", "plant", "--out", str(tmp_path / "plant.fmu"), *files]) == 0
    assert (
        main(["export", "fmu", name, "--out", str(tmp_path / "controller.fmu"), *used, *options])
        == 0
    )

    text = SCENARIO.format(name=name, model=files[1] if files else "", depth=2.7)
    own = {"model_file": files[1]} if used else {}
    offline = ClosedLoop(
        parse(text, "test"), {name: make(name, {**exported, **tuned, **own})}
    ).run()

    plant = running.start(tmp_path / "plant.fmu", **{"start.depth_mm": 2.7})
    start = {
        "start_force_kn": plant.get("acting_force_kn"),
        "start_speed_rpm": plant.get("acting_speed_rpm"),
    }
    controller = running.start(
        tmp_path / "controller.fmu", **start, **tuned, reference_depth_mm=2.7
    )
    if "drives_valid" in controller.variables:
        controller.set(drives_valid=True)
    columns: dict[str, list[float]] = {name: [] for name in (*SENSORS, "force_kn", "speed_rpm")}
    for number in range(2400):
        if number in STEPS:
            unit, values = STEPS[number]
            (plant if unit == "plant" else controller).set(**values)
        for sensor in SENSORS:
            columns[sensor].append(plant.get(sensor))
        fmu_loop.step(plant, controller, number)
        columns["force_kn"].append(controller.get("force_kn"))
        columns["speed_rpm"].append(controller.get("speed_rpm"))
    for column, values in columns.items():
        np.testing.assert_allclose(
            values, getattr(offline, column), rtol=1e-9, atol=1e-9, err_msg=column
        )
    assert np.ptp(offline.depth_mm) > 0.1 and np.ptp(offline.speed_rpm) > 10.0


@pytest.mark.slow
@pytest.mark.full
def test_a_known_set_point_is_prepared_as_offline(
    tmp_path_factory: pytest.TempPathFactory, running: Units
) -> None:
    text = (
        "{name: ahead, duration_s: 30, controller: nmpc, announced: true, "
        "plant: {noise: false}, events: [%s]}"
    )
    event = "{at_s: 15.0, reference: {depth_mm: 2.8, temperature_c: 820.0}}"
    offline = ClosedLoop(parse(text % event, "test"), {"nmpc": make("nmpc")}).run()
    plant = running.start(fmu_file(tmp_path_factory, "plant"))
    nmpc = running.start(
        fmu_file(tmp_path_factory, "nmpc"),
        drives_valid=True,
        change_depth_mm=2.8,
        change_temperature_c=820.0,
    )
    speeds = []
    for number in range(300):
        ahead = 149 - number
        nmpc.set(change_valid=ahead > 0, change_at_s=0.1 * ahead)
        if ahead == 0:
            nmpc.set(reference_depth_mm=2.8, reference_temperature_c=820.0)
        fmu_loop.step(plant, nmpc, number)
        speeds.append(nmpc.get("speed_rpm"))
    np.testing.assert_allclose(speeds, offline.speed_rpm, rtol=1e-9)
    assert abs(speeds[140] - speeds[0]) > 1.0


ERRORS = [
    ("pump", [], "cannot export 'pump'; known: plant, nmpc, decentral"),
    (
        "plant",
        ["--parameter", "start.dept_mm=3"],
        "unknown parameters start.dept_mm; did you mean start.depth_mm",
    ),
    ("plant", ["--parameter", "start.depth_mm=9"], "start.depth_mm = 9 is outside 1 to 5 mm"),
    (
        "plant",
        ["--parameter", "start.temperature_c=.nan"],
        "start.temperature_c = nan is outside",
    ),
    ("plant", ["--parameter", "start.temperature_c=1080"], "beyond the drives' limits"),
    ("plant", ["--parameter", "seed=2"], "unknown parameters seed"),
    ("plant", ["--parameter", "canister.wall_mm=52"], "unknown parameters canister.wall_mm"),
    (
        "plant",
        ["--parameter", "process=canister", "--parameter", "canister.wall_mm=-1"],
        "wall_mm = -1 is outside",
    ),
    ("plant", ["--parameter", "start.depth_mm"], "--parameter start.depth_mm: write NAME=VALUE"),
    ("plant", ["--tuning", "x.yaml"], "the plant has no tuning"),
    ("plant", ["--model", "missing.yaml"], "cannot read model missing.yaml"),
    ("plant", ["--model", "short.yaml"], "dead_time_s = 0.05 is outside 0.1 to 10"),
    ("nmpc", ["--model", "brief.yaml"], "the NMPC needs at least 0.9 s"),
    ("nmpc", ["--model", "unknown.yaml"], "gain is an unknown key"),
    ("nmpc", ["--tuning", "missing.yaml"], "cannot read tuning_file missing.yaml"),
    ("nmpc", ["--parameter", "force_min=99"], "force_min (99) must be below force_max"),
    ("decentral", ["--parameter", "tuning=sharp"], "'conservative', 'tight'"),
    ("decentral", ["--tuning", "missing.yaml"], "cannot read tuning missing.yaml"),
    ("decentral", ["--tuning", "unknown.yaml"], "unknown parameters gain"),
]


@pytest.mark.parametrize(("unit", "options", "words"), ERRORS)
def test_impossible_export_is_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    unit: str,
    options: list[str],
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("short.yaml").write_text("dead_time_s: 0.05\n")
    Path("brief.yaml").write_text("dead_time_s: 0.5\n")
    Path("unknown.yaml").write_text("gain: 1.0\n")
    assert main(["export", "fmu", unit, "--out", "x.fmu", *options]) == 1
    shown = capsys.readouterr()
    assert words in shown.err and shown.err.count("\n") == 1 and shown.out == ""
    assert not Path("x.fmu").exists()


@pytest.mark.slow
def test_nothing_is_overwritten_unless_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "plant.fmu"
    out.write_text("precious")

    def told(path: Path, *options: str) -> str:
        assert main(["export", "fmu", "plant", "--out", str(path), *options]) == 1
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == 1
        return lines[0]

    assert "exists already" in told(out)
    assert "in .fmu" in told(tmp_path / "plant.zip")
    assert "cannot write" in told(tmp_path / "missing" / "plant.fmu")
    (tmp_path / "folder.fmu").mkdir()
    assert "exists already" in told(tmp_path / "folder.fmu", "--force")
    monkeypatch.setenv("CC", "false")
    assert "with false" in told(out, "--force")
    assert out.read_text() == "precious"
    assert sorted(os.listdir(tmp_path)) == ["folder.fmu", "plant.fmu"]
    monkeypatch.delenv("CC")
    assert main(["export", "fmu", "plant", "--out", str(out), "--force"]) == 0
    shown = capsys.readouterr().out
    assert "start.depth_mm" in shown and f"{out}: " in shown
