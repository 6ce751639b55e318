"""The goal of a weld whose answer is late, without a graph."""

from itertools import count
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from fsw import weld_ros
from fsw.errors import CommandError

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
    clock, wanted = Clock(), SimpleNamespace(answers=0, leaves=10**9)
    wanted.clock = clock

    def future(value):
        return SimpleNamespace(done=lambda: clock.polls >= wanted.answers, result=lambda: value)

    result = SimpleNamespace(result="the result")
    handle = SimpleNamespace(accepted=True, get_result_async=lambda: future(result))
    client = SimpleNamespace(
        server_is_ready=lambda: clock.polls < wanted.leaves,
        send_goal_async=lambda goal, feedback_callback: future(handle),
    )
    monkeypatch.setattr(weld_ros, "ActionClient", lambda *_: client)
    monkeypatch.setattr(weld_ros, "LogLines", lambda *_: SimpleNamespace(last=lambda: ""))
    return wanted


@pytest.mark.parametrize(("answers", "waits"), [(0, False), (POLLS - 1, False), (50, True)])
def test_a_weld_whose_goal_is_answered_late_is_followed(player, capsys, answers, waits):
    player.answers = answers
    assert weld_ros.follow(player.clock, None) == "the result"
    assert ("waiting for the scenario player's answer" in capsys.readouterr().err) == waits


def test_a_player_that_leaves_before_it_answers_is_told(player):
    player.answers, player.leaves = 10**6, 20
    with pytest.raises(CommandError, match="has left before it answered"):
        weld_ros.follow(player.clock, None)


def test_who_guards_the_weld_may_end_the_wait(player):
    player.answers = 10**6
    assert weld_ros.follow(player.clock, None, lambda: player.clock.polls > 20) is None
