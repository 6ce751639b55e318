"""The comparison: what the controllers reach, what none can beat, and the tables."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controller_comparison import figures as comparison_figures
from controller_comparison import report, sensing, study
from controller_comparison.optimum import Clairvoyant, courses
from controller_comparison.processes import INPUT_DISTURBANCES, MODELS, SENSING, random_factors
from controller_comparison.study import CONTROLLERS, DECENTRALIZED
from fsw_control.weld import DEPTH_MM, TEMPERATURE_C
from fsw_tuning.margins import Loops
from fsw_tuning.standard_cases import DEFAULT, TIGHT
from fsw_tuning.standard_runs import JUDGED, Job, figures, weld

pytestmark = pytest.mark.slow
KEYS = ("iae_depth_mm_s", "iae_temperature_c_s")


@pytest.fixture(scope="module")
def nominal():
    return study.nominal()


@pytest.fixture(scope="module")
def clairvoyant():
    return Clairvoyant(window_s=20.0)


@pytest.mark.full
def test_default_nmpc_is_calm_quick_and_nearly_decoupled(nominal):
    clean = nominal[DEFAULT]["clean"]
    assert clean["tracking"]["iae_depth_mm_s"] < 1.40
    assert clean["tracking"]["iae_temperature_c_s"] < 140.0
    assert clean["disturbances"]["iae_depth_mm_s"] < 0.29
    assert clean["disturbances"]["iae_temperature_c_s"] < 30.5
    events = clean["events"]
    assert max(events[name]["peak_temperature_error_c"] for name in ("z up", "z down", "dz")) < 0.3
    assert max(events[name]["peak_depth_error_mm"] for name in ("T up", "T down", "dT")) < 3e-3
    calm = nominal["decentral:conservative"]["rest"]
    assert all(nominal[DEFAULT]["rest"][key] < calm[key] for key in calm)


@pytest.mark.full
def test_default_nmpc_beats_both_pi_tunings_in_every_event(nominal):
    """In both errors together.

    The tight tuning buys some depth with temperature, so not in each one alone.
    """
    for kind in ("clean", "noisy"):
        for name, own in nominal[DEFAULT][kind]["events"].items():
            for rival in DECENTRALIZED:
                other = nominal[rival][kind]["events"][name]
                costs = [
                    100.0 * run["iae_depth_mm_s"] + run["iae_temperature_c_s"]
                    for run in (own, other)
                ]
                assert costs[0] < costs[1], (kind, name, rival)


@pytest.mark.full
@pytest.mark.parametrize("event", ["z up", "dz"])
def test_no_controller_beats_the_clairvoyant_optimum(nominal, clairvoyant, event):
    best = clairvoyant.best(*courses()[event], 1e4, 1e-3)
    assert best.solved
    for label in CONTROLLERS:
        assert nominal[label]["clean"]["events"][event]["iae_depth_mm_s"] >= best.iae[0]


@pytest.mark.full
def test_a_plant_that_cannot_run_is_named_on_the_page(nominal):
    data = study.sweep(
        {"too weak": {"factors.sliding_friction": 2.0, "factors.sticking_stress_pa": 2.0}}
    )
    assert all("error" in run for run in data["too weak"].values())
    page = report.pages({"nominal": nominal, "sweep": data})["other-processes.md"]
    assert len([line for line in page.splitlines() if line.startswith("- too weak: ")]) == 1


def test_random_plants_are_the_same_each_time():
    assert random_factors(3) == random_factors(3)
    assert random_factors(3)[0] != random_factors(3)[1]


def test_ratios_take_the_better_rival():
    def run(value):
        return {**dict.fromkeys(JUDGED, value), "swings": False}

    data = {"a": dict(zip((*DECENTRALIZED, DEFAULT), map(run, (2.0, 4.0, 1.0)), strict=True))}
    assert all(values == [0.5] for values in study.ratios(data).values())
    assert report.worse(data) == []
    assert report.quantiles([0.5, 2.0])["share"] == 0.5


def _published() -> dict[str, Any]:
    folder = Path(__file__).resolve().parents[4] / "docs" / "results"
    shown = json.loads((folder / "comparison_tables.json").read_text(encoding="utf-8"))
    return shown | {"other_models": json.loads((folder / "other_models.json").read_text("utf-8"))}


@pytest.mark.parametrize("name", report.PAGES)
def test_published_pages_are_those_of_the_published_numbers(name):
    page = Path(__file__).resolve().parents[4] / "docs" / "results" / f"{name}.md"
    assert report.pages(_published())[page.name] == page.read_text(encoding="utf-8")


def test_pages_without_their_numbers_are_left_out():
    shown = {"sweep": _published()["sweep"]}
    assert list(report.pages(shown)) == ["other-processes.md"]


def test_losses_at_matched_margin_are_named_first():
    moved = dict.fromkeys(study.VARIATIONS, 3.0)
    margins = {"temperature_gain": 2.0, "temperature_delay_s": 5.0}
    rivals = dict.fromkeys(study.FINALISTS, dict.fromkeys(JUDGED, 2.0) | moved | margins)
    own = (
        dict.fromkeys(JUDGED, 1.0) | moved | {"temperature_gain": 1.0, "temperature_delay_s": 9.0}
    )
    assert [text.split(",")[0] for text in report.behind(rivals | {DEFAULT: own})] == [
        "gain margin"
    ]


def test_models_on_which_the_nmpc_loses_are_counted():
    def run(value):
        return {**dict.fromkeys(JUDGED, value), "swings": False}

    names = (*DECENTRALIZED, DEFAULT)
    lost = dict(zip(names, map(run, (1.0, 2.0, 1.5)), strict=True))
    won = dict(zip(names, map(run, (1.0, 2.0, 0.5)), strict=True))
    assert len(report.model_losses({"1": lost, "2": won})) == len(JUDGED)
    assert report.model_losses({"2": won}) == []


def test_a_lag_of_the_probe_takes_margin():
    """With a lag of 3 s the temperature bears less delay than without."""
    label = "decentral:tight"
    assert Loops(label).with_delay(5.5)
    assert not Loops(label, plant=SENSING["lag 3 s"]).with_delay(5.5)


@pytest.mark.full
def test_sensors_are_compared_in_means_of_welds():
    by_sensor = sensing.runs({TIGHT: (TIGHT, {})})
    assert list(by_sensor) == list(SENSING)
    white, slow = (by_sensor[kind][TIGHT] for kind in ("white, no lag", "lag 3 s"))
    key = "tracking iae_temperature_c_s"
    seeds = [
        figures(Job(TIGHT, "tracking", True, {**study.LATENCY, "seed": seed}))[key.split()[1]]
        for seed in (1, 2)
    ]
    assert white[key] == pytest.approx(np.mean(seeds))
    assert slow[key] > 1.3 * white[key] and by_sensor["correlated 1 s"][TIGHT][key] != white[key]


@pytest.mark.full
def test_the_tuning_by_rule_is_calm_on_another_model():
    factors = random_factors(2, MODELS)[1]
    assert all(low <= factors[name] <= high for name, (low, high) in MODELS.items())
    compared = study.on_model(factors, evaluations=25)
    assert not compared[DEFAULT]["swings"]
    for key in ("tracking iae_temperature_c_s", "disturbances iae_temperature_c_s"):
        assert compared[DEFAULT][key] < min(compared[label][key] for label in DECENTRALIZED)


def test_figures_report_oscillation():
    strong = {"factors.thermal_gain_c_per_kw": 8.0}
    assert figures(Job(DECENTRALIZED[0], "tracking", plant=strong))["swings"]
    assert not figures(Job(DEFAULT, "tracking"))["swings"]
    noisy = weld(
        job := Job(
            TIGHT, "tracking", True, {**study.LATENCY, **SENSING["correlated 5 s, lag 3 s"]}
        )
    ).truth
    assert (
        np.ptp(noisy.temperature_c[-150:]) > 1.0 and not figures(job)["swings"]
    )  # it follows the noise


@pytest.mark.parametrize("plant", [{}, {"actuators.lag_s": 0.3}], ids=["nominal", "drive lag"])
def test_drive_offsets_leave_no_steady_error(plant):
    """+1 kN and -4 rpm behind the drives: the load cell and the speed sensor see them."""
    truth = weld(Job(DEFAULT, INPUT_DISTURBANCES, plant=plant)).truth
    depth_um, temperature_c = (
        1e3 * (truth.depth_mm - DEPTH_MM),
        truth.temperature_c - TEMPERATURE_C,
    )
    assert np.abs(depth_um).max() < 2.0 and np.abs(temperature_c).max() < 0.1
    assert np.abs(depth_um[-100:]).max() < 0.05 and np.abs(temperature_c[-100:]).max() < 0.01


def test_the_figure_of_the_readme_is_one_file(tmp_path):
    comparison_figures.set_point_steps(tmp_path / "steps.png")
    assert [path.name for path in tmp_path.iterdir()] == ["steps.png"]
    assert (tmp_path / "steps.png").read_bytes().startswith(b"\x89PNG")
