"""The service for new set-points: checked, in force when it says so, and refusals told."""

from math import isnan, nan

import pytest
import rclpy

from fsw_control import messages_ros as convert
from fsw_control import references_ros
from fsw_control.contract import Reference
from fsw_control.ranges import beyond_trip
from fsw_control.references_ros import (
    KeptReference,
    StatedReference,
    reference_queue,
    subscribe_references,
)
from fsw_control.reports_ros import OK, WARN
from fsw_control.topics_ros import LATCHED, LATEST
from fsw_msgs.msg import WeldProgress, WeldReference
from fsw_msgs.srv import SetReference
from fsw_test_support.ros_graph import Spinner
from fsw_test_support.waiting import PATIENCE_S

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("domain_id")]
STEP_NS = 100_000_000
TRIPS = {"interlocks.depth_high.trip": 3.0}


class Graph(Spinner):
    """A supervisor's part of the set-points, one controller, and who asks."""

    def __init__(self):
        rclpy.init(args=[])
        self.nodes = [rclpy.create_node(name) for name in ("supervisor", "controller", "operator")]
        supervisor, self.controller, operator = self.nodes
        self.leads = True
        self.kept = KeptReference(
            supervisor,
            self.certain,
            lambda depth_mm, temperature_c: beyond_trip(depth_mm, temperature_c, TRIPS),
        )
        self.kept.listen_to("echo")
        self.kept.open()
        self.follows = reference_queue(self.controller)
        subscribe_references(self.controller, self.follows)
        self.client = operator.create_client(SetReference, "fsw/set_reference")
        self.sender = operator.create_publisher(WeldReference, "fsw/reference", LATCHED)
        self.stated = None
        self.ticks = 0
        super().__init__()
        for node in self.nodes:
            self.executor.add_node(node)
        self.until(
            lambda: self.client.service_is_ready() and self.sender.get_subscription_count() == 2
        )

    async def certain(self):
        return self.leads

    def tick(self):
        self.ticks += 1
        stamp_ns = self.ticks * STEP_NS
        self.kept.on_tick(stamp_ns)
        present = self.follows.at(stamp_ns)
        if self.stated is not None:
            self.stated.update(stamp_ns, present, self.follows.issued_ns)

    def start_controller(self):
        self.stated = StatedReference(self.controller, "fsw/echo/reference")
        self.until(lambda: self.nodes[0].count_publishers("/fsw/echo/reference"))

    def ask(self, depth_mm=nan, temperature_c=nan, ramp=False, ticking=True):
        request = SetReference.Request(
            depth=depth_mm * 1e-3, temperature=float(temperature_c), ramp=ramp
        )
        future = self.client.call_async(request)

        def answered():
            if ticking:
                self.tick()
            else:
                received = any(pending.received_ns is not None for pending in self.kept._asked)
                self.kept.look(1e12 if received else 0.0)
            return future.done()

        self.until(answered)
        return future.result()

    def end(self):
        self.executor.shutdown()
        for node in self.nodes:
            node.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def graph(monkeypatch):
    monkeypatch.setattr(references_ros, "_ANSWER_S", PATIENCE_S)
    made = Graph()
    yield made
    made.end()


def test_a_place_in_the_order_after_which_no_message_has_one_is_refused(graph):
    graph.start_controller()
    assert graph.ask(2.7, 820.0).ok
    refused = []
    graph.follows.refuse = refused.append
    stated = convert.reference_message(Reference(2.9, 830.0), 0)
    stated.issued.sec, stated.issued.nanosec = 2**31 - 1, 2**32 - 1
    other = graph.nodes[2].create_publisher(WeldReference, "fsw/supervisor/reference", LATEST)
    graph.until(lambda: other.get_subscription_count() == 2)
    other.publish(stated)
    graph.until(lambda: refused)
    assert refused[0].code == "bad_issue"
    assert graph.ask(2.8).ok
    assert graph.follows.at(graph.ticks * STEP_NS) == Reference(2.8, 820.0)


@pytest.mark.requirement("S28")
def test_accepted_requests_are_in_force_and_refusals_have_a_reason(graph):
    assert graph.ask(2.7, 820.0).code == "no_listener"
    graph.start_controller()
    assert graph.ask(2.7).code == "incomplete"
    outside = graph.ask(9.0, 820.0)
    assert (outside.code, isnan(outside.depth)) == ("out_of_range", True)
    assert "9" in outside.message
    assert graph.ask(3.1, 820.0).code == "would_trip"
    accepted = graph.ask(2.7, 820.0)
    assert accepted.ok, accepted.message
    assert (accepted.code, accepted.depth) == ("step", pytest.approx(2.7e-3))
    in_force = graph.kept.queue.at(graph.ticks * STEP_NS)
    assert (in_force.depth_mm, in_force.temperature_c) == (pytest.approx(2.7), 820.0)
    graph.until(lambda: graph.tick() or graph.follows.at(graph.ticks * STEP_NS) == in_force)
    assert graph.ask(temperature_c=821.0).ok
    graph.until(
        lambda: graph.tick() or graph.follows.at(graph.ticks * STEP_NS).temperature_c == 821.0
    )
    assert graph.follows.at(graph.ticks * STEP_NS).depth_mm == pytest.approx(2.7)


