"""The bag commands: their output, their errors, their exit codes."""

import argparse
import io
import json
from pathlib import Path

import pytest

from fsw_recorder.bag_cli import add_bag_commands, progress_line, run_command
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.bag_writer import BagWriter, RecordedTopic
from fsw_recorder.sample_weld import write_sample_weld


def run(*arguments: str) -> int:
    parser = argparse.ArgumentParser()
    add_bag_commands(parser.add_subparsers(required=True))
    return run_command(parser.parse_args(arguments))


def test_info(genuine_bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("info", str(genuine_bag)) == 0
    out = capsys.readouterr().out
    assert "Messages:     177" in out and "/demo/latched" in out and "Problem" not in out


def test_info_as_json(weld_bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("info", "--json", str(weld_bag)) == 0
    values = json.loads(capsys.readouterr().out)
    assert values["messages"] == 3061 and values["attachments"] == {"scenario.yaml": 19}
    assert {one["name"]: one["count"] for one in values["topics"]}["/fsw/depth"] == 300


def test_salvage_of_a_cut_bag(weld_bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes((weld_bag / "weld_0.mcap").read_bytes()[:100_000])
    assert run("salvage", str(cut)) == 0
    captured = capsys.readouterr()
    assert "not finished" in captured.err and "saved to" in captured.out
    assert run("info", str(tmp_path / "cut_salvaged")) == 0
    assert "Problem" not in capsys.readouterr().out


def test_export(weld_bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("export", str(weld_bag), str(tmp_path / "weld.csv")) == 0
    assert "300 rows" in capsys.readouterr().out
    assert (tmp_path / "weld.csv").read_text().count("\n") == 301


def test_export_ends_with_the_scenario(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = tmp_path / "weld"
    write_sample_weld(bag, 50, scenario=b"duration_s: 3.0\n")
    assert run("export", str(bag), str(tmp_path / "cut.csv")) == 0
    captured = capsys.readouterr()
    assert "30 rows" in captured.out and "20 ticks after the scenario's end are left out" in captured.err
    assert run("export", "--all", str(bag), str(tmp_path / "all.csv")) == 0
    captured = capsys.readouterr()
    assert "50 rows" in captured.out and captured.err == ""


def test_info_tells_missing_ticks(weld_bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with BagReader(weld_bag) as reader, BagWriter(tmp_path / "gaps") as writer:
        for topic in reader.topics().values():
            writer.add_topic(RecordedTopic(topic.name, topic.type_name, topic.schema_text, topic.type_hash))
        depth = 0
        for record in reader.records():
            depth += record.topic == "/fsw/depth"
            if record.topic != "/fsw/depth" or not 100 < depth <= 107:
                writer.write(record.topic, record.data, record.log_time_ns, record.publish_time_ns)
    assert run("info", str(weld_bag)) == 0
    assert "Ticks:        none missing" in capsys.readouterr().out
    assert run("info", str(tmp_path / "gaps")) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("Ticks:")]
    assert len(lines) == 1 and "/fsw/depth" in lines[0] and " 7  missing" in lines[0]


@pytest.mark.parametrize("command", ["info", "salvage", "export"])
def test_bad_input_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str) -> None:
    assert run(command, str(tmp_path / "missing")) == 1
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1 and "no such bag" in captured.err


@pytest.mark.parametrize("name", ["bag.mcap", "bag.db3", "bag.mcap.zstd", "bag.db3.zstd"])
@pytest.mark.parametrize("data", [b"", b"random bytes that are no bag" * 100])
def test_file_that_is_no_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, data: bytes) -> None:
    (tmp_path / name).write_bytes(data)
    assert run("info", str(tmp_path / name)) == 1
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1
    assert "is empty" in captured.err if not data else ": not a" in captured.err


def test_progress_only_on_a_terminal() -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    assert progress_line(io.StringIO()) is None
    terminal = Terminal()
    show = progress_line(terminal)
    assert show is not None
    show(0.5)
    show(1.0)
    assert "50 %" in terminal.getvalue() and terminal.getvalue().endswith("\r\033[K")
