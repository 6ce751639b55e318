"""The study of canisters: figures of phases, their summary, the single lag, the page."""

import json
from pathlib import Path

import numpy as np
import pytest
from canister import command, properties, report, validation, verdict

from fsw_control.schema.models import InputError
from fsw_scenario import scenario_file
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make

SHORT = """
name: short
controller: decentral
plant: {noise: false}
phases:
  - {name: dwell, duration_s: 5.0}
  - {name: start, to_deg: 1.0, set_points: [{temperature_c: 826.4}]}
"""


@pytest.fixture(scope="module")
def rows():
    scenario = scenario_file.parse(SHORT)
    signals = ClosedLoop(scenario, {"decentral": make("decentral")}).run()
    return list(verdict.phase_rows(scenario, signals))


def test_a_phase_at_rest_has_no_errors_and_one_with_a_step_has_its_size(rows):
    dwell, start = rows
    assert [dwell["phase"], start["phase"]] == ["dwell", "start"]
    assert dwell["seconds"] == pytest.approx(4.9)  # the first tick is at 0.1 s
    assert dwell["temperature_peak_c"] < 1e-3 and dwell["good"]
    assert start["temperature_peak_c"] == pytest.approx(10.0, abs=0.01)
    assert start["moved_rpm"] > 10.0 * dwell["moved_rpm"] + 1.0
    assert dwell["power_kw"] == pytest.approx(43.6, abs=0.01)


def test_weld_outside_for_longer_than_allowed_is_not_good(monkeypatch, rows):
    scenario = scenario_file.parse(SHORT)
    signals = ClosedLoop(scenario, {"decentral": make("decentral")}).run()
    monkeypatch.setattr(verdict, "TEMPERATURE_C", 0.5)
    dwell, start = verdict.phase_rows(scenario, signals)
    assert dwell["good"] and not start["good"]
    assert (
        start["outside_s"] == start["cold_s"] > verdict.AT_MOST_S
    )  # its set-point rises by 10 degC


def made(index, controller, good, phase="joint_line"):
    figures = dict.fromkeys((*report.FIGURES, "depth_peak_mm"), 6.0)
    return {
        "index": index,
        "controller": controller,
        "phase": phase,
        "seconds": 60.0,
        **figures,
        "power_kw": 50.0,
        "good": good,
        "outside_s": 0.0 if good else 9.0,
    }


def test_the_summary_counts_welds_that_are_good_in_all_phases_and_those_that_stopped():
    rows = [
        made(0, "nmpc:default", True),
        made(0, "nmpc:default", False, "parking"),
        made(1, "nmpc:default", True),
    ]
    rows.append(
        {"index": 2, "controller": "nmpc:default", "phase": "", "stopped": "out of the copper"}
    )
    summary = report.summary(rows)
    assert summary["welds"]["nmpc:default"] == {"welds": 3, "good": 1, "nearly": 2}
    assert summary["stopped"]["nmpc:default"] == 1
    assert summary["phases"]["joint_line"]["nmpc:default"]["share_good"] == 1.0
    assert summary["phases"]["parking"]["nmpc:default"]["share_good"] == 0.0
    assert summary["phases"]["joint_line"]["nmpc:default"]["moved_kn"] == pytest.approx(
        0.1
    )  # per second


def test_canisters_beyond_the_drives_and_those_on_which_the_nmpc_goes_astray_are_named():
    rows = [made(index, controller, True) for index in (4, 5) for controller in report.CONTROLLERS]
    count = len(report.CONTROLLERS)
    for row in rows[:count]:
        row["fastest_s"] = 1800.0
    rows[count]["fastest_s"] = 1800.0  # of one controller alone
    rows.append(made(5, "nmpc:default", False, "downward") | {"temperature_peak_c": 33.0})
    summary = report.summary(rows)
    assert list(summary["saturated"]) == [4] and len(summary["saturated"][4]) == count
    assert {name: of for name, of in summary["astray"].items() if of} == {"nmpc:default": [33.0]}
    assert summary["bad"] == {"all": 1, "long": 0}
    assert report.beyond(summary["saturated"])[1] == ["4, `nmpc:default`", "30", "6.0", "6.00"]


