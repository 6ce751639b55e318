"""A programme that is aborted.

The safe stop is carried out, and the weld goes on without its player.
"""

import sys
import unittest
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))

from action_msgs.srv import CancelGoal
from weld_under_test import Observer, WeldUnderTest, exit_codes, post_shutdown_test

import fsw_scenario
from fsw_control.topics_ros import LATEST
from fsw_msgs.msg import ShoulderDepth, SupervisorState
from fsw_scenario.launcher import ABORTED

# Beside the page: test/hmi/test_hmi_weld.py.
pytestmark = pytest.mark.full
SCENARIO = Path(fsw_scenario.__file__).parent / "scenarios" / "canister_weld.yaml"
WELD = WeldUnderTest(SCENARIO.read_text(encoding="utf-8"), ("decentral",))


@pytest.mark.launch_test
def generate_test_description():
    return WELD.launch_description()


class TestAbort(unittest.TestCase):
    def test_plant_and_supervisor_outlive_the_player(self, domain):
        with Observer(domain) as eye:
            states = eye.listen(SupervisorState, "/fsw/supervisor/state", LATEST)
            depths = eye.listen(ShoulderDepth, "/fsw/depth")
            eye.until(lambda: states and states[-1].actual_mode == "auto", "automatic control")
            answer = eye.call(
                CancelGoal, "/fsw/run_weld/_action/cancel_goal", CancelGoal.Request()
            )
            self.assertEqual(len(answer.goals_canceling), 1)
            eye.until(lambda: states[-1].actual_mode == "safe_stop", "the safe stop")
            eye.until(
                lambda: "fsw_scenario" not in eye.node.get_node_names(), "the end of the player"
            )
            seen = len(depths)
            eye.until(lambda: len(depths) >= seen + 30, "three seconds more of the weld")
            self.assertEqual(states[-1].actual_mode, "safe_stop")


@post_shutdown_test()
class TestAfterShutdown(unittest.TestCase):
    def test_only_the_player_failed(self, proc_info):
        self.assertEqual(
            exit_codes(proc_info),
            {"scenario": ABORTED} | dict.fromkeys(("plant", "decentral", "supervisor"), 0),
        )
