"""The study of canisters: figures of phases, their summary, the single lag, the page."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from canister import command, report, validation

from fsw_analysis.report import templates
from fsw_control.schema.models import InputError
from fsw_model import heat_profile, nominal
from fsw_scenario import scenario_file
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make

sys.path.append(str(Path(__file__).resolve().parents[4] / "benchmarks"))
import heat

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
    return list(heat.phase_rows(scenario, signals))


def test_a_phase_at_rest_has_no_errors_and_one_with_a_step_has_its_size(rows):
    dwell, start = rows
    assert [dwell["phase"], start["phase"]] == ["dwell", "start"]
    assert dwell["seconds"] == pytest.approx(4.9)  # the first tick is at 0.1 s
    assert dwell["temperature_sigma_c"] < 1e-3 and dwell["good"]
    assert 0.0 < start["temperature_sigma_c"] < 10.0
    assert start["moved_rpm"] > 10.0 * dwell["moved_rpm"] + 1.0


def test_weld_outside_for_longer_than_allowed_is_not_good(monkeypatch, rows):
    scenario = scenario_file.parse(SHORT)
    signals = ClosedLoop(scenario, {"decentral": make("decentral")}).run()
    monkeypatch.setattr(heat, "TEMPERATURE_C", 0.5)
    dwell, start = heat.phase_rows(scenario, signals)
    assert dwell["good"] and not start["good"]
    assert start["outside_s"] == start["cold_s"] > heat.AT_MOST_S  # its set-point rises by 10 degC


def test_the_line_source_is_that_of_the_table():
    """Of the gain from first principles.

    Rise at 25 mm after 5 to 600 s, without an edge and with one.
    """
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
    """On a small canister, a minute from cold.

    What k(T), c(T) and radiation change grows with the temperature.
    """
    pytest.importorskip(
        "skfem", reason="scikit-fem is not installed: pip install -r requirements/canister.lock"
    )
    small = {"outer_radius_mm": 250.0, "tube_mm": 400.0, "modes": 25, "element_mm": 12.5}
    rows = validation.properties(0.5, changes=small)
    real, transformed, constant = (
        np.array(rows["stir_zone_c"][name]) for name in validation.MODELS
    )
    assert rows["at_s"][-1] == 28.0 or rows["at_s"][-1] == 32.0
    assert set(rows["phase"]) == {"dwell"}
    assert 300.0 < real[-1] < 700.0 and (np.diff(real) > 0.0).all()
    for model in (transformed, constant):
        assert 0.5 < np.abs(model - real).max() < 0.06 * (real[-1] - 20.0)


def test_a_missing_part_of_the_study_is_told_in_one_line(tmp_path):
    with pytest.raises(InputError, match=r"validation\.json: .* part validate"):
        command.main(["page", "--out", str(tmp_path)])


def test_published_page_is_that_of_the_published_numbers():
    folder = Path(__file__).resolve().parents[4] / "docs" / "results"
    content = json.loads((folder / "canister_tables.json").read_text(encoding="utf-8"))
    assert report.page(content) == (folder / "canister.md").read_text(encoding="utf-8")


def test_the_page_is_written(tmp_path):
    lags = {
        "rise_c": dict.fromkeys(("5", "10", "30", "60", "120", "300", "600"), 1.0),
        "lag": (18.1, 30.5),
    }
    weld = {
        "minutes_kw": [50.0] * 45,
        "phases_kw": {"start": 43.0, "joint_line": 50.0},
        "phases_s": {"start": [0.0, 60.0], "joint_line": [60.0, 2700.0]},
    }
    known = {"lid, early": {name: (1.0, 0.1) for name in validation.THERMAL}}
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
    validated = {
        "reduced": reduced,
        "steps": {"paper (16)": lags, "lid": lags},
        "identified": known,
        "weld": weld,
        "compact": [{"tolerance_k": 0.03, "states": 9, "largest_c": {"86": 0.1}}],
    }
    file = report.write(report.content_of(validated, copper()), tmp_path)
    content = json.loads((tmp_path / "canister_tables.json").read_text(encoding="utf-8"))
    assert content["reduced"]["phases_c"] == {"downward": 0.3}
    assert "| paper (16) | 1.00 |" in file.read_text()
    assert (tmp_path / "canister.png").stat().st_size > 10_000


def test_benchmark_of_learned_heat_has_figures_and_a_page_of_all_its_welds(monkeypatch):
    """With figures instead of welds: one canister, whose last phase the learned profile leaves too cold."""

    def made(task):
        cold_s = 9.0 if task.label in (heat.CONTROLLERS[-1], heat.HOTTEST) else 0.0
        size = 1.0 if task.label == "model" else 2.0 if task.label.endswith("mirrored") else 0.5
        weld = {"kind": task.kind, "canister": task.canister, "label": task.label}
        weld |= {"end_deg": task.end_deg, "rms_c": size, "later_fastest_s": 20.0}
        return [
            weld
            | dict.fromkeys(("temperature_sigma_c", "depth_sigma_mm", "moved_rpm"), size)
            | dict.fromkeys(("temperature_peak_c", "depth_peak_mm", "fastest_s"), size)
            | {"phase": phase, "cold_s": cold_s * (phase == "parking")}
            | {
                "outside_s": cold_s * (phase == "parking"),
                "good": phase != "parking" or not cold_s,
            }
            for phase in heat.PHASES
        ]

    profile = heat_profile.HeatProfile(
        type="t", model=heat_profile.ThermalModel.of(nominal()),
        welds=(heat_profile.HeatSource(weld="w", sha256="0" * 64),),
        travel_mm=(0.0, 1.0), heat_kw=(1.0, 2.0), deviation_kw=(0.1, 0.1),
    )  # fmt: skip
    numbers = ("computed", *heat.LEARNED, "whole")
    profiles = {(kind, n): profile for kind in (0, 1, 2, 3) for n in numbers}
    monkeypatch.setattr(heat, "measured", made)
    monkeypatch.setattr(
        heat._benchmark, "each", lambda function, jobs, name="": [function(job) for job in jobs]
    )
    monkeypatch.setattr(heat, "MEASURED", (500,))
    monkeypatch.setattr(
        heat, "profiles_of", lambda *_: (profiles, dict.fromkeys((0, 1, 2, 3), "m"))
    )
    figures, content = heat.measure(quick=False, minutes=1e6)
    assert (figures["wrong_pairings"], figures["wrong_above_most"]) == (16, 4)
    assert figures["mirrored_worst_cost"] == 2.0 and figures["learned_worse"] == 0
    expected = {
        "learned from 4: share of phases inside": 0.8,
        "learned from 4: share of phases inside, of those in reach": 1.0,
        "outside: type 3, canister 500: parking: hottest_cold_s": 9.0,
        "learned from 1: speed moved, all: share": 1.0,
    }
    assert {name: figures[name] for name in expected} == expected
    page = templates(Path(heat.__file__).parent).get_template("heat.md.j2").render(content)
    assert "16 wrong pairings 0.50 (median)" in " ".join(page.split())
