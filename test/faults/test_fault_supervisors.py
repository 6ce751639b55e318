"""Supervisors and the recorder die or stop, and strangers command.

What reached the plant, tick by tick.
"""

from __future__ import annotations

import signal
import time
from collections import Counter

import pytest

from fsw_control import messages_ros as convert
from fsw_control.cause import Cause
from fsw_control.contract import Command
from fsw_control.reports_ros import ERROR
from fsw_msgs.msg import WeldCommand

#: causes of a change of controller that nobody has requested
AUTOMATIC = (Cause.SWAP_FAILED, Cause.CONTROLLER_BACK, Cause.SWAP_BACK)
#: parts of the diagnostics that report who publishes commands
WRITER_PARTS = ("fsw_supervisor: command topic", "fsw_plant: commands")


def writer_statuses(weld, first):
    """Statuses of these parts, from report number ``first`` on."""
    return [
        status
        for array in weld.reports[first:]
        for status in array.status
        if status.name in WRITER_PARTS
    ]


def writer_errors(weld, first):
    """Those of them that report a foreign writer."""
    return [status for status in writer_statuses(weld, first) if status.level == ERROR]


def wait_for_no_writer_error(weld):
    """Wait for two reports of each part without an error, which the supervisor keeps for some seconds."""
    first = len(weld.reports)

    def is_clear():
        nonlocal first
        if writer_errors(weld, first):
            first = len(weld.reports)
        counts = Counter(status.name for status in writer_statuses(weld, first))
        return all(counts[part] >= 2 for part in WRITER_PARTS)

    weld.until(is_clear, "no foreign writer any more")


@pytest.mark.real_time
@pytest.mark.requirement("S11")
def test_a_foreign_writer_is_reported_and_changes_nothing(weld, table):
    first = weld.restore()
    foreign = weld.node.create_publisher(WeldCommand, "fsw/command", 10)
    reports = len(weld.reports)
    wild = convert.command_message(Command(61.0, 310.0), 1, "foreign")
    timer = weld.node.create_timer(
        0.1, lambda: foreign.publish(wild)
    )  # the others hear it once they have found it
    weld.until(lambda: writer_errors(weld, reports), what="the error on /diagnostics")
    weld.ticks(5)
    weld.node.destroy_timer(timer)
    weld.node.destroy_publisher(foreign)
    outcome = weld.outcome(first)
    outcome.assert_steady()
    outcome.assert_sources("decentral")
    assert {"decentral", "nmpc", "hold"}.issuperset(outcome.sources), (
        "no controller follows a stranger"
    )
    weld.until(
        lambda: [weld.role(name) for name in weld.supervisors].count("active") == 1, "one leader"
    )
    table.add(
        "a foreign writer on `/fsw/command`",
        "a command that the supervisor did not send",
        "error on `/diagnostics`",
        outcome,
    )


@pytest.mark.real_time
@pytest.mark.requirement("S9")
@pytest.mark.parametrize(
    "number", [pytest.param(signal.SIGKILL, marks=pytest.mark.full), signal.SIGSTOP]
)
def test_the_supervisor_falls_silent_and_the_standby_takes_over(weld, table, number):
    weld.restore()
    wait_for_no_writer_error(weld)
    reports = len(weld.reports)
    first = weld.switch("nmpc")
    weld.ticks(5)
    silent = weld.leader
    other = next(name for name in weld.supervisors if name != silent)
    weld.signal(silent, number)
    weld.until(lambda: weld.role(other) == "active", what="the takeover")
    weld.until(
        lambda: "[takeover]" in weld.launcher.children[other].text(), what="the takeover's reason"
    )
    weld.ticks(10)
    if number == signal.SIGSTOP:
        weld.signal(silent, signal.SIGCONT)
        weld.until(
            lambda: weld.role(silent) == "standby",
            f"the one that was stopped, {silent}, stepping back",
        )
    weld.ticks(10)
    outcome = weld.outcome(first)
    outcome.assert_steady(lost=3)
    outcome.assert_sources("nmpc")
    assert not writer_errors(weld, reports), "a takeover is no foreign writer"
    verb = "killed (-9)" if number == signal.SIGKILL else "stopped and continued"
    reaction = "takes over in the second, under the same controller"
    table.add(
        f"leading supervisor {verb}, with a standby",
        "standby: two ticks unanswered",
        reaction,
        outcome,
    )


