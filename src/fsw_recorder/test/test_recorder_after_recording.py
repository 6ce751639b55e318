"""What runs when a bag is finished."""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path
from typing import Any

import pytest
from std_msgs.msg import String

from fsw_recorder import after_recording
from fsw_recorder.after_recording import LOG_NAME, check, run, start, wait
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.errors import BagError
from fsw_recorder.manifest import check_files, read_manifest
from fsw_test_support.waiting import wait_until

PYTHON = f"'{sys.executable}' -c"


def test_commands_run_in_order_with_the_bag_in_their_words(tmp_path: Path) -> None:
    bag = tmp_path / "a bag"
    bag.mkdir()
    write = f"{PYTHON} 'import sys; open(sys.argv[1], chr(97)).write(sys.argv[2])' {{bag}}/out.txt"
    assert run([f"{write} one", f"{write} two"], bag) == ""
    assert (bag / "out.txt").read_text() == "onetwo"
    assert (bag / LOG_NAME).read_text().count("exit code 0") == 2


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (
            f"{PYTHON} 'print(1); print(\"no  luck\"); exit(3)'",
            "(exit code 3): no luck;",
        ),
        ("no_such_program_anywhere {bag}", "no_such_program_anywhere failed (not started): "),
        (f"{PYTHON} 'exit(1)'", "printed nothing"),
    ],
)
def test_a_failure_is_one_line_and_ends_it(tmp_path: Path, command: str, said: str) -> None:
    failure = run([command, f'{PYTHON} \'open("{tmp_path}/late", "w")\''], tmp_path)
    assert said in failure and "\n" not in failure and LOG_NAME in failure
    assert not (tmp_path / "late").exists()


@pytest.mark.parametrize(
    ("command", "said"), [("echo 'x", "No closing quotation"), (" ", "is empty")]
)
def test_invalid_on_finished_command_is_refused_at_start(command: str, said: str) -> None:
    with pytest.raises(BagError, match=said):
        check([command])


def test_readers_wait_for_running_commands_except_from_within(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    messages: list[str] = []
    wait(tmp_path, messages.append)  # a bag without commands
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    process = start([f"{PYTHON} 'open(\"{pipe}\").read()'"], tmp_path)

    def let_it_end(text: str) -> None:
        messages.append(text)
        pipe.write_text("go on", encoding="utf-8")

    with monkeypatch.context() as within:
        within.setenv("FSW_AFTER_RECORDING", str(tmp_path))
        wait(tmp_path, messages.append)
    assert not messages
    wait(tmp_path, let_it_end)
    assert len(messages) == 1 and "exit code 0" in (tmp_path / LOG_NAME).read_text(
        encoding="utf-8"
    )
    wait(tmp_path, messages.append)
    assert len(messages) == 1 and process.wait() == 0


@pytest.mark.slow
def test_the_recorder_starts_it_and_ends_at_once(graph: Any, tmp_path: Path) -> None:
    """The bag is finished, with its manifest, when the command begins.

    The command outlives the recorder.
    """
    bag, done = tmp_path / "bag", tmp_path / "done.txt"
    code = (
        "import os, sys; open(sys.argv[2], chr(119)).write(str(sorted(os.listdir(sys.argv[1]))))"
    )
    command = f"{PYTHON} \"{code}\" {{bag}} '{done}'"
    words = [f"output:={bag}", f"on_finished:={json.dumps([command])}"]
    arguments = [word for setting in words for word in ("-p", setting)]
    publisher = graph.node.create_publisher(String, "/x", 10)
    program = graph.start("fsw_recorder.recorder_node", "--ros-args", *arguments)
    # the subscription alone may be one of an earlier test's recorder that is still known
    file = bag / "bag_0.mcap"
    graph.until(lambda: (publisher.get_subscription_count() and file.exists()) or program.poll())
    exit_code, output = graph.end(program, signal.SIGINT)
    assert exit_code == 0, output
    wait_until(lambda: done.exists() and done.read_text().endswith("]"), "the command")
    assert "manifest.json" in done.read_text() and "metadata.yaml" in done.read_text()
    manifest = read_manifest(bag)
    assert manifest is not None and check_files(bag, manifest) == []
    with BagReader(bag) as reader:
        assert reader.problems == []


def test_a_bag_that_was_moved_meanwhile_is_one_line(tmp_path: Path) -> None:
    failure = run([f"{PYTHON} 'exit(1)'"], tmp_path / "moved")
    assert "failed (exit code 1)" in failure and "\n" not in failure
    assert not (tmp_path / "moved").exists()


def test_main_says_a_failure_on_stderr(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.nice", lambda _: 0)
    assert after_recording.main([str(tmp_path), f"{PYTHON} 'exit(4)'"]) == 1
    assert "failed (exit code 4)" in capsys.readouterr().err
