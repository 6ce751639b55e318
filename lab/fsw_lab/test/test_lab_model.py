"""``fsw.py model``: the bare process in open loop."""

import csv
from itertools import pairwise

import pytest

from fsw.main import main
from fsw_lab.input_steps import COLUMNS
from fsw_model import ProcessModel


def run(tmp_path, events, *arguments):
    (tmp_path / "events.yaml").write_text(events)
    return main(
        [
            "model",
            "--events",
            str(tmp_path / "events.yaml"),
            "--csv",
            str(tmp_path / "out.csv"),
            *arguments,
        ]
    )


def rows_of(path):
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


@pytest.mark.parametrize(
    ("name", "last_s", "steps"),
    [
        ("fig4", 30, {5.0: ("82.4", None), 13.5: ("78.4", None)}),
        (
            "fig5",
            40,
            {
                2.0: ("82.4", None),
                10.5: ("78.4", None),
                19.0: (None, "467.576"),
                27.1: (None, "447.576"),
                30.3: (None, "427.576"),
            },
        ),
    ],
)
def test_figures_of_the_paper(tmp_path, name, last_s, steps):
    assert main(["model", "--events", name, "--csv", str(tmp_path / "a.csv")]) == 0
    rows = rows_of(tmp_path / "a.csv")
    assert tuple(rows[0]) == COLUMNS
    assert [float(row["time_s"]) for row in rows] == [tick / 10 for tick in range(10 * last_s + 1)]
    changes = {
        float(new["time_s"]): tuple(
            new[key] if new[key] != old[key] else None for key in ("force_kn", "speed_rpm")
        )
        for old, new in pairwise(rows)
        if (new["force_kn"], new["speed_rpm"]) != (old["force_kn"], old["speed_rpm"])
    }
    assert changes == steps


def test_rows_are_those_of_the_model_with_all_digits(tmp_path):
    assert run(tmp_path, "[{at_s: 0, force_kn: 80}, {at_s: 1.2, speed_rpm: 410.5}]") == 0
    rows = rows_of(tmp_path / "out.csv")
    start = ProcessModel().equilibrium()
    assert len(rows) == 313  # 30 s after the last event
    speeds = [start.speed_rpm] * 12 + [410.5] * 301
    course = ProcessModel().simulate([80.0] * 313, speeds)
    for name in COLUMNS[1:]:
        assert [float(row[name]) for row in rows] == course[name].tolist()
    assert rows[0]["depth_mm"] == repr(start.outputs.depth_mm)


def test_another_model_and_a_figure(tmp_path):
    (tmp_path / "model.yaml").write_text("thermal_gain_c_per_kw: 21.72")
    events = "{duration_s: 5.0, events: [{at_s: 1.0, speed_rpm: 420}]}"
    assert run(tmp_path, events) == 0
    papers = (tmp_path / "out.csv").read_text()
    assert run(tmp_path, events) == 1
    assert (tmp_path / "out.csv").read_text() == papers
    arguments = [
        "--force",
        "--model",
        str(tmp_path / "model.yaml"),
        "--figure",
        str(tmp_path / "out.png"),
    ]
    assert run(tmp_path, events, *arguments) == 0
    assert (tmp_path / "out.csv").read_text() != papers
    assert (tmp_path / "out.png").read_bytes().startswith(b"\x89PNG")


BAD = [
    ("[", "not valid YAML"),
    ("3", "not a mapping"),
    ("{duration_s: 5}", "lacks events"),
    ("[{force_kn: 80}]", "events[0] lacks at_s"),
    ("[{at_s: 1}]", "needs force_kn or speed_rpm"),
    ("[{at_s: 1, force: 80}]", "events[0].force is an unknown key"),
    ("[{at_s: 1.05, force_kn: 80}]", "multiple of 0.1 s"),
    ("[{at_s: -1, force_kn: 80}]", "outside 0 to"),
    ("[{at_s: 1, force_kn: strong}]", "not a number"),
    ("[{at_s: 1, force_kn: .inf}]", "outside"),
    ("[{at_s: 1, force_kn: 1e300}]", "1e+300 is outside"),
    (f"[{{at_s: 1, force_kn: {10**400}}}]", "outside 0 to"),
    ("[{at_s: 2026-13-45, force_kn: 80}]", "not valid YAML"),
    ("[{at_s: 2, force_kn: 80}, {at_s: 1, force_kn: 81}]", "earlier than"),
    ("{duration_s: 1, events: [{at_s: 2, force_kn: 80}]}", "after the end at 1 s"),
    ("{duration_s: 1.05, events: []}", "multiple of 0.1 s"),
    ("[{at_s: 1, force_kn: 0}]", "depth"),
]


@pytest.mark.parametrize(("events", "words"), BAD)
def test_bad_input_is_one_line_and_leaves_no_file(tmp_path, capsys, events, words):
    assert run(tmp_path, events) == 1
    captured = capsys.readouterr()
    assert (
        captured.err.startswith("error: ")
        and captured.err.count("\n") == 1
        and words in captured.err
    )
    assert [path.name for path in tmp_path.iterdir()] == ["events.yaml"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--events", "missing.yaml"], "one of fig4, fig5"),
        (["--events", "fig4", "--model", "missing.yaml"], "cannot read model"),
        (["--events", "fig4", "--figure", "{tmp}/no/folder.png"], "no/folder.png"),
    ],
)
def test_bad_arguments(tmp_path, capsys, arguments, words):
    (tmp_path / "out.csv").write_text("precious")
    given = [word.format(tmp=tmp_path) for word in arguments]
    assert main(["model", "--force", "--csv", str(tmp_path / "out.csv"), *given]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and words in error
    assert [path.name for path in tmp_path.iterdir()] == ["out.csv"]
    assert (tmp_path / "out.csv").read_text() == "precious"
