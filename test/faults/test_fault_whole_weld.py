"""A short weld in phases is played in real time: held, resumed, aborted; supervisor and recorder die in its middle."""

from __future__ import annotations

import itertools
import signal
from math import degrees, radians

import pytest
from std_srvs.srv import Trigger

from fsw_analysis.signals import load_weld
from fsw_control import messages_ros as convert
from fsw_control import units
from fsw_control.topics_ros import LATEST, STREAM
from fsw_msgs.msg import WeldProgress, WeldReference
from fsw_msgs.srv import SetMode
from fsw_scenario.launcher import ABORTED
from fsw_scenario.weld_programme import CANISTER_DIAMETER_MM
from fsw_test_support.ros_graph import Spinner

PHASES = ["dwell", "start", "joint_line", "overlap"]
SCENARIO = """
name: short_weld
announced: true
phases:
  - {name: dwell, duration_s: 2.0}
  - {name: start, to_deg: 0.5}
  - {name: joint_line, to_deg: 1.5, set_points: [{at_s: 3.0, depth_mm: 2.7}]}
  - {name: overlap, to_deg: 2.0, set_points: [{at_s: 2.5, depth_mm: 2.66}]}
"""
SWAPS = """
events:
  - {at_deg: 0.8, switch: nmpc}
  - {at_deg: 1.2, switch: decentral}
"""


class Player:
    """The scenario player beside a weld, and what it reports."""

    def __init__(self, weld, events=""):
        self.weld, self.reports = weld, []
        self.subscription = weld.node.create_subscription(
            WeldProgress, "fsw/weld_progress", self.reports.append, STREAM
        )
        self.set_points = []
        self.stated = weld.node.create_subscription(
            WeldReference, "fsw/supervisor/reference", self.set_points.append, LATEST
        )
        self.clients = {
            name: weld.node.create_client(Trigger, f"fsw/weld/{name}") for name in ("hold", "resume", "abort")
        }
        (weld.folder / "scenario.yaml").write_text(SCENARIO + events)
        weld.start("scenario")
        self.child = weld.launcher.children["scenario"]

    def until(self, what):
        """Until the last report is of this phase or state."""
        self.weld.until(lambda: self.reports and what in (self.reports[-1].phase, self.reports[-1].state), what)

    def ask(self, name):
        answer = Spinner.call(self.weld, self.clients[name], Trigger.Request())
        return answer.success, answer.message

    def end(self):
        """The exit code, when it has ended by itself."""
        self.weld.until(lambda: not self.child.running, "the end of the player")
        self.weld.node.destroy_subscription(self.subscription)
        self.weld.node.destroy_subscription(self.stated)
        for client in self.clients.values():
            self.weld.node.destroy_client(client)
        return self.child.process.returncode

    def depth_mm(self):
        """The set-point in force."""
        return round(units.mm_from_m(self.set_points[-1].depth), 6)


@pytest.fixture
def player(weld):
    weld.restore()
    return Player(weld)


@pytest.mark.requirement("S9", "S22")
@pytest.mark.full
def test_supervisor_and_recorder_die_on_the_joint_line(weld, table):
    weld.restore()
    weld.record()
    player = Player(weld)
    player.until("joint_line")
    first = len(weld.truths)
    weld.signal("recorder", signal.SIGKILL)
    killed_ns = convert.stamp_ns(weld.truths[-1].header.stamp)
    weld.signal(weld.leader, signal.SIGKILL)
    player.until("done")
    assert player.end() == 0
    outcome = weld.outcome(first)
    outcome.assert_steady(lost=3)
    outcome.assert_sources("decentral")
    assert [phase for phase, _ in itertools.groupby(report.phase for report in player.reports)] == PHASES
    lengths = [report.length for report in player.reports]
    assert lengths == sorted(lengths)
    assert lengths[-1] == pytest.approx(radians(2.0) * units.m_from_mm(CANISTER_DIAMETER_MM) / 2.0)
    recorded = load_weld(weld.bag)
    assert killed_ns - recorded.stamp_ns[-1] < 1_000_000_000
    assert (recorded.stamp_ns[1:] - recorded.stamp_ns[:-1]).max() < 200_000_000, "no tick before is lacking"
    reaction = "the standby takes over; the bag ends within the second before"
    table.add("leading supervisor and recorder killed (-9) on the joint line", "standby", reaction, outcome)


@pytest.mark.full
def test_the_controller_is_swapped_and_swapped_back_on_the_joint_line(weld):
    first = weld.restore()
    player = Player(weld, SWAPS)
    angles = {}
    for controller in ("nmpc", "decentral"):
        player.until("joint_line")
        weld.until(lambda name=controller: weld.states[-1].target_controller == name, f"{controller} to be chosen")
        angles[controller] = degrees(player.reports[-1].angle)
        assert (player.reports[-1].phase, weld.states[-1].actual_mode) == ("joint_line", "auto")
    assert 0.6 < angles["nmpc"] < 1.0 and 1.0 < angles["decentral"] < 1.4, angles  # told once a second: 0.16 deg
    player.until("done")
    assert player.end() == 0
    outcome = weld.outcome(first)
    outcome.assert_steady(lost=0)
    outcome.assert_sources("decentral", "nmpc", "decentral")


def test_a_held_weld_stands_still_until_it_is_resumed(weld, player):
    player.until("joint_line")
    assert player.ask("resume") == (False, "refused: the weld is running; it must be held")
    assert player.ask("hold")[0]
    player.until("held")
    held = player.reports[-1]
    weld.ticks(60)
    assert player.ask("hold") == (False, "refused: the weld is held; it must be running")
    now = player.reports[-1]
    assert (now.state, now.angle, now.length, now.time_left) == ("held", held.angle, held.length, held.time_left)
    assert player.depth_mm() == 2.66, "the set-points that were sent ahead are void"
    assert player.ask("resume")[0]
    player.until("joint_line")
    weld.until(lambda: player.depth_mm() == 2.7, "the set-point that was put off")
    assert player.reports[-1].phase == "joint_line"
    player.until("done")
    assert player.end() == 0


@pytest.mark.parametrize("first", ["", "hold"])
def test_an_aborted_weld_leads_to_the_safe_stop(weld, player, first):
    player.until("start")
    if first:
        assert player.ask(first)[0]
    done, words = player.ask("abort")
    assert done and words.startswith("aborted in phase start at 0.")
    weld.until(lambda: weld.states[-1].actual_mode == "safe_stop", "the safe stop")
    assert player.end() == ABORTED
    assert player.reports[-1].state == "aborted"
    last = player.child.text().strip().splitlines()[-1]
    assert last.startswith("scenario: the weld is aborted in phase start at 0.") and "safe_stop" in last
    acknowledge = weld.node.create_client(Trigger, "fsw/acknowledge")
    assert Spinner.call(weld, acknowledge, Trigger.Request()).success
    mode = weld.node.create_client(SetMode, "fsw/set_mode")
    weld.call(mode, SetMode.Request(mode="auto"))
