"""``demo.py --live``: a weld in real time and the page beside it."""

import re
import signal

import pytest

from fsw_recorder.bag_reader import BagReader
from fsw_scenario.launcher import Launcher
from fsw_test_support.page_client import Page
from fsw_test_support.processes import kill, processes
from fsw_test_support.waiting import wait_for_text, wait_until

SHORT = "{name: short, duration_s: 4.0, controller: decentral, events: []}"
LONG = "{name: long, duration_s: 600.0, controller: decentral, events: []}"
PROGRAMME = "{name: long, phases: [{name: dwell, duration_s: 600.0}]}"


@pytest.fixture
def demo(tmp_path):
    """Starts the demonstration of a scenario; returns it with address and token of its page."""
    with Launcher(tmp_path / "log", 0) as launcher:

        def start(text):
            scenario = tmp_path / "scenario.yaml"
            scenario.write_text(text)
            out = ["--out", str(tmp_path / "weld")]
            child = launcher.start(
                "demo", "fsw.demo", ["--live", "--port", "0", "--scenario", str(scenario), *out]
            )
            url = wait_for_text(launcher, "demo", r"http://\S+")
            return child, url, wait_for_text(launcher, "demo", r"token: \S+").split()[1]

        yield start


@pytest.mark.full
def test_weld_goes_on_to_its_end_without_its_page(demo, tmp_path):
    child, url, token = demo(SHORT)
    with Page(url) as page:
        page.command(token)
        page.until("tick")
        assert kill(tmp_path, "fsw_hmi") == 1
    assert re.search(r"export ROS_DOMAIN_ID=\d+$", child.text(), re.MULTILINE)
    wait_until(lambda: "the page stays" in child.text(), "the end of the weld")
    wait_until(lambda: not processes(tmp_path, "recorder_node"), "the end of the recorder")
    with Page(url) as page:  # it outlives the weld
        assert page.seen("recording")
    child.process.send_signal(signal.SIGINT)
    wait_until(lambda: not child.running, "the end of the page")
    assert child.process.returncode == 0, child.text()
    with BagReader(tmp_path / "weld" / "bag") as bag:
        assert "/fsw/operator_action" in bag.topics()
    wait_until(lambda: not processes(tmp_path), "the end of all processes")


@pytest.mark.requirement("S34")
@pytest.mark.full
def test_what_is_killed_is_started_again_and_an_interrupt_ends_everything(demo, tmp_path):
    child, url, token = demo(LONG)
    parts = {
        "recorder": "fsw_recorder",
        "decentral": "fsw_decentral",
        "nmpc": "fsw_nmpc.",
        "hmi": "fsw_hmi",
    }
    with Page(url) as page:
        page.until("tick")
        page.seen("state", lambda frame: len(frame["controllers"]) == 2)
        assert kill(tmp_path, *parts.values()) == len(parts)
    again = "{} has ended with exit code -9 and is started again"
    wait_until(
        lambda: all(again.format(name) in child.text() for name in parts),
        "word of what was killed",
    )
    wait_until(
        lambda: all(len(processes(tmp_path, module)) == 1 for module in parts.values()),
        "what was killed",
    )
    hmi_log = tmp_path / "weld" / "log" / "hmi.log"
    wait_until(lambda: "operator's page" in hmi_log.read_text().partition("\n")[2], "the page")
    with Page(url) as page:
        page.command(token)
        page.seen(
            "state",
            lambda frame: (
                [controller["ready"] for controller in frame["controllers"]] == [True, True]
            ),
        )
    wait_until(
        (tmp_path / "weld" / "bag_1").exists, "the bag of the recorder that was started again"
    )
    assert (tmp_path / "weld" / "token").stat().st_mode & 0o077 == 0
    assert all(token not in log.read_text() for log in (tmp_path / "weld" / "log").glob("*.log"))
    child.process.send_signal(signal.SIGINT)
    wait_until(lambda: not child.running, "the end of the demonstration")
    assert child.process.returncode == 130
    assert processes(tmp_path) == []
    with BagReader(tmp_path / "weld" / "bag_1") as bag:
        bag.info()
        assert bag.problems == []


@pytest.mark.requirement("S34")
@pytest.mark.parametrize("killed", [("scenario_node",), ("supervisor_node",)], ids=" ".join)
@pytest.mark.full
def test_safe_stop_keeps_the_page_up_whatever_was_killed(demo, tmp_path, killed):
    child, url, _ = demo(PROGRAMME)
    with Page(url) as page:
        page.seen("progress")
        page.seen("state", lambda frame: frame["actual_mode"] == "auto")
        kill(tmp_path, *killed)
        if killed == ("scenario_node",):
            wait_until(lambda: "scenario has ended" in child.text(), "word of the player's end")
        page.send("safe_stop")
        stopped = page.seen("state", lambda frame: frame["actual_mode"] == "safe_stop")
        assert stopped["reason"]
        wait_until(
            lambda: "the other processes keep running" in child.text(), "word of the player's end"
        )
        for _ in range(20):
            page.until("tick")
        assert page.frames["state"]["actual_mode"] == "safe_stop"
        child.process.send_signal(signal.SIGINT)
        wait_until(lambda: not child.running, "the end of the demonstration")
    assert child.process.returncode == 130


@pytest.mark.requirement("S34")
@pytest.mark.full
def test_page_outlives_a_killed_plant(demo, tmp_path):
    child, url, _ = demo(PROGRAMME)
    with Page(url) as page:
        page.until("tick")
        kill(tmp_path, "plant_node")
        page.seen(
            "alarms", lambda frame: "measurements" in {alarm["id"] for alarm in frame["alarms"]}
        )
        wait_until(lambda: "plant has ended" in child.text(), "word of the plant's end")
        page.seen("beat")
        child.process.send_signal(signal.SIGINT)
        wait_until(lambda: not child.running, "the end of the demonstration")
    assert child.process.returncode == 130