def test_a_controller_is_the_best_where_its_figure_is_the_smallest():
    rows = [made(0, controller, True) for controller in report.CONTROLLERS]
    rows[0]["moved_rpm"] = 3.0
    summary = report.summary(rows)
    assert report.best_of(summary, "moved_rpm", "nmpc:default") == "joint line"
    assert report.best_of(summary, "moved_rpm", "decentral:tight") == ""
    assert report.against(summary, "joint_line", "moved_rpm") == "50 % to 50 %"


def test_the_best_of_a_canister_has_the_smallest_error_of_the_whole_weld_and_slow_ones_do_not_count():
    names = [name for name in report.CONTROLLERS if name != "nmpc:paper"]
    rows = [
        made(index, name, True, phase)
        for index in (0, 1)
        for name in names
        for phase in ("start", "overlap")
    ]
    rows += [
        made(0, "nmpc:paper", True) | {"temperature_sigma_c": 0.1},
        made(2, "nmpc:default", True),
    ]
    for row in rows[:4]:  # of canister 0: the default one is good in a phase and bad in the other
        row["temperature_sigma_c"] = {"start": 20.0, "overlap": 0.0}[row["phase"]]
    rows[2]["temperature_sigma_c"] = rows[3]["temperature_sigma_c"] = 5.0
    rows[2 * len(names)]["temperature_sigma_c"] = 1.0  # default, canister 1
    summary = report.summary(rows)
    assert summary["best"] == {
        name: {names[0]: 0.5, names[1]: 0.5}.get(name, 0.0) for name in names
    }


def test_a_controller_that_has_welded_nothing_has_no_column():
    names = [name for name in report.CONTROLLERS if name != "nmpc:paper"]
    summary = report.summary([made(0, name, True) for name in names])
    for table in (report.shares(summary), report.figures(summary, "joint_line")):
        assert table[0][1:] == [f"`{name}`" for name in names] and not any(
            "-" in row for row in table
        )


def test_rows_of_several_versions_are_refused(tmp_path):
    file = tmp_path / "welds_0.jsonl"
    file.write_text(
        "".join(json.dumps({"software": version}) + "\n" for version in ("old", "new"))
    )
    with pytest.raises(InputError, match="versions: new; old"):
        verdict.read([file])


def test_the_line_source_is_that_of_the_table():
    """Of the gain from first principles: rise at 25 mm after 5 to 600 s, without an edge and with one."""
    assert validation.line_source(1e6) == pytest.approx(
        [3.73, 6.14, 10.3, 12.7, 14.6, 16.1, 16.4], rel=0.005
    )
    assert validation.line_source(60.0) == pytest.approx(
        [3.73, 6.15, 10.8, 14.1, 17.3, 19.9, 20.5], rel=0.02
    )


def test_single_lag_is_identified():
    time_s = 0.1 * np.arange(1, 3001)
    assert validation.one_lag(18.1 * (1.0 - np.exp(-time_s / 30.5)), 120.0) == pytest.approx(
        (18.1, 30.5)
    )


def test_an_experiment_begins_after_the_welding_before_it():
    scenario = validation.experiment(0.0, 100.0)
    assert scenario.duration_s == 700.0
    assert [event.at_s for event in scenario.events[:2]] == [0.0, 105.0]
    assert scenario.path[1].arc_mm == pytest.approx(700.0 * 86.0 / 60.0, abs=0.01)


def copper():
    """Of welds at constant temperatures, the joint line from 4 s on."""
    courses = {
        "real": [800.0] * 4,
        "kirchhoff": [815.0, 810.0, 812.0, 820.0],
        "constant": [795.0] * 4,
    }
    phases = ["dwell", "downward", "joint_line", "joint_line"]
    return {
        "power_kw": 47.0,
        "reference_c": 275.0,
        "at_s": [1.0, 2.0, 3.0, 4.0],
        "phase": phases,
        "stir_zone_c": courses,
    }


def test_error_of_linear_copper_is_reported_by_phase():
    assert report.worst_copper(copper(), "kirchhoff", "joint_line") == [12.0, 20.0]
    header, real, transformed, constant = report.coppers(copper())
    assert [name.split()[-1] for name in header[1:]] == ["dwell", "downward"]
    assert (
        real[1:] == ["800", "800"]
        and transformed[1:] == ["+15.0", "+10.0"]
        and constant[1:] == ["-5.0", "-5.0"]
    )


