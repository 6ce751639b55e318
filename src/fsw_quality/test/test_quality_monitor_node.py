"""The monitor as a node: it joins the topics of a weld, and tells what it finds as a topic and as diagnostics."""

import math

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context

from fsw_control import messages_ros as convert
from fsw_control.contract import Command, Reference
from fsw_control.topics_ros import LATCHED, STREAM, sensor_publishers
from fsw_control.weld import TICK_NS
from fsw_msgs.msg import DriveFeedback, WeldCommand, WeldHealth, WeldReference
from fsw_quality.monitor_node import MonitorNode
from fsw_test_support.ros_graph import Spinner, domain_id  # noqa: F401
from fsw_test_support.watched_weld import samples

pytestmark = pytest.mark.slow
#: far too much torque, which is told as soon as it lasted for seconds
WELD = samples(30.0, excited=False, sliding_friction=1.5)
TOLD = "fsw_monitor: gain_torque"


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
        self.references = node.create_publisher(WeldReference, "fsw/reference", LATCHED)
        self.sensors = sensor_publishers(node)
        for one in (self.monitor, node):
            self.executor.add_node(one)
        self.until(lambda: self.drives.get_subscription_count() and self.commands.get_subscription_count())
        self.references.publish(convert.reference_message(Reference(2.66, 816.4), 0))

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
        for name, value in (("depth", one.depth_mm), ("torque", one.torque_nm), ("thermocouple", one.temperature_c)):
            self.sensors[name].publish(convert.sensor_message(name, value, stamp_ns))
        self.commands.publish(convert.command_message(command, stamp_ns, "decentral"))
        for _ in range(8):  # so that the queues do not run over
            self.spin()

    def weld_until(self, condition, **values):
        def holds():
            self.weld(**values)
            return condition()

        self.until(holds)

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


def test_it_waits_for_a_weld_then_tells_cause_and_advice_and_when_they_are_over(graph):
    graph.until(lambda: "nothing to watch" in getattr(graph.parts.get("fsw_monitor: watch"), "message", ""))
    graph.weld_until(lambda: graph.health and "gain_torque" in graph.health[-1].kinds)
    told = graph.health[-1]
    row = list(told.kinds).index("gain_torque")
    assert "Torque is 1" in told.causes[row] and told.advice[row] and 0.5 < told.confidences[row] <= 1.0
    assert told.process == "paper" and told.learning
    figures = dict(zip(told.figure_names, zip(told.figures, told.limits, strict=True), strict=True))
    value, limit = figures["gain_torque"]
    assert value > limit and all(math.isfinite(one) for one in told.figures)
    graph.until(lambda: graph.level(TOLD) == DiagnosticStatus.WARN)
    values = {pair.key: pair.value for pair in graph.parts[TOLD].values}
    assert values["advice"] == told.advice[row]
    # the torque is what the model says: no longer told
    graph.weld_until(lambda: graph.level(TOLD) == DiagnosticStatus.OK, torque_nm=1052.9)


def test_samples_that_are_no_numbers_are_no_weld(graph):
    graph.weld_until(lambda: graph.tick > 40, depth_mm=math.nan)
    graph.until(lambda: "nothing to watch" in getattr(graph.parts.get("fsw_monitor: watch"), "message", ""))
    assert not graph.health
