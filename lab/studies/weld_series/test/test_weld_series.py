"""The series of welds.

Its bags hold what was welded, and a short series has all that a long one has.
"""

import json

import numpy as np
import pytest
import yaml

pytest.importorskip("pyarrow")

from fsw_analysis.signals import load_weld
from fsw_quality import history
from fsw_recorder.manifest import check_files, read_manifest
from fsw_scenario import procedure
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make_all
from fsw_scenario.scenario_file import parse
from weld_series import bag, command, series

SHORT = {
    "name": "short",
    "phases": [
        {"name": "dwell", "duration_s": 3.0},
        {
            "name": "joint_line",
            "to_deg": 1.0,
            "set_points": [{"at_s": 1.0, "depth_mm": 2.7, "over_s": 2.0}],
        },
    ],
    "events": [
        {"at_s": 2.0, "fault": {"sensor": "depth", "kind": "dropout", "duration_s": 0.5}},
        {"at_s": 6.0, "switch": "nmpc"},
    ],
}


def test_bag_contains_the_signals_of_the_weld(tmp_path):
    scenario = parse(yaml.safe_dump(SHORT), "test")
    welded = ClosedLoop(scenario, make_all(scenario, "decentral", {})).run()
    action = {
        "who": "Ada",
        "holder": "Ada",
        "action": "take control",
        "outcome": "done",
        "message": "",
    }
    parameters = {"decentral": {"tuning": "tight"}}
    bag.write(tmp_path / "bag", scenario, welded, {"canister": "C1"}, parameters, {40: action})
    read = load_weld(tmp_path / "bag")
    assert read.problems == []
    for name in (
        "depth_mm",
        "torque_nm",
        "temperature_c",
        "reference_depth_mm",
        "force_kn",
        "speed_rpm",
    ):
        np.testing.assert_allclose(getattr(read, name), getattr(welded, name), rtol=1e-12)
    assert np.isnan(read.depth_mm).sum() == np.isnan(welded.depth_mm).sum() > 0
    np.testing.assert_allclose(read.truth.depth_mm, welded.truth.depth_mm, rtol=1e-12)
    for name in ("command_source", "actual_controller", "actual_mode"):
        assert getattr(read, name).tolist() == getattr(welded, name).tolist()
    assert read.phases == [("dwell", pytest.approx(0.1)), ("joint_line", pytest.approx(3.0))]
    assert read.angle_deg[-1] == pytest.approx(1.0) and read.travel_mm[-1] == pytest.approx(
        9.16, abs=0.01
    )
    events = [(event.kind, event.text) for event in read.events]
    assert ("operator", ": ".join(("Ada", "take control", "done"))) in events
    assert ("weld", "weld done") in events
    assert any(kind == "swap" and "nmpc commands (operator" in text for kind, text in events)
    assert {
        "scenario.yaml",
        "versions.json",
        "parameters/fsw_decentral.yaml",
    } <= read.attachments.keys()
    assert check_files(tmp_path / "bag", read_manifest(tmp_path / "bag")) == []


def test_manual_set_points_are_not_part_of_the_programme():
    number = next(weld for weld, kind in series.SPECIAL.items() if kind == "operator")
    content = yaml.safe_load(series.scenario_text(number))
    points = next(
        phase["set_points"] for phase in content["phases"] if phase["name"] == "joint_line"
    )
    assert series.WRONG_C in [point.get("temperature_c") for point in points]
    assert [phase["name"] for phase in series.series_procedure().model_dump()["phases"]] == [
        phase["name"] for phase in content["phases"]
    ]


@pytest.mark.slow
@pytest.mark.full
def test_short_series_writes_all_outputs_and_resumes(tmp_path, capsys):
    pytest.importorskip(
        "skfem", reason="scikit-fem is not installed: pip install -r requirements/canister.lock"
    )
    folder = tmp_path / "series"
    arguments = ["--welds", "1", "--workers", "1", "--joint-line", "10", "--out", str(folder)]
    assert command.main(arguments) == 0
    first = (folder / "welds" / "C001" / "row.json").stat().st_mtime_ns
    arguments[1] = "2"
    assert command.main(arguments) == 0
    assert (folder / "welds" / "C001" / "row.json").stat().st_mtime_ns == first
    assert history.load(folder / "history")["weld"].to_pylist() == ["C001", "C002"]
    for name in ("C001", "C002"):
        place = folder / "welds" / name
        made = json.loads((place / "record" / "record.json").read_text())
        assert made["verdict"] == "accept" and made["identity"]["tool"] == "T1"
    assert (folder / "report.html").exists()
    assert command.main([*arguments, "--joint-line", "20"]) == 1
    assert "joint line" in capsys.readouterr().err
    kept = procedure.load(folder / "procedure.yaml")
    assert kept == series.series_procedure(series.BEGIN_DEG + 10.0)


def test_folder_without_a_series_is_not_changed(tmp_path, capsys):
    (tmp_path / "mine").write_text("keep")
    assert command.main(["--out", str(tmp_path)]) == 1
    assert "is not empty" in capsys.readouterr().err and [
        path.name for path in tmp_path.iterdir()
    ] == ["mine"]
    assert command.main(["--out", str(tmp_path / "new"), "--joint-line", "5"]) == 1
    assert "give 10 to 360 deg" in capsys.readouterr().err