@pytest.mark.slow
def test_linear_models_are_compared_with_nonlinear_copper():
    """On a small canister, a minute from cold: what k(T), c(T) and radiation change grows with the temperature."""
    pytest.importorskip(
        "skfem", reason="scikit-fem is not installed: pip install -r requirements/canister.lock"
    )
    small = {"outer_radius_mm": 250.0, "tube_mm": 400.0, "modes": 25, "element_mm": 12.5}
    rows = properties.properties(0.5, changes=small)
    real, transformed, constant = (
        np.array(rows["stir_zone_c"][name]) for name in properties.MODELS
    )
    assert rows["at_s"][-1] == 28.0 or rows["at_s"][-1] == 32.0
    assert set(rows["phase"]) == {"dwell"}
    assert 300.0 < real[-1] < 700.0 and (np.diff(real) > 0.0).all()
    for model in (transformed, constant):
        assert 0.5 < np.abs(model - real).max() < 0.06 * (real[-1] - 20.0)


def test_a_missing_part_of_the_study_is_told_in_one_line(tmp_path):
    (tmp_path / "welds_0.jsonl").write_text("")
    with pytest.raises(InputError, match=r"validation\.json: .* part validate"):
        command.main(["page", "--out", str(tmp_path)])


@pytest.mark.parametrize("name", ["canister", "canister-verdict"])
def test_published_pages_are_those_of_the_published_numbers(name):
    folder = Path(__file__).resolve().parents[4] / "docs" / "results"
    content = json.loads((folder / f"{name}_tables.json").read_text(encoding="utf-8"))
    assert report.page(name, content) == (folder / f"{name}.md").read_text(encoding="utf-8")


def test_the_page_is_written(tmp_path):
    lags = {
        "rise_c": dict.fromkeys(("5", "10", "30", "60", "120", "300", "600"), 1.0),
        "lags": {"120": (18.1, 30.5)},
    }
    weld = {
        "minutes_kw": [50.0] * 45,
        "phases_kw": {"start": 43.0, "joint_line": 50.0},
        "phases_s": {"start": [0.0, 60.0], "joint_line": [60.0, 2700.0]},
    }
    known = {"lid, early": {name: (1.0, 0.1) for name in validation.THERMAL}}
    rows = [made(0, controller, True) for controller in report.CONTROLLERS]
    reduced = {
        "states": 9,
        "largest_c": 0.3,
        "rms_c": 0.1,
        "phases_c": {"downward": 0.3},
        "fine_states": 99,
        "element_mm": 12.0,
        "modes": 64,
        "from_fine_c": 0.1,
    }
    reduced |= {"minutes": [0.0, 45.0], "wrong_c": [0.1, -0.1]}
    data = {
        "validation": {
            "reduced": reduced,
            "steps": {"paper (16)": lags, "lid": lags},
            "identified": known,
            "weld": weld,
            "compact": [{"tolerance_k": 0.03, "states": 9, "largest_c": {"86": 0.1}}],
        },
        "properties": copper(),
        "verdict": report.summary(json.loads(json.dumps(rows))),
    }
    data["verdict"]["phases"] |= {
        name: data["verdict"]["phases"]["joint_line"] for name in report.PHASES
    }
    first, figure, verdict_page, shares = report.write(data, tmp_path)
    lines = verdict_page.read_text().splitlines()
    [row] = [line for line in lines if line.startswith("| **all phases**")]
    assert {cell.strip() for cell in row.split("|")[2:-1]} == {"1 of 1, 21 to 100 %"}
    content = json.loads((tmp_path / "canister_tables.json").read_text(encoding="utf-8"))
    assert content["reduced"]["phases_c"] == {"downward": 0.3}
    assert "| paper (16) | 1.00 |" in first.read_text()
    assert figure.stat().st_size > 10_000 and shares.stat().st_size > 5_000
    folder = tmp_path / "verdict"  # the plant was not validated
    folder.mkdir()
    assert (
        report.write({"validation": {}, "verdict": data["verdict"]}, folder)[0]
        == folder / "canister-verdict.md"
    )
    data["verdict"], folder = report.summary([]), tmp_path / "plant"  # nothing was welded
    folder.mkdir()
    assert report.write(data, folder) == [folder / "canister.md", folder / "canister.png"]
