"""Swapping controllers in the running weld, by the service and by the topic."""

import itertools
import math
import sys
import unittest
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))

from builtin_interfaces.msg import Duration
from weld_under_test import Observer, WeldUnderTest, exit_codes, post_shutdown_test, stamp_ns

from fsw_control.topics_ros import LATEST
from fsw_msgs.msg import SupervisorState, WeldCommand
from fsw_msgs.srv import SwitchController

# In lockstep and with faults: test/faults.
pytestmark = pytest.mark.full
WELD = WeldUnderTest("{name: switching, duration_s: 600.0}", ("decentral", "nmpc"))
MOVE_N, MOVE_RAD_PER_S = 1000.0, 3.0 * math.tau / 60.0


@pytest.mark.launch_test
def generate_test_description():
    return WELD.launch_description()


def is_in_command(states, name):
    return (
        bool(states) and states[-1].actual_controller == name and states[-1].applied.source == name
    )


def switch(eye, name):
    request = SwitchController.Request(name=name, strictness=SwitchController.Request.BEST_EFFORT)
    request.timeout = Duration(sec=20)
    return eye.call(SwitchController, "fsw/switch_controller", request)


class TestSwitching(unittest.TestCase):
    def test_swap_there_and_back_without_a_bump(self, domain):
        with Observer(domain) as eye:
            states = eye.listen(SupervisorState, "fsw/supervisor/state", LATEST)
            commands = eye.listen(WeldCommand, "fsw/command")
            eye.until(lambda: is_in_command(states, "decentral"), "decentral in command")
            answer = switch(eye, "nmpc")
            self.assertTrue(answer.ok, answer.message)
            eye.until(lambda: commands and commands[-1].source == "nmpc", "commands of nmpc")
            eye.until(lambda: is_in_command(states, "nmpc"), "nmpc in command")
            answer = switch(eye, "decentral")
            self.assertTrue(answer.ok, answer.message)
            eye.until(lambda: commands[-1].source == "decentral", "commands of decentral")
            eye.until(lambda: is_in_command(states, "decentral"), "decentral in command again")
        stamps = [stamp_ns(command) for command in commands]
        self.assertEqual(stamps, sorted(set(stamps)), "one command per tick")
        for before, after in itertools.pairwise(commands):
            self.assertLessEqual(abs(after.axial_force - before.axial_force), MOVE_N + 1e-6)
            self.assertLessEqual(
                abs(after.spindle_speed - before.spindle_speed), MOVE_RAD_PER_S + 1e-9
            )

    def test_unknown_controller_is_refused_with_the_reason(self, domain):
        with Observer(domain) as eye:
            states = eye.listen(SupervisorState, "fsw/supervisor/state", LATEST)
            eye.until(lambda: states, "the supervisor's state")
            before = states[-1].target_controller
            answer = eye.call(
                SwitchController,
                "fsw/switch_controller",
                SwitchController.Request(
                    name="nobody", strictness=SwitchController.Request.STRICT
                ),
            )
            self.assertFalse(answer.ok)
            self.assertIn("nobody", answer.message)
            self.assertEqual(states[-1].target_controller, before)


@post_shutdown_test()
class TestAfterShutdown(unittest.TestCase):
    def test_all_have_ended_cleanly(self, proc_info):
        codes = exit_codes(proc_info)
        codes.pop("scenario")
        self.assertEqual(codes, dict.fromkeys(("plant", "decentral", "nmpc", "supervisor"), 0))
