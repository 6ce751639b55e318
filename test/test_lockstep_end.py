"""How the graph ends: cleanly, whoever ends it and when."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context

from fsw_analysis.signals import load_weld
from fsw_control.free_domain import free_domain
from fsw_control.topics_ros import LATCHED
from fsw_msgs.msg import WeldReference
from fsw_scenario.graph import WeldGraph
from fsw_scenario.launcher import Launcher, LaunchError
from fsw_scenario.scenario_file import load
from fsw_scenario.scenario_node import main as play
from fsw_test_support.waiting import PATIENCE_S, has_ended, wait_for_text

WORKSPACE = Path(__file__).resolve().parent.parent
NODES = ("recorder", "plant", "decentral", "supervisor")


@pytest.mark.parametrize(
    "signs",
    [
        pytest.param((signal.SIGINT,), id="Ctrl-C", marks=pytest.mark.full),
        pytest.param((signal.SIGTERM,), id="SIGTERM", marks=pytest.mark.full),
        pytest.param((signal.SIGINT, signal.SIGINT), id="Ctrl-C from terminal and launch"),
    ],
)
def test_every_process_ends_cleanly_and_the_bag_is_whole(signs, tmp_path):
    scenario = load("reference_tracking")
    with free_domain() as domain, Launcher(tmp_path / "log", domain, PATIENCE_S) as launcher:
        graph = WeldGraph(scenario, tmp_path / "weld")
        player = graph.start(launcher)
        # many more than must be recorded: on a busy machine the recorder is behind when it is
        # ended
        launcher.wait_until(
            lambda: player.status().get("tick", 0) >= 300, PATIENCE_S, "so many ticks"
        )
        for child in launcher.children.values():
            for sign in signs:
                child.process.send_signal(sign)
        for child in launcher.children.values():
            child.process.wait(PATIENCE_S)
        for name in NODES:
            child = launcher.children[name]
            assert "Traceback" not in child.text(), (name, child.text())
        codes = [child.process.returncode for child in launcher.children.values()]
        # Fast DDS may not let one of those leave that leave at once: see light_node_ros.py
        assert sorted(codes)[1:] == [0] * (len(codes) - 1), codes
        assert min(codes) in (0, -signal.SIGALRM), "a requested stop is no failure"
        assert "stopped before" in player.text()
    signals = load_weld(graph.bag)
    assert signals.problems == []
    assert signals.n_ticks > 20


@pytest.mark.full
def test_dead_process_is_reported_and_the_others_end(tmp_path):
    with free_domain() as domain, Launcher(tmp_path / "log", domain, PATIENCE_S) as launcher:
        graph = WeldGraph(load("reference_tracking"), tmp_path / "weld")
        began = []

        def progress(share):
            if share > 0.01 and not began:
                began.append(share)
                launcher.children["plant"].process.kill()

        with pytest.raises(LaunchError, match=r"plant .* code -9\b"):
            graph.run(launcher, progress)
    assert not any(child.running for child in launcher.children.values())


def processes_with(text):
    lines = []
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and text.encode() in (entry / "cmdline").read_bytes():
                lines.append(int(entry.name))
        except OSError:
            continue
    return lines


@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
@pytest.mark.parametrize(
    ("sign", "code"),
    [pytest.param(signal.SIGTERM, 130, marks=pytest.mark.full), (signal.SIGKILL, -signal.SIGKILL)],
)
def test_the_demonstration_leaves_no_process_behind(sign, code, tmp_path):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "fsw.demo", "--controller", "decentral", "--out", str(out)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    with (tmp_path / "printed").open("wb") as printed:
        demo = subprocess.Popen(
            command, stdout=printed, stderr=printed, env=environment, cwd=WORKSPACE
        )
    status = out / "reference_tracking" / "decentral" / "log" / "scenario.status"
    try:
        end = time.monotonic() + PATIENCE_S
        while not status.exists():
            assert time.monotonic() < end, "the weld has not begun"
            with pytest.raises(subprocess.TimeoutExpired):
                demo.wait(0.05)
        assert len(processes_with(str(out))) > 4
        demo.send_signal(sign)
        assert demo.wait(PATIENCE_S) == code
    finally:
        demo.kill()
        demo.wait()
    for pid in processes_with(str(out)):
        assert has_ended(pid), f"process {pid} has not ended"
    assert not processes_with(str(out))


def test_player_alone_gives_up_with_one_clear_line(tmp_path):
    with free_domain() as domain, Launcher(tmp_path, domain, PATIENCE_S) as launcher:
        player = launcher.start(
            "player",
            "fsw_scenario.scenario_node",
            ["quick", "--ros-args", "-p", "silence_timeout_s:=1.0"],
        )
        player.process.wait(PATIENCE_S)
        assert player.process.returncode == 1
        assert re.search(r"no 1 controllers .* 1 s\b", player.text())


def test_player_waits_for_controllers_only(tmp_path):
    arguments = ["quick", "--ros-args", "-p", "silence_timeout_s:=3.0"]
    with free_domain() as domain, Launcher(tmp_path, domain, PATIENCE_S) as launcher:
        context = Context()
        rclpy.init(args=[], context=context, domain_id=domain)
        sender = rclpy.create_node(
            "sender", context=context
        )  # so that the recorder listens before the player starts
        sender.create_publisher(WeldReference, "fsw/reference", LATCHED)
        launcher.start("supervisor", "fsw_supervisor.supervisor_node")
        launcher.start(
            "recorder",
            "fsw_recorder.recorder_node",
            ["--ros-args", "-p", f"output:={tmp_path / 'bag'}"],
        )
        wait_for_text(launcher, "supervisor", "role: active")
        wait_for_text(launcher, "recorder", "subscribed to /fsw/reference")
        player = launcher.start("player", "fsw_scenario.scenario_node", arguments)
        player.process.wait(PATIENCE_S)
        sender.destroy_node()
        context.try_shutdown()
        assert re.search(r"no 1 controllers .* 3 s\b", player.text())


def test_a_second_player_leaves_the_set_points_of_the_first_alone(tmp_path):
    with free_domain() as domain, Launcher(tmp_path, domain, PATIENCE_S) as launcher:
        launcher.start("decentral", "fsw_decentral.decentral_node")
        launcher.start("first", "fsw_scenario.scenario_node", ["quick"])
        wait_for_text(launcher, "first", "playing quick")
        arguments = ["reference_tracking", "--ros-args", "-p", "silence_timeout_s:=3.0"]
        second = launcher.start("second", "fsw_scenario.scenario_node", arguments)
        second.process.wait(PATIENCE_S)
        assert second.process.returncode == 1
        assert re.search(r"another scenario player .* 3 s\b", second.text())
        assert "playing" not in second.text()


def test_player_without_its_scenario(tmp_path):
    with free_domain() as domain, Launcher(tmp_path, domain, PATIENCE_S) as launcher:
        player = launcher.start("player", "fsw_scenario.scenario_node", ["nothing_there"])
        player.process.wait(PATIENCE_S)
        assert player.process.returncode == 2
        assert "scenario nothing_there" in player.text()
        assert player.text().count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["quick", "--ros-args", "-p", "silence_timeout_s:=0.0"], "silence_timeout_s"),
        (["quick", "surplus"], "unknown arguments surplus"),
    ],
)
def test_player_with_bad_arguments(arguments, words, monkeypatch, capfd):
    with free_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        assert play(["player", *arguments]) == 2
    printed = "".join(capfd.readouterr())
    assert words in printed and printed.count("\n") == 1
