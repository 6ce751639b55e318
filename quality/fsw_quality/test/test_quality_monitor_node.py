"""The monitor as a node: it joins the topics of a weld, and publishes what it finds as a topic and as diagnostics."""

import math

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context

from fsw_control import messages_ros as convert
from fsw_control.contract import Command
from fsw_control.topics_ros import STREAM, sensor_publishers
from fsw_control.weld import TICK_NS
from fsw_msgs.msg import DriveFeedback, WeldCommand, WeldEstimate, WeldFinding, WeldHealth
from fsw_quality.diagnosis import Judged
from fsw_quality.monitor_node import MonitorNode, Watching
from fsw_test_support.ros_graph import Spinner, domain_id  # noqa: F401
from fsw_test_support.watched_weld import samples

pytestmark = pytest.mark.slow
WELD = samples(60.0, excited=False)
STUCK = "fsw_monitor: torque_stuck"


class Graph(Spinner):
    """The monitor, and a node that stands in for plant and supervisor."""

    def __init__(self, domain):
        self.context = Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        super().__init__(self.context)
        self.monitor = MonitorNode(context=self.context)
        self.node = node = rclpy.create_node("others", context=self.context)
        self.health, self.parts, self.tick = [], {}, 0
        node.create_subscription(WeldHealth, "fsw/monitor/health", self.health.append, STREAM)
        node.create_subscription(DiagnosticArray, "/diagnostics", self.on_diagnostics, STREAM)
        self.drives = node.create_publisher(DriveFeedback, "fsw/drives", STREAM)
        self.commands = node.create_publisher(WeldCommand, "fsw/command", STREAM)
        self.sensors = sensor_publishers(node)
        for one in (self.monitor, node):
            self.executor.add_node(one)
        self.until(
            lambda: self.drives.get_subscription_count() and self.commands.get_subscription_count()
        )

    def spin(self):
        self.executor.spin_once(timeout_sec=0.001)

    def on_diagnostics(self, message):
        for one in message.status:
            self.parts[one.name] = one

    def weld(self, **values):
        """Publish a tick."""
        one = WELD[self.tick % len(WELD)]._replace(**values)
        self.tick += 1
        stamp_ns, command = self.tick * TICK_NS, Command(one.force_kn, one.speed_rpm)
        self.drives.publish(convert.drives_message(command, stamp_ns))
        for name, value in (
            ("depth", one.depth_mm),
            ("torque", one.torque_nm),
            ("thermocouple", one.temperature_c),
        ):
            self.sensors[name].publish(convert.sensor_message(name, value, stamp_ns))
        self.commands.publish(convert.command_message(command, stamp_ns, "decentral"))
        for _ in range(8):  # so that the queues do not run over
            self.spin()

    def weld_until(self, condition, **values):
        def holds():
            self.weld(**values)
            return condition()

        self.until(holds)

    def code(self, part):
        """Code and fields of an entry of the monitor."""
        values = getattr(self.parts.get(f"fsw_monitor: {part}"), "values", ())
        return {pair.key: pair.value for pair in values if pair.key.startswith("code")}

    def level(self, name):
        return self.parts[name].level if name in self.parts else None


@pytest.fixture
def graph(domain_id):  # noqa: F811
    one = Graph(domain_id)
    yield one
    one.executor.shutdown()
    for node in (one.monitor, one.node):
        node.destroy_node()
    one.context.try_shutdown()


def test_it_waits_for_a_weld_then_publishes_code_and_words_until_the_fault_is_over(graph):
    graph.until(lambda: graph.code("watch") == {"code": Watching.NOTHING})
    graph.weld_until(
        lambda: (
            graph.health
            and WeldFinding.TORQUE_STUCK in [one.cause for one in graph.health[-1].findings]
        ),
        torque_nm=1052.9,
    )
    found = graph.health[-1]
    (finding,) = found.findings
    assert finding.alarm and finding.size >= 1.0 and math.isnan(finding.log_likelihood)
    assert found.process == "paper" and found.learning
    assert set(found.gain_names) == {"torque", "depth", "heat"} and all(
        map(math.isfinite, found.gains)
    )
    assert len(found.estimates) == 10 and all(
        one.reason == WeldEstimate.LEARNING and math.isnan(one.size) for one in found.estimates
    )
    graph.until(lambda: graph.level(STUCK) == DiagnosticStatus.WARN)
    assert {"tool_wear", "dead_time"} <= {
        pair.key for pair in graph.parts["fsw_monitor: watch"].values
    }
    fact = graph.code("torque_stuck")
    assert (fact["code"], fact["code: cause"]) == (Judged.ALARM, "torque_stuck")
    assert float(fact["code: cause: size"]) >= 1.0
    assert {pair.key: pair.value for pair in graph.parts[STUCK].values}["action"]
    graph.weld_until(lambda: graph.level(STUCK) == DiagnosticStatus.OK)


def test_samples_that_are_no_numbers_are_no_weld(graph):
    graph.weld_until(lambda: graph.tick > 40, depth_mm=math.nan)
    graph.until(lambda: graph.code("watch") == {"code": Watching.NOTHING})
    assert not graph.health