@pytest.mark.requirement("S28")
def test_a_supervisor_that_does_not_lead_accepts_nothing(graph, monkeypatch):
    graph.start_controller()
    assert graph.ask(2.7, 820.0).ok
    graph.leads = False
    refused = graph.ask(2.8, 830.0)
    assert not refused.ok and refused.code == "on_standby"
    graph.leads = True
    send = graph.kept._send
    monkeypatch.setattr(
        graph.kept, "_send", lambda *sent: setattr(graph, "leads", False) or send(*sent)
    )
    replaced = graph.ask(2.9, 820.0)
    assert not replaced.ok and replaced.code == "on_standby", (
        "replaced between its sending and its answer"
    )
    assert graph.follows.at(graph.ticks * STEP_NS).depth_mm != pytest.approx(2.8)


@pytest.mark.requirement("S28")
def test_step_down_refuses_pending_requests(graph, monkeypatch):
    graph.start_controller()
    monkeypatch.setattr(graph.kept, "look", lambda _now_s: graph.kept._asked and graph.kept.drop())
    refused = graph.ask(2.7, 820.0)
    assert not refused.ok and refused.code == "on_standby"


@pytest.mark.requirement("S21")
def test_only_the_leader_orders_by_receipt(graph):
    other = KeptReference(graph.nodes[2], graph.certain)
    decides = [other.queue.decides]
    for change in (other.open, other.close):
        change()
        decides.append(other.queue.decides)
    assert decides == [False, True, False]


@pytest.mark.requirement("S28")
def test_set_points_are_refused_while_a_programme_runs(graph, monkeypatch):
    graph.start_controller()
    player = graph.controller.create_publisher(WeldProgress, "fsw/weld_progress", LATEST)

    def report(**fields):
        graph.kept._programme_runs_s = "unheard"
        player.publish(WeldProgress(**fields))
        graph.until(lambda: graph.kept._programme_runs_s != "unheard")

    report(state="running")
    refused = graph.ask(2.7, 820.0)
    assert not refused.ok and refused.code == "programme_runs"
    for fields in ({"state": "held"}, {"state": "running", "left": True}, {"state": "aborted"}):
        report(**fields)
        assert graph.ask(2.7, 820.0).ok, fields
    report(state="running")
    monkeypatch.setattr(references_ros, "_PROGRAMME_SILENT_S", -1.0)  # as if that was long ago
    assert graph.ask(2.7, 820.0).ok


def test_ramp_begins_at_the_set_points_in_force(graph):
    graph.start_controller()
    refused = graph.ask(2.7, 820.0, ramp=True)
    assert not refused.ok and refused.code == "no_start"
    assert graph.ask(2.7, 820.0).ok
    graph.until(lambda: graph.tick() or graph.follows.mark)
    ramped = graph.ask(2.7, 830.0, ramp=True)
    assert (ramped.code, ramped.duration) == ("ramp", pytest.approx(10.0))
    graph.until(
        lambda: graph.tick() or graph.follows.at(graph.ticks * STEP_NS).temperature_c > 822.0
    )
    assert graph.ask(2.7, 815.0).ok
    graph.until(
        lambda: graph.tick() or graph.follows.at(graph.ticks * STEP_NS).temperature_c == 815.0
    )
    for _ in range(200):
        graph.tick()
    assert graph.follows.at(graph.ticks * STEP_NS).temperature_c == 815.0


def test_set_points_before_the_first_measurement_are_for_the_first_one(graph):
    graph.start_controller()
    accepted = graph.ask(2.7, 820.0, ticking=False)
    assert accepted.ok and accepted.code == "next"
    graph.until(lambda: graph.tick() or graph.follows.at(graph.ticks * STEP_NS) is not None)


@pytest.mark.requirement("S28")
def test_a_refused_set_point_of_a_plain_publisher_is_in_the_diagnostics(graph):
    graph.tick()
    graph.sender.publish(convert.reference_message(Reference(2.7, 820.0), 7200 * 10**9))
    reports = []
    graph.until(lambda: reports.append(graph.kept.report()) or reports[-1].level == WARN)
    last = reports[-1].what.data["last"]
    assert (last.code, last.data["depth_mm"]) == ("too_far", 2.7)
    assert reports[-1].values["refused"] == 1
    assert graph.kept.report().level == OK
    assert graph.kept.queue.at(graph.ticks * STEP_NS) is None
