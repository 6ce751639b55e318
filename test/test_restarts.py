"""Parts of a weld are killed and started again after its set-points have changed.

All follow those in force.
"""

import pytest
import rclpy
from rclpy.context import Context

from fsw.main import main
from fsw_control import messages_ros as convert
from fsw_control.topics_ros import LATEST, STREAM
from fsw_msgs.msg import WeldCommand, WeldReference
from fsw_scenario.graph import STANDBY
from fsw_scenario.launcher import Launcher
from fsw_scenario.scenario_file import parse
from fsw_test_support.patient_weld import PatientWeld
from fsw_test_support.ros_graph import Spinner, domain_id
from fsw_test_support.waiting import wait_until

__all__ = ["domain_id"]

SCENARIO = """
name: restarts
duration_s: 600.0
controller: decentral
events:
  - {at_s: 1.0, reference: {depth_mm: 2.70}}
"""


class Weld(Spinner):
    """A weld in real time whose parts can be killed, and what its nodes say that they follow."""

    def __init__(self, folder, domain, launcher, standby):
        self.launcher = launcher
        graph = PatientWeld(
            parse(SCENARIO),
            folder / "weld",
            ("nmpc",),
            realtime=True,
            record=False,
            standby=standby,
        )
        graph.start(launcher)
        self.arguments = ["--ros-args", "--params-file", str(folder / "weld" / "parameters.yaml")]
        self.context = Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        self.node = rclpy.create_node("observer", context=self.context)
        super().__init__(self.context)
        self.executor.add_node(self.node)
        self.follows, self.commands = {}, []
        for name in ("decentral", "nmpc", "supervisor"):
            self.node.create_subscription(
                WeldReference,
                f"/fsw/{name}/reference",
                lambda m, n=name: self.follows.update({n: m}),
                LATEST,
            )
        self.node.create_subscription(WeldCommand, "/fsw/command", self.commands.append, STREAM)

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()

    def seen(self):
        return f"followed: {self.depths()}"

    def depths(self):
        return {
            name: round(convert.reference(message).depth_mm, 6)
            for name, message in self.follows.items()
        }

    def until_all_follow(self, depth_mm, *names):
        names = names or ("decentral", "nmpc", "supervisor")
        self.until(
            lambda: all(self.depths().get(name) == depth_mm for name in names), f"{depth_mm} mm"
        )

    def ticks(self, count):
        goal = len(self.commands) + count
        self.until(lambda: len(self.commands) >= goal, f"{count} commands")

    def kill(self, name):
        process = self.launcher.children[name].process
        process.kill()
        process.wait()
        self.follows.pop(name if name != "standby" else "supervisor", None)

    def start(self, name):
        module = (
            "fsw_supervisor.supervisor_node"
            if name in ("supervisor", "standby")
            else f"fsw_{name}.{name}_node"
        )
        renamed = ["-r", f"__node:={STANDBY}"] if name == "standby" else []
        self.launcher.start(name, module, [*self.arguments, *renamed])

    def restart(self, name, depth_mm):
        """Kill a part; the one started in its place follows the set-point in force."""
        self.kill(name)
        self.start(name)
        self.until_all_follow(depth_mm, name)

    @property
    def source(self):
        """Who has commanded last."""
        return self.commands[-1].source if self.commands else ""

    def role(self, name):
        return self.launcher.children[name].text().rpartition("role: ")[2].split("\n")[0].strip()


@pytest.fixture
def make_weld(tmp_path, domain_id):
    """Makes a weld that has reached its second set-point, in a domain that is its own."""
    welds = []
    with Launcher(tmp_path / "log", domain_id) as launcher:

        def make(standby):
            welds.append(Weld(tmp_path, domain_id, launcher, standby))
            welds[0].until_all_follow(2.7)
            return welds[0]

        yield make
        for weld in welds:
            weld.close()


def until_shown(capsys, depth_mm):
    """Ask for the status until it has this set-point.

    Where the machine stands still, it hears of it too late.
    """

    def is_shown():
        main(["status", "--timeout", "20"])
        return f"set-point {depth_mm} mm" in capsys.readouterr().out

    wait_until(is_shown, f"a status with {depth_mm} mm")


def obeyed(weld, capsys, condition, *arguments):
    """Ask until a condition holds.

    Where the machine stands still, a request is refused or lost with its leader.
    """
    while not condition():
        main([*arguments, "--timeout", "20"])
        capsys.readouterr()
        goal = len(weld.commands) + 20
        weld.until(lambda goal=goal: condition() or len(weld.commands) > goal, " ".join(arguments))


def set_depth(weld, capsys, depth_mm):
    """Ask for a depth until all follow it."""
    names = ("decentral", "nmpc", "supervisor")
    followed = dict.fromkeys(names, depth_mm)
    obeyed(weld, capsys, lambda: weld.depths() == followed, "reference", "--depth", str(depth_mm))


def assert_stays(weld, capsys, depth_mm):
    """All follow one depth, and go on doing so."""
    weld.ticks(10)
    assert set(weld.depths().values()) == {depth_mm}
    until_shown(capsys, depth_mm)


@pytest.mark.requirement("S21")
@pytest.mark.full
def test_a_controller_that_is_started_again_follows_the_set_point_in_force(make_weld, capsys):
    weld = make_weld(standby=False)
    weld.restart("nmpc", 2.7)
    obeyed(weld, capsys, lambda: weld.source == "nmpc", "switch", "nmpc", "--wait", "20")
    until_shown(capsys, 2.7)
    set_depth(weld, capsys, 2.72)
    weld.restart("decentral", 2.72)
    assert_stays(weld, capsys, 2.72)


@pytest.mark.requirement("S21")
@pytest.mark.full
def test_a_supervisor_that_is_started_again_knows_the_set_point_in_force(make_weld, capsys):
    """Without a standby: the sender of the set-point has left, only the controllers know it."""
    weld = make_weld(standby=False)
    set_depth(weld, capsys, 2.72)
    weld.restart("supervisor", 2.72)
    assert_stays(weld, capsys, 2.72)


@pytest.mark.requirement("S21", "S25")
@pytest.mark.full
def test_set_point_and_safe_stop_outlive_the_supervisors(make_weld, capsys):
    """The set-point those that replace each other, the safe stop even the last of them."""
    weld = make_weld(standby=True)
    weld.until(lambda: weld.role("standby") == "standby", "the standby")
    set_depth(weld, capsys, 2.72)
    for _ in range(2):
        supervisors = ("supervisor", "standby")
        dies, takes_over = (
            supervisors if weld.role("supervisor") == "active" else reversed(supervisors)
        )
        weld.kill(dies)
        weld.until(lambda name=takes_over: weld.role(name) == "active", "the takeover")
        weld.until_all_follow(2.72, "supervisor")
        weld.start(dies)
        weld.until(lambda name=dies: weld.role(name) == "standby", "the one that was killed")
    assert_stays(weld, capsys, 2.72)

    obeyed(weld, capsys, lambda: weld.source == "safe_stop", "mode", "safe_stop")
    reported = [
        "safe_stop"
    ] * 5  # until then, those who remember it for the next supervisors may not have heard of it
    weld.until(
        lambda: [message.source for message in weld.commands[-5:]] == reported,
        "a safe stop in force",
    )
    for name in ("supervisor", "standby"):
        weld.kill(name)
    before = len(weld.commands)
    for name in ("supervisor", "standby"):
        weld.start(name)
    weld.ticks(20)
    assert {message.source for message in weld.commands[before:]} == {"safe_stop"}
