"""The study of the adaptive preset: what it counts, and its page."""

import json
import random
from pathlib import Path

import pytest
from adaptive_nmpc import report, search, study

from fsw_scenario.controllers import make
from fsw_tuning.standard_runs import JUDGED


def runs(**values):
    """One plant's figures: a value for all of a column's figures."""
    return {
        column: {**dict.fromkeys(JUDGED, values.get(name, 1.0)), "swings": False}
        for name, column in NAMES.items()
    }


NAMES = dict(
    zip(
        ("conservative", "tight", "smith", "default", "fixed", "adaptive"),
        study.COLUMNS,
        strict=True,
    )
)


def test_shares_and_ratios_are_those_of_the_plants():
    plants = [runs(tight=2.0, adaptive=1.5), runs(fixed=0.5, adaptive=1.2)]
    header, *rows = report.shares(plants, [study.TIGHT])
    assert header[1:] == list(JUDGED.values())
    assert {row[0]: row[1] for row in rows} == {
        "nmpc:default": "100 %",
        study.FIXED: "100 %",
        study.ADAPTIVE: "50 %",
    }
    assert {row[0]: row[1] for row in report.shares(plants, study.RIVALS)[1:]}[
        study.ADAPTIVE
    ] == "0 %"
    assert report.against(plants, study.FIXED)[1][1:] == [
        "1.95",
        "2.35",
        "2.40",
        "0.5 → 1.2",
        "2 of 2",
    ]


def test_a_figure_is_lost_beyond_its_noise():
    plants, key = [runs(adaptive=1.05), runs(adaptive=1.2), runs(adaptive=1.4)], next(iter(JUDGED))
    assert [report.lost(plants, study.FIXED, key, sigma) for sigma in (0.0, 0.1, 0.2)] == [2, 1, 0]


def test_the_noise_of_a_figure_and_what_it_makes_worse_by_chance():
    noise = [
        [{"a": 1.0, "b": 1.0}, {"a": 3.0, "b": 1.05}],
        [{"a": 10.0, "b": 2.0}, {"a": 30.0, "b": 2.0}],
    ]
    assert report.scatter(noise, "a") == pytest.approx(2.0**0.5 / 2.0)
    assert report.by_chance(noise, ["a", "b"]) == pytest.approx(
        0.25
    )  # of both plants and figures, one way


def test_all_figures_count_movement_against_the_tight_one_alone():
    key = "tracking total_variation_force_kn"
    plants = [{name: {key: 5.0} for name in study.COLUMNS} | {study.CONSERVATIVE: {key: 1.0}}]
    rows = report.all_figures(plants)
    assert rows[1][1:] == ["100 %", "100 %", "100 %"]
    assert rows[1][0].startswith("set-points, ") and "variation force" in rows[1][0]
    assert rows[-1][1:] == ["**100.0 %**"] * 3


def test_the_figures_of_a_plant_are_those_of_both_cases():
    found = study.figures(
        {
            "tracking": {"iae_depth_mm_s": 1.0, "swings": False, "events": []},
            "disturbances": {"iae_depth_mm_s": 2.0, "swings": True},
        }
    )
    assert found == {
        "tracking iae_depth_mm_s": 1.0,
        "disturbances iae_depth_mm_s": 2.0,
        "swings": True,
    }
    assert study.figures({"tracking": {"error": "stopped"}}) == {"error": "stopped"}


def test_the_tool_jumps_when_it_should():
    loop = study.loop_of(study.Job(study.TIGHT, study.NOTHING))
    loop.plant = study.Struck(loop.plant, study.FELT_MM, study.FELT_S)
    depth = loop.run().truth.depth_mm
    assert abs(depth[:100] - 2.66).max() < 1e-3
    assert depth[100:102].max() > 2.74


def test_a_plant_that_cannot_run_is_left_out():
    assert len(study.ran({"0": runs(), "1": runs() | {study.TIGHT: {"error": "stopped"}}})) == 1


def test_the_columns_differ_only_in_what_they_are_named_for():
    with study.controllers() as made:
        fixed, adaptive = (
            make(*made[name]).settings.tuning for name in (study.FIXED, study.ADAPTIVE)
        )
    still = {"thermal_gain_walk": 0.0, "delay_walk_s": 0.0, "heat_sigmas": 0.0}
    assert adaptive.estimator.changed(**still) == fixed.estimator != adaptive.estimator
    assert adaptive.changed(estimator=fixed.estimator) == fixed


