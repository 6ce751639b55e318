"""A safe stop outlasts whatever supervisors and plant do: judged by what acts at the plant."""

from __future__ import annotations

import signal
import time

import pytest

from fsw_control import messages_ros as convert
from fsw_msgs.msg import DriveFeedback
from fsw_msgs.srv import SetMode

pytestmark = pytest.mark.real_time

TICKS = 40
#: longer than a supervisor waits for the effect of a request
_ANSWER_S = 5.0


class Stopped:
    """A weld with two supervisors, what its plant reports, and an operator."""

    def __init__(self, weld):
        self.weld, self.reports = weld, []
        self.subscription = weld.node.create_subscription(
            DriveFeedback, "fsw/drives", self.reports.append, 100
        )
        self.modes = weld.node.create_client(SetMode, "fsw/set_mode")
        weld.restore()

    @property
    def actuator(self):
        return self.reports[-1].actuator

    def ask(self, mode):
        """Ask for a mode; a future of the answer."""
        self.weld.until(self.modes.service_is_ready, "the service")
        return self.modes.call_async(SetMode.Request(mode=mode))

    def confirm(self, mode):
        """Ask for a mode until it is confirmed.

        A request to a supervisor that has died is not answered.
        """
        while True:
            request, due_s = self.ask(mode), time.monotonic() + _ANSWER_S
            self.weld.until(
                lambda request=request, due_s=due_s: request.done() or time.monotonic() > due_s,
                "the answer",
            )
            if request.done() and request.result().ok:
                return
            if mode == "hold" and self.actuator.stop.stopped:
                # on a busy machine the plant's watchdog is faster than the start of a supervisor
                return

    def assert_stays(self):
        """Nothing but the safe stop acts, and no force is raised, while control would have time to come back."""
        self.weld.until(
            lambda: self.reports and self.actuator.stop.stopped, "the stop at the plant"
        )
        self.weld.until(
            lambda: self.actuator.source == "safe_stop", "a leader that carries it out"
        )
        first = len(self.reports)
        self.weld.until(lambda: len(self.reports) >= first + TICKS, f"{TICKS} measurements")
        after = self.reports[first:]
        sources = {report.actuator.source for report in after}
        assert sources - {""} == {"safe_stop"}, (
            "no source: the plant's own ramp, while no supervisor lives"
        )
        assert all(report.actuator.stop.stopped for report in after)
        assert max(report.axial_force for report in after) <= after[0].axial_force + 1.0

    def other(self, name):
        return next(supervisor for supervisor in self.weld.supervisors if supervisor != name)


@pytest.fixture
def stopped(launch):
    """A weld in real time with a standby, in control.

    Each test has its own, as cooled copper stays cold.
    """
    return Stopped(launch(fresh=True, standby=True))


@pytest.mark.requirement("S25")
def test_a_stop_in_a_pause_of_the_measurements_outlasts_its_leader(stopped):
    weld = stopped.weld
    leader = weld.leader
    weld.signal("plant", signal.SIGSTOP)
    request = stopped.ask("safe_stop")
    weld.until(request.done, "the answer")
    assert not request.result().ok, "the plant has confirmed nothing"
    weld.signal(leader, signal.SIGKILL)
    weld.start(leader)
    weld.until(lambda: weld.role(leader) in ("active", "standby"), "the new supervisor")
    weld.signal("plant", signal.SIGCONT)
    stopped.assert_stays()


@pytest.mark.requirement("S25")
def test_a_stop_is_not_outvoted_by_a_leader_that_was_suspended(stopped):
    """The leader before continues after a fresh one has accepted the stop."""
    weld = stopped.weld
    old = weld.leader
    fresh = stopped.other(old)
    weld.signal(fresh, signal.SIGKILL)
    weld.signal(old, signal.SIGSTOP)
    weld.start(fresh)
    weld.until(lambda: weld.role(fresh) == "active", "the takeover")
    stopped.confirm("safe_stop")
    weld.signal(old, signal.SIGCONT)
    stopped.assert_stays()


@pytest.mark.requirement("S25")
def test_a_stop_that_is_confirmed_outlasts_both_supervisors(stopped):
    weld = stopped.weld
    stopped.confirm("safe_stop")
    for name in weld.supervisors:
        weld.launcher.children[name].process.kill()
    for name in weld.supervisors:
        weld.launcher.children[name].process.wait()
    for name in weld.supervisors:
        weld.start(name)
    stopped.assert_stays()


@pytest.mark.requirement("S25")
def test_after_the_plants_own_safe_ramp_no_supervisor_raises_the_force(stopped):
    weld = stopped.weld
    for name in weld.supervisors:
        weld.signal(name, signal.SIGKILL)
    weld.until(lambda: stopped.actuator.stop.stopped, "the watchdog of the plant")
    for name in weld.supervisors:
        weld.start(name)
    stopped.assert_stays()


@pytest.mark.requirement("S25")
def test_hold_asked_of_a_fresh_supervisor_is_in_force_when_it_is_answered(stopped):
    weld = stopped.weld
    for name in weld.supervisors:
        weld.signal(name, signal.SIGKILL)
    for name in weld.supervisors:
        weld.start(name)
    stopped.confirm("hold")
    answered_ns = weld.node.get_clock().now().nanoseconds
    weld.until(
        lambda: convert.stamp_ns(stopped.reports[-1].header.stamp) > answered_ns,
        "the next measurement",
    )
    assert stopped.actuator.source == "hold" or stopped.actuator.stop.stopped
