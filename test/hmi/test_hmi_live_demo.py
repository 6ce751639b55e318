"""``demo.py --live``: a weld in real time and the page beside it."""

import os
import signal
import time
from pathlib import Path

import pytest

from fsw_experiment.launcher import Launcher
from fsw_recorder.bag_reader import BagReader
from fsw_test_support.page_client import Page

SCENARIO = """
name: short
duration_s: {duration_s}
controller: decentral
events: []
"""


def processes(folder):
    """Processes whose parameters or logs are in a folder."""
    found = []
    for one in Path("/proc").glob("[0-9]*"):
        try:
            if str(folder) in (one / "cmdline").read_bytes().decode(errors="replace"):
                found.append(int(one.name))
        except OSError:
            pass
    return found


@pytest.fixture
def demo(tmp_path):
    """Starts the demonstration for so many seconds of weld; returns it with address and token of its page."""
    with Launcher(tmp_path / "log", 0) as launcher:

        def start(duration_s):
            scenario = tmp_path / "short.yaml"
            scenario.write_text(SCENARIO.format(duration_s=duration_s))
            out = ["--out", str(tmp_path / "weld")]
            child = launcher.start(
                "demo", "fsw_experiment.demo", ["--live", "--port", "0", "--scenario", str(scenario), *out]
            )
            url = launcher.wait_for_text("demo", r"http://\S+")
            return child, url, launcher.wait_for_text("demo", r"token: \S+").split()[1]

        yield start


def until(condition, what):
    end_s = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end_s, what
        time.sleep(0.02)


def test_weld_goes_on_to_its_end_without_its_page(demo, tmp_path):
    child, url, token = demo(4.0)
    with Page(url) as page:
        page.command(token)
        page.until("tick")
        page.seen("state", lambda frame: len(frame["controllers"]) == 2)
        (server,) = [one for one in processes(tmp_path) if "fsw_hmi" in Path(f"/proc/{one}/cmdline").read_text()]
        os.kill(server, signal.SIGKILL)
    until(lambda: "the page has ended, the weld goes on" in child.text(), "word of the page's end")
    until(lambda: not child.running, "the end of the weld")
    assert (child.process.returncode, "the weld is over" in child.text()) == (0, True), child.text()
    with BagReader(tmp_path / "weld" / "bag") as bag:
        assert "/fsw/operator_action" in bag.topics()
    until(lambda: not processes(tmp_path), "the end of all processes")


def test_interrupt_ends_everything(demo, tmp_path):
    child, url, _ = demo(600.0)
    with Page(url) as page:
        page.until("tick")
        child.process.send_signal(signal.SIGINT)
        until(lambda: not child.running, "the end of the demonstration")
    assert child.process.returncode == 130
    assert processes(tmp_path) == []
    with BagReader(tmp_path / "weld" / "bag") as bag:
        assert bag.info().problems == []


def test_token_is_kept_from_others(demo, tmp_path):
    _, _, token = demo(600.0)
    file = tmp_path / "weld" / "token"
    assert file.stat().st_mode & 0o077 == 0
    assert all(token not in log.read_text() for log in (tmp_path / "weld" / "log").glob("*.log"))