def test_the_published_page_is_that_of_the_published_numbers():
    folder = Path(__file__).resolve().parents[4] / "docs" / "results"
    content = json.loads((folder / "adaptive_tables.json").read_text(encoding="utf-8"))
    assert report.page(content) == (folder / "adaptive.md").read_text(encoding="utf-8")


@pytest.mark.full
def test_page_and_figure(tmp_path):
    welds = study.saturated_welds()
    data = {"random": {"0": runs(), "1": runs(adaptive=1.2)}, "nominal": study.nominal()}
    data["saturated"] = study.saturated(welds)
    drift = {key: [1.0, 2.0] for key in ("ramp", "sine", "deeper", "shallower")} | {"rest": [0.1]}
    data["drifts"] = {study.ADAPTIVE: drift}
    margins = ("depth_gain", "temperature_gain", "depth_delay_s", "temperature_delay_s")
    data["margins"] = {study.ADAPTIVE: dict.fromkeys(margins, 3.0)}
    data["noise"] = [[dict.fromkeys(JUDGED, 1.0 + 0.05 * way / 2.0**0.5) for way in (-1.0, 1.0)]]
    data["inside"] = [1990, 2000]
    figures = {"peak_c": 10.0, "moves_c": 1.0, "iae_c_s": 100.0}
    data["late"] = [{"later_s": 3.0, study.FIXED: figures, study.ADAPTIVE: figures}]
    data["search"] = [[found_plant(10.0, 100.0, 90.0)]]
    content = report.content(data)
    assert content["plants"] == 2
    assert content["campaign"] == {"welds": 2000, "inside_percent": 99.5}
    rows = content["tables"]["random plants, over no adaptation"]
    named = {row[0]: row[1:] for row in rows}
    assert named[next(name for name in named if "depth [mm s]" in name)] == [
        *("1.10", "1.19", "1.20", "1 → 1.2", "1 of 2", "5.0 %", "1")
    ]
    assert "2000 welds" in report.page(content)
    report.draw(welds, tmp_path / "priority.png")
    assert (tmp_path / "priority.png").read_bytes().startswith(b"\x89PNG")
    depth = {name: found["iae_depth_mm_s"] for name, found in data["saturated"].items()}
    by = [
        depth[f"{study.ADAPTIVE}, priority {name}"] for name in ("depth", "balance", "temperature")
    ]
    assert by == sorted(by) and by[0] < 0.5 * depth[study.DEFAULT]


def test_late_responses_are_counted_where_the_tuning_itself_does_not_swing():
    def one(fixed_c, iae):
        return {
            "later_s": 3.0,
            study.FIXED: {"peak_c": fixed_c, "moves_c": 1.0, "iae_c_s": 100.0},
            study.ADAPTIVE: {"peak_c": 10.5, "moves_c": 2.0, "iae_c_s": iae},
        }

    rows = report.late_rows([one(10.0, 120.0), one(10.2, 105.0), one(40.0, 200.0)])
    assert rows[1] == ["3", "2 of 3", "10.2", "10.5", "1.0", "2.0", "1"]


def found_plant(fixed_c, fixed, adaptive):
    """A row of the search."""
    both = {
        study.FIXED: {
            "peak_temperature_error_c": fixed_c,
            "iae_temperature_c_s": fixed,
            "iae_depth_mm_s": 1.0,
        },
        study.ADAPTIVE: {
            "peak_temperature_error_c": 10.0,
            "iae_temperature_c_s": adaptive,
            "iae_depth_mm_s": 1.0,
        },
    }
    plant = {name: 1.0 for name in (*search.UNIFORM, *search.FACTORS)}
    return {"plant": plant, "tracking": both, "disturbances": both}


def test_a_search_counts_the_plants_that_do_not_swing_without_adaptation():
    rounds = [
        [found_plant(10.0, 100.0, 90.0), found_plant(30.0, 100.0, 300.0)],
        [found_plant(11.0, 100.0, 120.0)],
    ]
    assert [row[:3] for row in report.found_rows(rounds)[1:]] == [
        ["random", "1 of 2", "0.90/0.90/0"],
        ["near the worst", "1 of 1", "1.20/1.20/1"],
    ]
    assert report.worst_plant(rounds)["ratio"] == pytest.approx(1.2)


def test_plants_of_a_search_keep_their_ranges_and_what_is_as_in_the_model():
    generator = random.Random(1)
    for plant in [search.drawn(generator) for _ in range(20)]:
        near = search.varied(plant, generator)
        assert near["seed"] != plant["seed"]
        for name, (low, high) in (search.UNIFORM | search.FACTORS).items():
            assert low <= near[name] <= high
            assert plant[name] or not near[name]
