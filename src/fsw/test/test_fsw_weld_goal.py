"""The goal of a weld whose answer is late, without a graph."""

from itertools import count
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from fsw import graph_ros, operator_node, weld_ros
from fsw.errors import CommandError
from fsw_control.reports_ros import ERROR, OK

POLLS = 3


class Clock:
    """A node whose patience ends after some polls; ``polls`` counts all of them."""

    def __init__(self):
        self.polls, self.node = 0, SimpleNamespace(resolve_topic_name=lambda name: name)

    def wait_until(self, condition, timeout_s=None):
        for poll in count():
            if condition():
                return True
            if timeout_s is None and poll == POLLS:
                return False
            self.polls += 1
            assert self.polls < 1000


@pytest.fixture
def player(monkeypatch):
    """A player that answers after ``answers`` polls and leaves after ``leaves``."""
    clock, behaviour = Clock(), SimpleNamespace(answers=0, leaves=10**9)
    behaviour.clock = clock

    def future(value):
        return SimpleNamespace(done=lambda: clock.polls >= behaviour.answers, result=lambda: value)

    result = SimpleNamespace(result=SimpleNamespace(verdict="done", message=""))
    behaviour.ends, behaviour.aborted = (
        True,
        0,
    )  #: whether a weld ends by itself; how often one under way was aborted
    end = SimpleNamespace(
        done=lambda: behaviour.ends or (behaviour.aborted and not behaviour.hangs),
        result=lambda: result,
    )
    behaviour.hangs = False
    handle = SimpleNamespace(get_result_async=lambda: end)
    client = SimpleNamespace(
        server_is_ready=lambda: clock.polls < behaviour.leaves,
        send_goal_async=lambda goal, feedback_callback: future(handle),
    )
    monkeypatch.setattr(weld_ros, "ActionClient", lambda *_: client)

    def abort(_):
        behaviour.aborted += clock.polls >= behaviour.answers

    monkeypatch.setattr(weld_ros, "abort", abort)
    return behaviour


@pytest.mark.parametrize(("answers", "waits"), [(0, False), (POLLS - 1, False), (50, True)])
def test_a_weld_whose_goal_is_answered_late_is_followed(player, capsys, answers, waits):
    player.answers = answers
    assert weld_ros.follow(player.clock, None).verdict == "done"
    assert ("player's answer" in capsys.readouterr().err) == waits


@pytest.mark.parametrize(("terminal", "shown"), [(True, 36), (False, 5)])
def test_feedback_is_thinned_unless_printed_on_a_terminal(terminal, shown, capsys):
    lines = weld_ros.FeedbackLines(terminal)
    kpi = SimpleNamespace(depth_iae=0.0, temperature_iae=0.0)

    def feed(state, phase, left_s):
        progress = SimpleNamespace(
            state=state, phase=phase, angle=0.0, length=0.0, time_left=left_s
        )
        lines(SimpleNamespace(feedback=SimpleNamespace(progress=progress, kpi=kpi)))

    for left_s in range(60, 35, -1):  # at 60, 50 and 40 s
        feed("running", "dwell", float(left_s))
    for _ in range(10):  # time stands still: at the first
        feed("held", "dwell", 36.0)
    feed("running", "start", 36.0)
    out = capsys.readouterr().out.splitlines()
    assert len(out) == shown
    assert out[-1].split(", ")[:3] == ["running: start 0.0 deg", "0.000 m", "36.0 s left"]


def test_player_that_leaves_before_answering_is_an_error(player):
    player.answers, player.leaves = 10**6, 20
    with pytest.raises(CommandError, match="player has left"):
        weld_ros.follow(player.clock, None)


def test_weld_that_begins_after_the_guard_tripped_is_aborted(player):
    player.answers, player.ends = 50, False
    assert weld_ros.follow(player.clock, None, lambda: player.clock.polls > 20).verdict == "done"
    assert player.aborted == 1


def test_an_aborted_weld_that_does_not_end_in_time_has_no_result(player):
    player.ends, player.hangs = False, True
    assert weld_ros.follow(player.clock, None, lambda: player.clock.polls > 20) is None
    assert player.aborted == 1


@pytest.mark.parametrize(
    ("running", "expected"), [(False, KeyboardInterrupt), (True, RuntimeError)]
)
def test_ros_errors_after_sigterm_count_as_interruption(monkeypatch, running, expected):
    def spin_once(*_, **__):
        raise RuntimeError("the context is invalid")

    monkeypatch.setattr(operator_node.rclpy, "spin_once", spin_once)
    monkeypatch.setattr(operator_node.rclpy, "ok", lambda: running)
    with pytest.raises(expected):
        operator_node.Operator(None, 1.0).wait_until(lambda: False)


def test_status_names_the_reason_for_missing_measurements():
    def status(level, message):
        return SimpleNamespace(level=level, message=message)

    latest = {
        "fsw_machine: connection": status(ERROR, "refused"),
        "fsw_machine: clock": status(OK, "not known yet"),
    }
    assert graph_ros.source_rows(False, {"fsw_machine"}, latest) == [
        ("fsw_machine: connection", "refused")
    ]
    assert (
        graph_ros.source_rows(True, {"fsw_machine"}, {"fsw_machine: clock": status(OK, "in step")})
        == []
    )
    [(name, text)] = graph_ros.source_rows(False, {"fsw_machine"}, {})
    assert name == "fsw_machine" and text.endswith("lifecycle get fsw_machine")
    assert "offers any" in graph_ros.source_rows(False, set(), {})[0][1]


def test_status_shows_the_newest_reports_of_its_own_weld():
    def report(node, message):
        status = SimpleNamespace(
            name=f"{node}: connection", hardware_id="cell1/fsw", message=message
        )
        return SimpleNamespace(status=[status])

    reports = [report("cell1/fsw_machine", "connecting"), report("cell2/fsw_machine", "lost")]
    reports += [report("cell1/fsw_machine", "refused"), report("cell1/fsw_supervisor", "ok")]
    latest = graph_ros.latest_reports(reports, "/cell1", {"fsw_machine"})
    assert {name: status.message for name, status in latest.items()} == {
        "fsw_machine: connection": "refused"
    }
