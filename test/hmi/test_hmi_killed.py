"""``kill -9`` of each process of a weld, watched through the page: what it says."""

import re
import time

import pytest

from fsw_control.free_domain import free_domain
from fsw_scenario.launcher import Launcher
from fsw_scenario.scenario_file import parse
from fsw_test_support.page_client import Page
from fsw_test_support.patient_weld import PatientWeld
from fsw_test_support.waiting import wait_for_text

PROGRAMME = "{name: long, phases: [{name: dwell, duration_s: 600.0}]}"
#: in this order, and what is then said: by then the one before is missed already
SAID = {
    "scenario": ("programme", "The weld programme no longer runs"),
    "recorder": ("recorder", "The recorder no longer reports"),
    "nmpc": ("controller:nmpc", "Controller nmpc is not ready"),
    "standby": ("standby", "No supervisor stands by"),
    "decentral": ("hold", "Command held: "),
    "supervisor": ("supervisor", "No commands from the supervisor"),
    "plant": ("measurements", "No measurements: the drives are silent"),
}

#: a time of the epoch, which no person can read
EPOCH = re.compile(r"\b1[6-9]\d{8}\b")


def texts(content):
    """All texts in a frame."""
    if isinstance(content, dict | list):
        return [
            text
            for value in (content.values() if isinstance(content, dict) else content)
            for text in texts(value)
        ]
    return [content] if isinstance(content, str) else []


@pytest.fixture
def launcher(tmp_path):
    with free_domain() as domain, Launcher(tmp_path / "log", domain) as launcher:
        yield launcher


@pytest.mark.full
def test_each_process_that_is_killed_is_missed_and_one_that_is_back_is_not(launcher, tmp_path):
    launcher.start("hmi", "fsw_hmi.main", ["--port", "0"])
    url = wait_for_text(launcher, "hmi", r"http://\S+")
    graph = PatientWeld(
        parse(PROGRAMME), tmp_path / "weld", ["decentral", "nmpc"], realtime=True, standby=True
    )
    graph.start(launcher)

    def alarm_row(frame, name, state):
        return next(
            (alarm for alarm in frame["alarms"] if (alarm["id"], alarm["state"]) == (name, state)),
            None,
        )

    def alarm(name, state, count=1):
        def is_it(frame):
            alarm = alarm_row(frame, name, state)
            return alarm and alarm["count"] >= count

        return alarm_row(page.seen("alarms", is_it), name, state)

    with Page(url) as page:
        page.command(wait_for_text(launcher, "hmi", r"token: \S+").split()[1])
        page.seen(
            "state",
            lambda frame: (
                frame["actual_mode"] == "auto"
                and all(controller["ready"] for controller in frame["controllers"])
            ),
        )
        page.seen("recording", lambda frame: frame["state"] == "recording")
        for process, (name, text) in SAID.items():
            launcher.children[process].process.kill()
            begin_s = time.monotonic()
            said = alarm(name, "active")["text"]
            print(f"{process}: {said} after {time.monotonic() - begin_s:.2f} s")
            assert said.startswith(text)
            if process == "nmpc":
                assert (
                    page.ask("shelve", alarm=name, minutes=5, reason="test")["outcome"] == "done"
                )
                alarm(name, "shelved")
                assert page.ask("unshelve", alarm=name)["outcome"] == "done"
                again = launcher.children[process]
                launcher.start(process, again.program, again.arguments)
                alarm(name, "cleared")
                launcher.children[process].process.kill()
                alarm(name, "active", count=2)
        assert not [
            text for frame in page.frames.values() for text in texts(frame) if EPOCH.search(text)
        ]
