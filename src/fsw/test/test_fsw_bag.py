"""The bag commands: their output, their errors, their exit codes."""

import json
import re
from pathlib import Path

import pytest

from fsw.main import main
from fsw_control.weld import TICK_NS
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.bag_writer import BagWriter
from fsw_test_support.programme_bag import write_programme_weld
from fsw_test_support.sample_weld import write_sample_weld


def run(*arguments: str) -> int:
    return main(["bag", *arguments])


def test_info(genuine_bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("info", str(genuine_bag)) == 0
    out = capsys.readouterr().out
    assert re.search("Messages +177", out) and "/demo/latched" in out and "Problem" not in out


def test_info_as_json(weld_bag: Path, tmp_path: Path) -> None:
    file = tmp_path / "info.json"
    assert run("info", "--json", str(file), str(weld_bag)) == 0
    assert run("info", "--json", str(file), str(weld_bag)) == 1  # without --force
    values = json.loads(file.read_text(encoding="utf-8"))
    assert values["messages"] == 3361 and values["attachments"] == {"scenario.yaml": 19}
    assert {topic["name"]: topic["count"] for topic in values["topics"]}["/fsw/depth"] == 300
    assert values["last_stamp_ns"] - values["first_stamp_ns"] == 299 * TICK_NS


def test_recovering_a_cut_bag(
    weld_bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes((weld_bag / "weld_0.mcap").read_bytes()[:100_000])
    assert run("recover", str(cut)) == 0
    captured = capsys.readouterr()
    assert "not finished" in captured.err and "recovered to" in captured.out
    assert run("info", str(tmp_path / "cut_recovered")) == 0
    assert "Problem" not in capsys.readouterr().out


def rows(printed: str) -> list[tuple[str, str]]:
    """The first two cells of each row of the tables."""
    cells = [
        [cell.strip() for cell in line.split("|")]
        for line in printed.splitlines()
        if line.startswith("|")
    ]
    return [(cell[1], cell[2]) for cell in cells]


def test_figures_of_each_phase_as_the_weld_went(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, file = tmp_path / "weld", tmp_path / "kpi.json"
    write_programme_weld(bag)
    assert run("kpi", str(bag), "--json", str(file)) == 0
    shown = rows(capsys.readouterr().out)
    for row in (
        ("dwell", "weld"),
        ("start", "weld"),
        ("whole weld", "weld"),
        ("published, 8 real welds", "cascade"),
    ):
        assert row in shown
    [result] = json.loads(file.read_text())
    assert [phase["phase"] for phase in result["phases"]] == ["dwell", "start", "whole weld"]
    assert result["phases"][0]["power_kw"] == pytest.approx(43.6)


def test_welds_with_and_without_phases_are_compared(
    weld_bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_programme_weld(tmp_path / "one")
    write_programme_weld(tmp_path / "two")
    assert run("kpi", str(tmp_path / "one"), str(tmp_path / "two")) == 0
    assert rows(capsys.readouterr().out).count(("published, 8 real welds", "cascade")) == 1
    assert run("kpi", str(tmp_path / "one"), str(weld_bag)) == 0
    shown = rows(capsys.readouterr().out)
    assert ("dwell", "one") in shown and ("dwell", "weld") not in shown


def test_welds_in_different_phases_come_one_after_the_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_programme_weld(tmp_path / "whole")
    write_programme_weld(tmp_path / "short", phases=1)
    assert run("kpi", str(tmp_path / "whole"), str(tmp_path / "short")) == 0
    assert [row for row in rows(capsys.readouterr().out) if row[1] in ("whole", "short")] == [
        ("dwell", "whole"),
        ("start", "whole"),
        ("whole weld", "whole"),
        ("dwell", "short"),
        ("whole weld", "short"),
    ]


def test_export(weld_bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("export", str(weld_bag), str(tmp_path / "weld.csv")) == 0
    assert "300 rows" in capsys.readouterr().out
    assert (tmp_path / "weld.csv").read_text().count("\n") == 301


def test_export_ends_with_the_scenario(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = tmp_path / "weld"
    write_sample_weld(bag, 50, scenario=b"duration_s: 3.0\n")
    assert run("export", str(bag), str(tmp_path / "cut.csv")) == 0
    captured = capsys.readouterr()
    assert "30 rows" in captured.out and "20 ticks" in captured.err and "omitted" in captured.err
    assert run("export", "--all", str(bag), str(tmp_path / "all.csv")) == 0
    captured = capsys.readouterr()
    assert "50 rows" in captured.out and captured.err == ""


def test_info_reports_missing_ticks(
    weld_bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with BagReader(weld_bag) as reader, BagWriter(tmp_path / "gaps") as writer:
        for topic in reader.topics().values():
            writer.add_topic(topic)
        depth = 0
        for record in reader.records():
            depth += record.topic == "/fsw/depth"
            if record.topic != "/fsw/depth" or not 100 < depth <= 107:
                writer.write(record.topic, record.data, record.log_time_ns, record.publish_time_ns)
    assert run("info", str(weld_bag)) == 0
    assert re.search("Ticks +none missing", capsys.readouterr().out)
    assert run("info", str(tmp_path / "gaps")) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("Ticks")]
    assert len(lines) == 1 and "/fsw/depth: 7 missing" in lines[0]


@pytest.mark.parametrize("command", ["info", "recover", "export"])
def test_bad_input_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    assert run(command, str(tmp_path / "missing")) == 1
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1 and "no such bag" in captured.err


@pytest.mark.parametrize("name", ["bag.mcap", "bag.db3"])
@pytest.mark.parametrize("data", [b"", b"random bytes that are no bag" * 100])
def test_file_that_is_no_bag(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, data: bytes
) -> None:
    (tmp_path / name).write_bytes(data)
    assert run("info", str(tmp_path / name)) == 1
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1
    assert "is empty" in captured.err if not data else ": not a" in captured.err
