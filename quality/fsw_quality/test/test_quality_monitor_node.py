"""The monitor as a node.

It joins the topics of a weld, and publishes what it finds as a topic and as diagnostics.
"""

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
        for member in (self.monitor, node):
            self.executor.add_node(member)
        self.until(
            lambda: self.drives.get_subscription_count() and self.commands.get_subscription_count()
        )

    def spin(self):
        self.executor.spin_once(timeout_sec=0.001)

    def on_diagnostics(self, message):
        for status in message.status:
            self.parts[status.name] = status

    def weld(self, **values):
        """Publish a tick."""
        sample = WELD[self.tick % len(WELD)]._replace(**values)
        self.tick += 1
        stamp_ns, command = self.tick * TICK_NS, Command(sample.force_kn, sample.speed_rpm)
        self.drives.publish(convert.drives_message(command, stamp_ns))
        for name, value in (
            ("depth", sample.depth_mm),
            ("torque", sample.torque_nm),
            ("thermocouple", sample.temperature_c),
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
    running = Graph(domain_id)
    yield running
    running.executor.shutdown()
    for node in (running.monitor, running.node):
        node.destroy_node()
    running.context.try_shutdown()


def test_it_waits_for_a_weld_then_publishes_code_and_words_until_the_fault_is_over(graph):
    graph.until(lambda: graph.code("watch") == {"code": Watching.NOTHING})
    graph.weld_until(
        lambda: (
            graph.health
            and WeldFinding.TORQUE_STUCK
            in [finding.cause for finding in graph.health[-1].findings]
        ),
        torque_nm=1052.9,
    )
    health = graph.health[-1]
    (finding,) = health.findings
    assert finding.alarm and finding.size >= 1.0 and math.isnan(finding.log_likelihood)
    assert health.process == "paper" and health.learning
    assert set(health.gain_names) == {"torque", "depth", "heat"} and all(
        map(math.isfinite, health.gains)
    )
    assert len(health.estimates) == 10 and all(
        estimate.reason == WeldEstimate.LEARNING and math.isnan(estimate.size)
        for estimate in health.estimates
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
