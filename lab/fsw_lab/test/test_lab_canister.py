"""``fsw.py canister``.

The heat of a weld as table, pictures, VTK files and virtual thermocouples.
"""

import csv
import json
import re
from math import pi

import numpy as np
import pytest

pytest.importorskip(
    "skfem", reason="scikit-fem is not installed: pip install -r requirements/canister.lock"
)

import fsw_lab.canister_weld as canister_weld
from fsw.main import main
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make_all
from fsw_scenario.scenario_file import load
from fsw_scenario.weld_programme import MM_PER_DEG

pytestmark = pytest.mark.slow

#: small and coarse, so that it is reduced in a second
CANISTER = """
outer_radius_mm: 200.0
wall_mm: 50.0
rim_mm: 120.0
tube_mm: 320.0
lid_from_mm: 60.0
clamp_from_mm: 150.0
clamp_to_mm: 200.0
probe_radius_mm: 24.0
element_mm: 12.0
modes: 24
"""
SCENARIO = f"""
name: small
controller: decentral
duration_s: 40.0
plant:
  noise: false
  process: canister
  start: {{temperature_c: 816.4, power_kw: 43.6}}
  canister: {{{", ".join(CANISTER.split(chr(10))[1:-1])}}}
path:
  - {{at_s: 0.0, arc_mm: 0.0, axial_mm: 60.0}}
  - {{at_s: 10.0, arc_mm: 0.0, axial_mm: 60.0}}
  - {{at_s: 40.0, arc_mm: 43.0, axial_mm: 30.0}}
"""


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def scenario(tmp_path, cache, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "small.yaml"
    path.write_text(SCENARIO, encoding="utf-8")
    return path


def table(path):
    with path.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def test_a_table_over_time_and_one_of_the_phases(scenario, tmp_path, capsys):
    assert (
        main(
            [
                "canister",
                "--scenario",
                str(scenario),
                "--power",
                "30",
                "--probe",
                "200,5,0",
                "--probe",
                "160,365,0",
            ]
        )
        == 0
    )
    (file,) = tmp_path.glob("out/*_canister/heat.csv")
    columns = table(file)
    assert columns["time_s"] == pytest.approx(np.arange(1.0, 41.0))
    assert set(columns["power_kw"]) == {30.0}
    assert columns["tool_angle_deg"][[9, -1]] == pytest.approx([0.0, 43.0 / 200.0 * 180.0 / pi])
    assert columns["tool_axial_mm"][[9, -1]] == pytest.approx([60.0, 30.0])
    assert (np.diff(columns["stir_zone_c"][:10]) > 0.0).all()
    outside, inside = columns["probe 200,5,0 [degC]"], columns["probe 160,365,0 [degC]"]
    assert 20.0 < inside[-1] < outside[-1]  # the shoulder heats the outer surface
    shown = capsys.readouterr().out
    assert f"{columns['stir_zone_c'].max():.0f}" in shown
    assert str(file.relative_to(tmp_path)) in shown


@pytest.mark.full
def test_figure_shows_the_heat(scenario, tmp_path):
    Image = pytest.importorskip("PIL.Image")
    files = [
        "--csv",
        "a.csv",
        "--figure",
        "a.png",
        "--at",
        "1",
        "--at",
        "40",
        "--probe",
        "200,0,0",
    ]
    assert main(["canister", "--scenario", str(scenario), *files]) == 0
    shown = np.asarray(Image.open(tmp_path / "a.png").convert("HSV"))
    assert (shown[..., 1] > 200).sum() > 1000  # the colours of hot copper
    assert not list(tmp_path.glob(".*part*"))


def test_vtk_files_have_the_whole_geometry_and_its_heat(scenario, tmp_path):
    assert (
        main(
            [
                "canister",
                "--scenario",
                str(scenario),
                "--csv",
                "a.csv",
                "--vtk",
                "vtk",
                "--at",
                "10",
                "--at",
                "40",
            ]
        )
        == 0
    )
    series = json.loads((tmp_path / "vtk" / "canister.vtu.series").read_text())
    assert [file["time"] for file in series["files"]] == pytest.approx([10.0, 40.0])
    mesh = pytest.importorskip("meshio").read(tmp_path / "vtk" / series["files"][1]["name"])
    (cells,) = (block.data for block in mesh.cells if block.type == "hexahedron")
    corners = mesh.points[cells].astype(float)
    edges = (
        corners[:, [1, 3, 4]]
        + corners[:, [2, 2, 7]]
        - corners[:, [0, 0, 0]]
        - corners[:, [3, 1, 3]]
    )
    volume_mm3 = abs(np.linalg.det(0.5 * edges)).sum()
    expected = pi * ((200.0**2 - 150.0**2) * 440.0 + 150.0**2 * 50.0)
    assert volume_mm3 == pytest.approx(expected, rel=0.01)
    hottest = mesh.points[mesh.point_data["temperature_c"].argmax()]
    tool = [200.0 * np.cos(43.0 / 200.0), 200.0 * np.sin(43.0 / 200.0), 30.0]
    assert np.linalg.norm(hottest - tool) < 40.0


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--probe", "210,0,0"], "radius 210 mm, 0 mm"),
        (["--probe", "100,0,0"], "no copper"),
        (["--probe", "200,0"], "R,ANGLE,Z"),
        (["--probe", "200,nan,0"], "not finite"),
        (["--at", "41"], "0 to 40 s"),
        (["--csv", "small.yaml"], "small.yaml exists"),
        (["--canister", "small.yaml"], "small.yaml"),
        (["bag"], "--scenario does"),
    ],
)
def test_impossible_request_is_one_line_before_any_work(
    arguments, complaint, scenario, tmp_path, capsys
):
    assert main(["canister", "--scenario", str(scenario), *arguments]) == 1
    error = capsys.readouterr().err
    assert complaint in error
    assert error.startswith("error: ") and error.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} == {"small.yaml"}


