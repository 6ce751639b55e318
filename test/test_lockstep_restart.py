"""A supervisor dies in lockstep, or none was started as the leader.

The one that replaces it gets the graph going again, in the tick that stands.
"""

import pytest
import rclpy
from rclpy.context import Context

from fsw_control import messages_ros as convert
from fsw_control.topics_ros import STREAM
from fsw_msgs.msg import DriveFeedback, WeldCommand
from fsw_scenario.graph import STANDBY, WeldGraph
from fsw_scenario.launcher import Launcher
from fsw_scenario.scenario_file import parse
from fsw_test_support.ros_graph import Spinner, domain_id

__all__ = ["domain_id"]

SCENARIO = """
name: lockstep_restart
duration_s: 36000.0
controller: decentral
"""


class SlowGraph(WeldGraph):
    """A graph in lockstep whose time limits are of no help.

    They are longer than the test waits.
    """

    def parameter_file(self, scenario_file):
        """Content of the parameter file."""
        nodes = super().parameter_file(scenario_file)
        for name in {"fsw_supervisor", STANDBY} & nodes.keys():
            nodes[name]["ros__parameters"] |= dict.fromkeys(
                ("lockstep_deadline_s", "lockstep_shadow_wait_s"), 60.0
            )
        nodes["fsw_plant"]["ros__parameters"] |= {
            "lockstep_timeout_s": 600.0,
            "lockstep_give_up_s": 0.0,
        }
        return nodes


class Observer(Spinner):
    """Sees the commands of a graph in lockstep."""

    def __init__(self, domain):
        self.context, self.stamps_ns = Context(), []
        rclpy.init(args=[], context=self.context, domain_id=domain)
        self.node = rclpy.create_node("observer", context=self.context)
        super().__init__(self.context)
        self.executor.add_node(self.node)
        self.node.create_subscription(WeldCommand, "/fsw/command", self._on_command, STREAM)
        self.leaders = set()  # of which the actuator end has taken a command
        self.node.create_subscription(DriveFeedback, "/fsw/drives", self._on_drives, STREAM)

    def _on_command(self, message):
        self.stamps_ns.append(convert.stamp_ns(message.header.stamp))

    def _on_drives(self, message):
        state = convert.actuator_state(message)
        self.leaders |= {(state.term, state.leader)} if state.leader else set()

    def ticks(self, count):
        """Wait for so many newer ticks."""
        goal_ns = max(self.stamps_ns, default=0) + count * 100_000_000
        self.until(lambda: max(self.stamps_ns, default=0) >= goal_ns, f"{count} ticks")

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def observer(domain_id):
    """An observer in a domain of its own."""
    observer = Observer(domain_id)
    yield observer
    observer.close()


def kill(launcher, name):
    """End a process as kill -9 does."""
    process = launcher.children[name].process
    process.kill()
    process.wait()


@pytest.mark.requirement("S9")
@pytest.mark.parametrize("standby", [False, True])
def test_the_graph_continues_after_its_supervisor_was_killed(
    standby, tmp_path, domain_id, observer
):
    with Launcher(tmp_path / "log", domain_id) as launcher:
        graph = SlowGraph(
            parse(SCENARIO), tmp_path / "weld", ("nmpc",), record=False, standby=standby
        )
        graph.start(launcher)
        observer.ticks(30)
        kill(launcher, "supervisor")
        if not standby:
            file = tmp_path / "weld" / "parameters.yaml"
            arguments = ["--ros-args", "--params-file", str(file)]
            launcher.start("supervisor", "fsw_supervisor.supervisor_node", arguments)
        observer.ticks(30)


@pytest.mark.requirement("S9")
@pytest.mark.parametrize("realtime", [False, True])
def test_one_of_two_standbys_leads_when_the_plant_waits_for_a_command(
    realtime, tmp_path, domain_id, observer
):
    derived = {"fsw_supervisor": {"standby": True}}
    with Launcher(tmp_path / "log", domain_id) as launcher:
        graph = WeldGraph(
            parse(SCENARIO),
            tmp_path / "weld",
            realtime=realtime,
            record=False,
            standby=True,
            derived=derived,
        )
        graph.start(launcher)
        observer.ticks(1)
        observer.ticks(30)
        publishers = observer.node.count_publishers
        observer.until(lambda: publishers("/fsw/command") == 1, "the other one on standby")
        assert len(observer.leaders) == 1