@pytest.mark.requirement("S9")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_standby_falls_silent(launch, table, number):
    weld = launch(lockstep=True, standby=True)
    first = weld.restore()
    standby = next(name for name in weld.supervisors if name != weld.leader)
    weld.until(
        lambda: weld.node.count_publishers("/fsw/command") == 1, "a standby that publishes nothing"
    )
    weld.signal(standby, number)
    weld.ticks(8)
    if number == signal.SIGSTOP:
        weld.signal(standby, signal.SIGCONT)
        weld.ticks(8)
    outcome = weld.outcome(first)
    outcome.assert_steady()
    outcome.assert_sources("decentral")
    assert weld.role(standby) == "standby"
    table.add("standby killed, or stopped and continued", "–", "none needed", outcome)


@pytest.mark.requirement("S24")
@pytest.mark.parametrize(
    "number", [signal.SIGKILL, pytest.param(signal.SIGSTOP, marks=pytest.mark.full)]
)
def test_the_recorder_falls_silent(launch, table, number):
    weld = launch(lockstep=True, standby=True)
    weld.restore()
    weld.record()
    first = weld.switch("decentral")
    weld.ticks(3)
    roles = [*map(weld.roles, weld.supervisors)]
    weld.signal("recorder", number)
    states = len(weld.states)
    # the leader reports once a second: at the second report it waits for the recorder, and answers
    # afterwards
    weld.until(lambda: len(weld.states) > states + 2, "three states of the leader")
    weld.ticks(15)
    if number == signal.SIGSTOP:
        weld.signal("recorder", signal.SIGCONT)
        weld.ticks(5)
        weld.launcher.stop("recorder")
    outcome = weld.outcome(first)
    outcome.assert_steady()
    outcome.assert_sources("decentral")
    assert [*map(weld.roles, weld.supervisors)] == roles
    table.add("recorder killed, or stopped and continued", "–", "none needed", outcome)


@pytest.mark.real_time
@pytest.mark.requirement("S9")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_only_supervisor_falls_silent(behind_relay, table, number):
    weld = behind_relay
    weld.restore()
    first = weld.switch("nmpc")
    weld.ticks(5)
    before, states = max(weld.commands), len(weld.states)
    weld.signal("supervisor", number)
    if number == signal.SIGKILL:
        weld.start("supervisor")
    else:
        stopped_s = time.monotonic()
        weld.until(lambda: time.monotonic() > stopped_s + 0.8, "0.8 s")
        before = max(weld.commands)
        weld.signal("supervisor", signal.SIGCONT)
    weld.until(lambda: max(weld.commands) > before, what="the next command")
    weld.ticks(15)
    outcome = weld.outcome(first)
    outcome.assert_steady(lost=60 if number == signal.SIGKILL else 10)
    weld.until(lambda: weld.states[states:] and weld.states[-1].actual_mode == "auto", "control")
    state = weld.states[
        -1
    ]  # of a machine that stands still for some time the arbiter takes a controller for late
    of_it = [row for row, new in enumerate(weld.states) if new.leader == state.leader]
    begin = next(row for row in of_it if row >= states and weld.states[row].actual_mode == "auto")
    earlier = [weld.states[row] for row in of_it if row < begin]
    discovered = earlier and "nmpc" in [controller.name for controller in earlier[-1].controllers]
    assert state.target_controller == "nmpc" or state.cause in AUTOMATIC or not discovered, (
        "the previously active controller continues, not the configured one, "
        "if it has been found by then"
    )
    verb = (
        "killed (-9) and started again"
        if number == signal.SIGKILL
        else "stopped for 0.8 s and continued"
    )
    reaction = (
        "the plant holds; resumes from the drives' feedback with the previously active controller"
    )
    table.add(f"only supervisor {verb}", "–", reaction, outcome)
