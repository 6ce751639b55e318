"""A short weld in phases is played in real time: supervisor and recorder die in its middle."""

from __future__ import annotations

import itertools
import signal
from math import radians

import pytest

from fsw_analysis.signals import load_weld
from fsw_control import messages_ros as convert
from fsw_control import units
from fsw_control.topics_ros import STREAM
from fsw_msgs.msg import WeldProgress
from fsw_scenario.weld_programme import CANISTER_DIAMETER_MM

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


@pytest.mark.requirement("S9", "S22")
@pytest.mark.full
@pytest.mark.real_time
def test_supervisor_and_recorder_die_on_the_joint_line(weld, table):
    """That no more than the last second is lost, is tested in fsw_recorder."""
    weld.restore()
    weld.record()
    reports = []
    weld.node.create_subscription(WeldProgress, "fsw/weld_progress", reports.append, STREAM)
    (weld.folder / "scenario.yaml").write_text(SCENARIO)
    weld.start("scenario")
    weld.until(lambda: reports and reports[-1].phase == "joint_line", "the joint line")
    first, in_command = (
        len(weld.truths),
        weld.source(),
    )  # on a busy machine a fallback may command by now
    weld.signal("recorder", signal.SIGKILL)
    weld.signal(weld.leader, signal.SIGKILL)
    weld.until(lambda: reports[-1].state == "done", "the end of the programme")
    player = weld.launcher.children["scenario"]
    weld.until(lambda: not player.running, "the end of the player")
    assert player.process.returncode == 0
    outcome = weld.outcome(first)
    outcome.assert_steady(lost=3)
    outcome.assert_sources(in_command)
    phases = [phase for phase, _ in itertools.groupby(report.phase for report in reports)]
    assert phases == PHASES[PHASES.index(phases[0]) :], (
        "the first may be over before this node has been found"
    )
    lengths = [report.length for report in reports]
    assert lengths == sorted(lengths)
    assert lengths[-1] == pytest.approx(radians(2.0) * units.m_from_mm(CANISTER_DIAMETER_MM) / 2.0)
    recorded = load_weld(weld.bag)
    begin_ns, end_ns = recorded.stamp_ns[0], recorded.stamp_ns[-1]
    heard = [convert.stamp_ns(truth.header.stamp) for truth in weld.truths]
    assert list(recorded.stamp_ns) == [stamp for stamp in heard if begin_ns <= stamp <= end_ns], (
        "no tick is lacking"
    )
    reaction = "the standby takes over; the bag ends within the second before"
    table.add(
        "leading supervisor and recorder killed (-9) on the joint line",
        "standby",
        reaction,
        outcome,
    )
