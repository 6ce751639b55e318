"""The command of campaigns: what is wrong is one line; a weld is run again; reports."""

import json
import re

import pytest
import yaml

pytest.importorskip("pyarrow")

from fsw.main import main
from fsw_campaign import dataset, report
from fsw_campaign.dataset import TIMES
from fsw_campaign.statistics import arguments
from fsw_test_support.small_campaign import SMALL


def one(path, **entry):
    return {"distributions": {path: entry}}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"colour": "red"},
            "colour is",
        ),
        ({"welds": 0}, "welds = 0 "),
        ({"welds": -3}, "campaign.yaml: welds = -3 "),
        ({"welds": 1.5}, "valid integer"),
        ({"scenario": "nothing"}, "scenario nothing"),
        ({"scenario": "open_loop_force_steps"}, "open-loop"),
        ({"controllers": []}, "controllers is []"),
        ({"controllers": ["nobody"]}, "nobody is"),
        ({"controllers": ["decentral", "decentral"]}, "different label"),
        (
            {"controllers": [{"controller": "decentral", "parameters": {"depth_gian": 1.0}}]},
            "depth_gain",
        ),
        ({"sampler": "dice"}, "'latin_hypercube' or 'sobol'"),
        (one("plant.factors.copper_lag", uniform=[0.5, 2.0]), "copper_lag_s"),
        (one("plant.factors.copper_lag_s", uniform=[0.01, 2.0]), "outside 0.1 to 10"),
        (one("plant.factors.copper_lag_s", uniform=[2.0, 0.5]), "must be below"),
        (one("plant.factors.copper_lag_s", loguniform=[0.0, 0.5]), "above 0"),
        (one("plant.factors.copper_lag_s", uniform=[1.0, float("nan")]), "finite"),
        (one("plant.factors.copper_lag_s", uniform=[1.0, 2.0], choice=[1.0]), "exactly one of"),
        (one("plant.factors.copper_lag_s", normal={"mean": 1.0}), "lacks deviation"),
        (one("plant.noise", choice=[]), "choice is []"),
        (one("plant.noise", choice=[True, 1.0]), "several types"),
        (one("events[9].at_s", uniform=[1.0, 2.0]), "no [9]"),
        (one("events[1].at_s", uniform=[1.0, 10.0]), "events[1] is earlier"),
        (one("name[", choice=["a"]), "not a path"),
        (one("controller", choice=["nmpc"]), "distributions.controller is"),
        ({"limits": {"colour": {"max": 1.0}}}, "limits.colour is"),
        ({"limits": {"depth_mm": {}}}, "min or max"),
        ({"limits": {"depth_mm": {"min": 3.0, "max": 2.0}}}, "min below max"),
    ],
)
def test_bad_campaign_is_one_line_that_says_what(tmp_path, capsys, changes, words):
    file = tmp_path / "campaign.yaml"
    file.write_text(yaml.safe_dump(SMALL | changes))
    assert main(["campaign", str(file), "--out", str(tmp_path / "out")]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and words in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"name: [a", "campaign.yaml, line 2, column 1: "),
        (b"\xff\xfe", "UTF-8"),
        (b"", "must be a mapping"),
    ],
)
def test_unreadable_campaign_is_one_line(tmp_path, capsys, content, words):
    file = tmp_path / "campaign.yaml"
    file.write_bytes(content)
    assert main(["campaign", str(file), "--out", str(tmp_path / "out")]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and words in error
    assert not (tmp_path / "out").exists()


def test_the_command_of_a_weld_reproduces_it_to_the_last_digit(folder, tmp_path, capsys):
    made, table = dataset.load(folder)
    for number, row in enumerate(table.to_pylist()[2:4]):
        entrant = next(entrant for entrant in made.entrants if entrant.label == row["controller"])
        out = tmp_path / str(number)
        assert (
            main([*arguments(folder, entrant, made, row), "--no-figures", "--out", str(out)]) == 0
        )
        (again,) = json.loads((out / "kpi.json").read_text())
        for key in set(again) & set(row) - {*TIMES, "controller", "events"}:
            assert again[key] == row[key], key
    capsys.readouterr()


def test_reports(folder, tmp_path, capsys):
    assert main(["campaign", "report", str(folder), "--format", "svg"]) == 0
    names = ("ratios", "outside", "parameters")
    assert {p.stem for p in folder.glob("*.svg")} == {f"report_{name}" for name in names}
    html = (folder / "report.html").read_text()
    assert html.count("data:image/png;base64,") == 3 and "Wilson" in html and "simulate" in html
    assert "<code>temperature_c</code>" in html and "`" not in html
    assert (
        "every change settles" in html and "during depth steps" not in html
    )  # quick has no such figures
    page = tmp_path / "page.md"
    assert main(["campaign", "report", str(folder), "--out", str(page)]) == 0
    assert "median IAE" in page.read_text()
    figures = {path.name for path in tmp_path.glob("*.png")}
    assert figures == {"page_ratios.png"}
    assert all(f"]({name})" in page.read_text() for name in figures)
    tables = json.loads((tmp_path / "page_tables.json").read_text(encoding="utf-8"))
    ratios = tables.pop("ratios")
    assert {len(rows[0]) for rows in tables.values()} == {2, 3, 7}
    spreads = [spread for of in ratios.values() for spread in of.values()]
    assert spreads and all(low <= middle <= high for low, middle, high, _ in spreads)
    capsys.readouterr()
    report.write(folder, tmp_path / "again.md")
    assert (tmp_path / "again.md").read_text() == re.sub(
        r"\bpage(?=_|\.md)", "again", page.read_text()
    )


def test_limits_of_a_report_are_data(folder, tmp_path, capsys):
    limits = tmp_path / "limits.yaml"
    limits.write_text("- words: hardly any error\n  limits: {iae_depth_mm_s: {max: 1.0e-9}}\n")
    page = tmp_path / "page.md"
    assert (
        main(["campaign", "report", str(folder), "--out", str(page), "--limits", str(limits)]) == 0
    )
    tables = json.loads((tmp_path / "page_tables.json").read_text(encoding="utf-8"))
    (row,) = [row for row in tables["limits one by one"] if row[0] == "hardly any error"]
    assert [cell.startswith("0.0 [0.0, ") for cell in row[1:]] == [True, True]
    capsys.readouterr()
    for text, words in (
        ("- words: a\n  limits: {colour: {max: 1.0}}", "limits.yaml: colour is not a figure"),
        ("- limits: {}", "lacks words"),
        ("a: 1", "must be a list"),
        ("[", "not valid YAML"),
    ):
        limits.write_text(text)
        assert (
            main(
                [
                    "campaign",
                    "report",
                    str(folder),
                    "--out",
                    str(page),
                    "--limits",
                    str(limits),
                    "--force",
                ]
            )
            == 1
        )
        error = capsys.readouterr().err
        assert error.count("\n") == 1 and words in error


@pytest.mark.parametrize(
    "wrong",
    [
        ["campaign", "nothing.yaml"],
        ["campaign", "model_uncertainty", "somewhere"],
        ["campaign", "model_uncertainty", "--resume"],
        ["campaign", "model_uncertainty", "--welds", "0"],
        ["campaign", "model_uncertainty", "--workers", "0"],
        ["campaign", "model_uncertainty", "--workers", "2", "--scheduler", "tcp://127.0.0.1:1"],
        ["campaign", "report"],
        ["campaign", "report", "/nowhere"],
        ["campaign", "report", "/nowhere", "--welds", "3"],
        ["campaign", "model_uncertainty", "--limits", "limits.yaml"],
    ],
)
def test_wrong_arguments_are_one_line(wrong, capsys):
    assert main(wrong) == 1
    assert capsys.readouterr().err.count("\n") == 1