def test_a_scenario_on_the_papers_process_has_no_canister(scenario, tmp_path, capsys):
    assert main(["canister", "--scenario", "reference_tracking"]) == 1
    error = capsys.readouterr().err
    assert "reference_tracking" in error and "process: canister" in error


@pytest.fixture
def weld(scenario, monkeypatch):
    """Signals of a weld, as of its bag."""
    loaded = load(str(scenario))
    signals = ClosedLoop(loaded, make_all(loaded, "decentral", {})).run()
    signals.attachments["scenario.yaml"] = loaded.text.encode()
    monkeypatch.setattr(canister_weld, "read_weld", lambda bag: signals)
    return signals


def test_the_heat_of_a_bag_is_that_of_its_weld(weld, tmp_path, capsys):
    assert main(["canister", "bag", "--csv", "a.csv"]) == 0
    columns = table(tmp_path / "a.csv")
    recorded = np.interp(columns["time_s"] + 0.1, weld.time_s, weld.truth.copper_temperature_c)
    assert columns["stir_zone_c"] == pytest.approx(recorded, abs=1.0)
    largest = re.search(r"the bag .*?(\d+\.\d+) degC$", capsys.readouterr().out, re.M)
    assert 0.0 <= float(largest[1]) < 1.0


def test_where_the_programme_was_held_the_tool_stood(weld, tmp_path):
    """The angle is reported each second; here the weld stands from 20 s to 25 s."""
    angle_deg = (
        43.0
        / 30.0
        / MM_PER_DEG
        * np.clip(weld.time_s - 10.0 - np.clip(weld.time_s - 20.0, 0.0, 5.0), 0.0, None)
    )
    weld.angle_deg = angle_deg[(np.arange(angle_deg.size) // 10) * 10]
    course = canister_weld.recorded(tmp_path).course
    at = (0.1 * np.arange(course.power_kw.size) + 0.1).round(1)
    moving = course.traverse_mm_per_s
    assert moving[(at > 12.0) & (at < 18.0)] == pytest.approx(43.0 / 30.0, rel=0.02)
    assert moving[(at > 21.5) & (at < 23.5)] == pytest.approx(0.0, abs=1e-9)
    assert moving[(at > 27.0) & (at < 38.0)] == pytest.approx(43.0 / 30.0, rel=0.02)
    assert course.axial_mm[[0, -1]] == pytest.approx([60.0, 35.0], abs=1.5)


def test_a_bag_without_heat_is_refused(weld, capsys):
    weld.truth = None
    assert main(["canister", "bag"]) == 1
    assert "has no /fsw/plant/truth" in capsys.readouterr().err
    weld.attachments["scenario.yaml"] = b"{name: a, controller: decentral, duration_s: 1.0}"
    assert main(["canister", "bag"]) == 1
    assert "process: canister" in capsys.readouterr().err


@pytest.mark.full
def test_the_shipped_weld(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["canister", "--csv", "a.csv", "--figure", "a.png", "--vtk", "vtk"]) == 0
    columns = table(tmp_path / "a.csv")
    assert columns["stir_zone_c"][columns["time_s"] > 120.0].min() > 700.0
    assert columns["stir_zone_c"].max() < 1083.0
    assert len(list((tmp_path / "vtk").glob("*.vtu"))) == 3
