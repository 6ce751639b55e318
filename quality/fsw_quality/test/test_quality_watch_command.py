"""``fsw.py monitor`` and ``fsw.py history`` on the bag of a weld."""

import json
import re
import shutil
import sys
from itertools import islice
from pathlib import Path

import pytest

import fsw_quality
from fsw.main import main
from fsw_quality.diagnosis import NotJudged
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.bag_writer import BagWriter
from fsw_recorder.recover import copy

#: not judged on a canister
LEFT_OUT = {"heat_gain", "dead_time"}
BAG = Path(__file__).resolve().parents[3] / "test" / "golden" / "reference_tracking"


def test_monitor_of_a_bag_writes_figure_and_json(tmp_path):
    figure, figures = tmp_path / "figure.png", tmp_path / "told.json"
    assert main(["monitor", str(BAG), "--figure", str(figure), "--json", str(figures)]) == 0
    assert figure.read_bytes().startswith(b"\x89PNG")
    content = json.loads(figures.read_text())
    assert len(content["estimates"]) == 10
    assert (content["process"], content["alarms"], content["others"]) == ("paper", [], [])
    assert content["gains"]["torque"]["gain"] == pytest.approx(1.0, abs=0.02)
    assert main(["monitor", str(BAG), "--figure", str(figure)]) == 1


def test_monitor_of_a_bag_estimates_what_it_judges_and_says_what_not(tmp_path, capsys):
    figure, figures = tmp_path / "figure.svg", tmp_path / "told.json"
    words = ["monitor", str(BAG), "--process", "canister", "--figure", str(figure)]
    assert main([*words, "--json", str(figures)]) == 0
    content = json.loads(figures.read_text())
    estimates = content["estimates"]
    assert {name for name, estimate in estimates.items() if "not_judged" in estimate} == LEFT_OUT
    assert content["gains"].keys() == {"torque", "depth"}, "that of the heat is not known, either"
    judged = {name: estimate for name, estimate in estimates.items() if name not in LEFT_OUT}
    assert all(estimate["standard_error"] > 0.0 for estimate in judged.values())
    assert judged["thermocouple_drift"]["unit"] == "°C/min"
    assert {estimate["unit"] for estimate in judged.values()} >= {"mm/min", "kN", "N·m", "%"}
    out = capsys.readouterr().out
    assert out.count(NotJudged.HEAT_UNKNOWN.word.replace("_", " ")) == 2


def test_history_of_a_bag_its_report_and_what_changed(tmp_path, capsys, monkeypatch):
    pytest.importorskip("pyarrow")
    folder = tmp_path / "history"
    assert main(["history", "add", str(folder), str(BAG)]) == 0
    monkeypatch.setattr(
        "fsw_quality.commands.history.watch", None
    )  # what is refused is not watched first
    assert main(["history", "add", str(folder), str(BAG)]) == 1
    assert "twice" in capsys.readouterr().err
    copied = shutil.copytree(BAG, tmp_path / "copy")
    assert main(["history", "add", str(folder), str(copied)]) == 1
    err = capsys.readouterr().err
    assert re.search("copy .* reference_tracking", err) and len(err.splitlines()) == 1
    assert main(["history", "add", str(tmp_path / "other"), str(BAG), str(copied)]) == 1
    assert re.search("copy .* reference_tracking", capsys.readouterr().err)
    record = tmp_path / "record.json"
    record.write_text(
        '{"verdict": "accept", "files": [{"name": "bag_0.mcap", "sha256": "0"}]}', encoding="utf-8"
    )
    assert (
        main(["history", "add", str(tmp_path / "other"), str(BAG), "--record", str(record)]) == 1
    )
    assert str(record) in capsys.readouterr().err
    assert main(["history", "report", str(folder), "--format", "pdf"]) == 0
    assert (folder / "report.html").exists()
    assert (folder / "report_charts.pdf").read_bytes().startswith(b"%PDF")
    assert main(["history", "diff", str(folder), BAG.name, BAG.name]) == 0
    assert "nothing" in capsys.readouterr().out
    assert main(["history", "report", str(tmp_path / "none")]) == 1


def test_a_bag_without_a_weld_is_refused(tmp_path, capsys):
    pytest.importorskip("pyarrow")
    short = tmp_path / "short"
    with BagReader(BAG) as reader, BagWriter(short) as writer:
        for topic in reader.topics().values():
            writer.add_topic(topic)
        copy(islice(reader.records(), 12), writer)
    for command in (
        ["monitor", str(short)],
        ["history", "add", str(tmp_path / "history"), str(short)],
    ):
        assert main(command) == 1
        assert str(short) in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "history").exists()


def test_history_without_its_library_says_what_to_install_in_a_line(tmp_path, capsys, monkeypatch):
    monkeypatch.delitem(sys.modules, "fsw_quality.history", raising=False)
    monkeypatch.delattr(fsw_quality, "history", raising=False)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert main(["history", "report", str(tmp_path)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "pyarrow" in line and line.endswith("pip install 'fsw-quality[history]'")
