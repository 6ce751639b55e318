"""fsw.py weld: a goal followed, refused, left and aborted."""

import json
import os
import re
import signal
import subprocess
import sys

import pytest
from rclpy.executors import ExternalShutdownException

from fsw.main import main
from fsw_test_support.player_graph import PlayerGraph
from fsw_test_support.waiting import PATIENCE_S

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("domain_id")]
SHORT = {
    "name": "short",
    "duration_s": 2.0,
    "events": [{"at_s": 1.0, "reference": {"depth_mm": 2.86}}],
}


class Cell(PlayerGraph):
    """A player that waits for goals, and the command in a process of its own."""

    def __init__(self):
        super().__init__("")
        self.commands = []

    def weld(self, *words):
        command = [
            sys.executable,
            "-m",
            "fsw.main",
            "weld",
            *map(str, words),
            "--timeout",
            f"{PATIENCE_S:g}",
        ]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        pipes = {
            "stdout": subprocess.PIPE,
            "stderr": subprocess.PIPE,
            "text": True,
            "env": environment,
        }
        self.commands.append(subprocess.Popen(command, **pipes))
        return self.commands[-1]

    def end_of(self, command):
        self.until(lambda: command.poll() is not None, "the command's end")
        return command.returncode, *command.communicate()


@pytest.fixture
def cell():
    new_cell = Cell()
    yield new_cell
    for command in new_cell.commands:
        command.kill()
        command.communicate()
    new_cell.end()


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "short.yaml"
    path.write_text(json.dumps(SHORT))
    return path


def test_a_weld_is_followed_to_its_result(cell, file):
    command = cell.weld("run", file, "--set", "events[0].reference.depth_mm=2.76")
    cell.until(
        lambda: cell.player.weld is not None and cell.player.weld.listening and cell.listens(),
        "the weld",
    )
    for number in range(1, 21):
        cell.number = number
        cell.depth(number)
        cell.until(
            lambda: cell.player.weld is None or cell.player.weld.machine.tick >= cell.number
        )
    code, printed, error = cell.end_of(command)
    assert (code, error) == (0, "")
    lines = printed.splitlines()
    assert lines[0].startswith("running: 1.9 s left, ")
    assert [line.partition(":")[0] for line in lines[-4:]] == [
        "done",
        "IAE",
        "largest error",
        "bag",
    ]
    figures = [re.findall(r"\d[\d.]*", line) for line in lines[-4:]]
    assert figures == [["2"], ["0.11", "0"], ["0.1", "0"], []]
    assert re.findall(r"short\b", lines[-4]) and " none " in lines[-1]


def test_second_weld_is_refused_and_a_detached_one_can_be_aborted(cell, file):
    first = cell.weld("run", file)
    cell.until(lambda: cell.player.weld is not None and cell.player.weld.listening, "the weld")
    code, _, error = cell.end_of(cell.weld("run", file))
    assert code == 1 and error.startswith("error: short ") and "(running at" in error, error
    first.send_signal(signal.SIGINT)
    code, _, error = cell.end_of(first)
    assert code == 130 and "weld abort" in error
    assert cell.player.weld is not None
    assert cell.end_of(cell.weld("abort"))[0] == 0
    code, _, error = cell.end_of(cell.weld("abort"))
    assert code == 1 and "no weld" in error


def test_a_wrong_scenario_is_refused_before_anything_is_sent(file, capsys):
    assert main(["weld", "run", str(file), "--set", "duration_s=-1"]) == 1
    assert "duration_s = -1" in capsys.readouterr().err


def test_a_command_that_is_terminated_says_so_in_one_line(monkeypatch, capsys):
    def ended(*_, **__):
        raise ExternalShutdownException

    monkeypatch.setattr("rclpy.spin_once", ended)
    assert main(["weld", "hold"]) == 130
    assert capsys.readouterr().err == "interrupted\n"


@pytest.mark.parametrize("verb", ["hold", "resume"])
def test_command_without_a_weld_is_refused(capsys, verb):
    assert main(["weld", verb, "--timeout", "0.1"]) == 1
    assert f"fsw/weld/{verb}" in capsys.readouterr().err
