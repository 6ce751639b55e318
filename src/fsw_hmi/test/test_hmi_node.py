"""The node with a real page, among nodes that stand in for the graph."""

import threading
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from itertools import count
from math import radians

import pytest
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message

from fsw_analysis.rule_book import default
from fsw_control import messages_ros as convert
from fsw_control.cause import AlarmChange, RequestKind
from fsw_control.contract import Command, Diagnosis, Proposal, Reference
from fsw_control.heat_plan import SHARE_NAME
from fsw_control.heat_plan import HeatPlan as HeatPlanData
from fsw_control.topics_ros import LATCHED, LATEST, STREAM
from fsw_control.units import NANOSECONDS
from fsw_hmi import alarm_rules, hmi_node, main, watch_ros
from fsw_hmi.hmi_node import HmiNode, book_of, pages_of
from fsw_msgs.msg import (
    AlarmEvent,
    ControllerHealth,
    ControllerStatus,
    DriveFeedback,
    HeatPlan,
    Interlock,
    OperatorAction,
    Prediction,
    Reason,
    ShoulderDepth,
    SpindleTorque,
    SupervisorState,
    WeldProgress,
    WeldReference,
)
from fsw_msgs.srv import (
    OperatorRequest,
    SetMode,
    SetReference,
    SwitchController,
)
from fsw_recorder.findings import Code, EvidenceError
from fsw_recorder.signature import Purpose, load_private, sign, signature_path
from fsw_test_support.judged_weld import short_procedure
from fsw_test_support.keys import make_key
from fsw_test_support.page_client import Page
from fsw_test_support.waiting import PATIENCE_S, wait_until

pytestmark = pytest.mark.slow
TOKEN = "a token of some length"
START_NS, TICK_NS = 1_700_000_000_000_000_000, 100_000_000


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """A machine may stand still for some time.

    How long silence lasts until it is told, is tested by the clock.
    """
    for module in (alarm_rules, watch_ros):
        monkeypatch.setattr(module, "NO_REPORT_S", PATIENCE_S)


def states(frame):
    return [(alarm["id"], alarm["state"]) for alarm in frame["alarms"]]


class Graph:
    """Nodes in an executor of their own thread.

    The page, and one that stands in for all others.
    """

    def __init__(self, domain, token_file, monkeypatch, capsys, folder, request_timeout_s):
        self.context = Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.node = rclpy.create_node("others", context=self.context)
        given = {"port": 0, "token_file": str(token_file), "request_timeout_s": request_timeout_s}
        self.overrides = [Parameter(name, value=value) for name, value in given.items()]
        self.capsys = capsys
        monkeypatch.setattr(hmi_node, "PageFiles", partial(hmi_node.PageFiles, folder=folder))
        self.hmi = None
        self.start_page()
        self.actions = []
        node = self.node
        node.create_subscription(
            OperatorAction, "fsw/operator_action", self.actions.append, LATCHED
        )
        self.drives = node.create_publisher(DriveFeedback, "fsw/drives", STREAM)
        self.depths = node.create_publisher(ShoulderDepth, "fsw/depth", STREAM)
        self.torques = node.create_publisher(SpindleTorque, "fsw/spindle_torque", STREAM)
        self.states = node.create_publisher(SupervisorState, "fsw/supervisor/state", LATEST)
        self.progress = node.create_publisher(WeldProgress, "fsw/weld_progress", LATEST)
        self.stated = node.create_publisher(WeldReference, "fsw/supervisor/reference", LATEST)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self.executor.spin)
        self.thread.start()

    def start_page(self):
        """Start the page's server, again where one runs.

        In the executor's thread once that spins.
        """
        if self.hmi is not None:
            self.executor.remove_node(self.hmi)
            self.hmi.destroy_node()
        self.hmi = HmiNode(context=self.context, parameter_overrides=self.overrides)
        self.executor.add_node(self.hmi)
        self.url = self.capsys.readouterr().out.split()[-1]

    def serve(self, kind, name, answer):
        self.node.create_service(kind, name, answer)

    def tick(self, number):
        stamp_ns = START_NS + number * TICK_NS
        self.drives.publish(convert.drives_message(Command(78.0, 400.0), stamp_ns))
        self.depths.publish(convert.sensor_message("depth", 2.66, stamp_ns))
        self.torques.publish(convert.sensor_message("torque", 1000.0, stamp_ns))

    def tick_until(self, condition, what):
        numbers = count()

        def holds():
            return condition() or self.tick(next(numbers))

        wait_until(holds, what)

    def close(self):
        self.executor.shutdown()
        self.thread.join()
        self.hmi.destroy_node()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def graph(request, domain_id, tmp_path, monkeypatch, capsys, folder):
    """Patient with the graph's answers: a machine may stand still for some time.

    Tests of the patience give theirs.
    """
    token_file = tmp_path / "token~"
    token_file.write_text(TOKEN)
    token_file.chmod(0o600)
    started = Graph(
        domain_id, token_file, monkeypatch, capsys, folder, getattr(request, "param", 60.0)
    )
    yield started
    started.close()


@pytest.fixture
def page(graph):
    with Page(graph.url) as opened:
        opened.command(TOKEN)
        yield opened


def test_control_that_ends_with_the_server_is_recorded(graph, page):
    wait_until(graph.executor.create_task(graph.start_page).done, "the page's server")
    wait_until(
        lambda: any(action.code == "server_ended" for action in graph.actions), "the record"
    )
    lost = next(action for action in graph.actions if action.code == "server_ended")
    assert (lost.action, lost.who.startswith("anna (")) == ("lose control", True)
    with Page(graph.url) as again:
        assert again.seen("control")["holder"] is None
        assert again.seen("actions")["actions"] == []


def test_node_alone_publishes_no_set_points_and_is_no_subscriber_that_a_plant_waits_for(
    graph, page
):
    names = [f"/fsw/{name}" for name in ("reference", "reference_plan", "command")]
    assert [name for name in names if graph.node.count_publishers(name)] == []
    wait_until(lambda: graph.drives.get_subscription_count() == 1, "the page at the drives")
    wait_until(
        lambda: graph.node.count_subscribers("/fsw/supervisor/state") == 1,
        "the page at the supervisor",
    )
    assert graph.depths.get_subscription_count() == 0
    graph.tick_until(graph.depths.get_subscription_count, "the page at the sensors")
    wait_until(
        lambda: graph.depths.get_subscription_count() == 0, "the page to leave a silent plant"
    )
    graph.tick_until(
        graph.depths.get_subscription_count, "the page at the sensors of the next plant"
    )


def test_ticks_reach_the_page(graph, page):
    graph.tick_until(lambda: "tick" in page.frames or page.receive()["t"] == "tick", "a tick")

    def is_whole():
        return page.receive()["t"] == "tick" and None not in (
            page.value("depth_mm"),
            page.value("torque_nm"),
        )

    graph.tick_until(is_whole, "a whole tick")
    assert (page.value("depth_mm"), page.value("torque_nm")) == (2.66, 1000.0)
    assert (page.value("temperature_c"), page.value("angle_deg")) == (None, None)
    graph.progress.publish(WeldProgress(state="running", phase="joint_line", angle=radians(143.0)))
    graph.tick_until(
        lambda: page.receive()["t"] == "tick" and page.value("angle_deg") == 143.0, "the angle"
    )


def test_another_weld_begins_when_time_goes_back_and_no_sensor_is_missed_meanwhile(graph, page):
    graph.tick_until(lambda: page.receive()["t"] == "tick", "a tick")
    wait_until(
        lambda: graph.depths.get_subscription_count() == 0, "the page to leave a silent plant"
    )
    page.seen("alarms", lambda frame: frame["alarms"])
    graph.drives.publish(convert.drives_message(Command(78.0, 400.0), START_NS - 100 * TICK_NS))
    page.until("hello")

    def is_cleared():
        with suppress(TimeoutError):  # the plant ticks on whether the page tells something or not
            frame = page.receive(0.05)
            return frame["t"] == "alarms" and ("measurements", "cleared") in states(frame)
        return False

    graph.tick_until(is_cleared, "the end of the alarm")


def test_page_that_opens_before_the_first_tick_of_a_weld_gets_no_verdict_of_the_last(graph, page):
    graph.progress.publish(WeldProgress(state="running"))
    graph.tick_until(lambda: page.receive()["t"] == "account", "the verdict")
    for state in ("done", "running"):
        graph.progress.publish(WeldProgress(state=state))
        page.until("progress", lambda frame, state=state: frame["state"] == state)
    with Page(graph.url) as new:
        new.until("beat")
        assert "progress" in new.frames and "account" not in new.frames


def test_state_prediction_and_alarms_reach_the_page(graph, page, monkeypatch):
    health = ControllerHealth(name="nmpc", warm=True, healthy=True)
    graph.states.publish(
        SupervisorState(
            actual_mode="auto",
            target_mode="auto",
            controllers=[health],
            interlocks=[Interlock(name="depth_high", level=Interlock.WARN)],
            acknowledgement_blocked_by=["depth"],
        )
    )
    shown = page.seen("state", lambda frame: frame["known"])
    assert (shown["actual_mode"], shown["controllers"][0]["ready"]) == ("auto", True)
    assert shown["interlocks"] == [{"name": "depth_high", "level": "warn"}]
    assert shown["acknowledgement_blocked_by"] == ["depth"]
    predictions = graph.node.create_publisher(Prediction, "fsw/nmpc/prediction", STREAM)
    wait_until(predictions.get_subscription_count, "the page at the predictions")
    predictions.publish(
        Prediction(
            header=convert.header(START_NS),
            **{"time": [0.1], "depth": [2.66e-3], "temperature": [816.0]},
            **{"depth_deviation": [2e-6], "temperature_deviation": [0.25]},
        )
    )
    plan = page.until("prediction")
    assert (plan["controller"], plan["time_s"], plan["depth_mm"]) == (
        "nmpc",
        [1_700_000_000.1],
        [2.66],
    )
    assert (plan["depth_mm:deviation"], plan["temperature_c:deviation"]) == ([0.002], [0.25])
    page.seen("alarms", lambda frame: ("interlock:depth_high", "active") in states(frame))
    assert page.ask("acknowledge", ids=["interlock:depth_high"])["message"] == "1 acknowledged"
    page.seen("alarms", lambda frame: ("interlock:depth_high", "acknowledged") in states(frame))
    monkeypatch.setattr(watch_ros, "NO_REPORT_S", 0.0)
    page.until("state", lambda frame: not frame["known"])  # the supervisor is silent


def test_standby_that_is_ready_reaches_the_page_until_it_is_not(graph, page):
    diagnostics = graph.node.create_publisher(DiagnosticArray, "/diagnostics", 10)
    wait_until(diagnostics.get_subscription_count, "the page at the diagnostics")
    for level in (DiagnosticStatus.OK, DiagnosticStatus.ERROR):
        status = DiagnosticStatus(name="fsw_supervisor_standby: standby", level=level)
        diagnostics.publish(DiagnosticArray(status=[status]))
        page.until(
            "state", lambda frame, level=level: frame["standby"] == (level == DiagnosticStatus.OK)
        )


def test_known_heat_reaches_the_page_with_the_share_in_use(graph, page):
    plan = HeatPlanData(
        at_s=[0.0, 60.0],
        heat_kw=[1.0, 3.0],
        variance_kw2=[0.0, 0.02],
        model={"copper_lag_s": 11.0},
        travel_mm=[0.0, 86.0],
        angle_deg=[0.0, 10.0],
        type="copper_lid",
        profile="a" * 64,
    )
    plans = graph.node.create_publisher(HeatPlan, "fsw/heat_plan", LATEST)
    plans.publish(convert.heat_plan_message(plan, 0))
    shown = page.until("heat")
    assert (shown["type"], shown["angle_deg"][-1]) == ("copper_lid", 10.0)
    assert shown["heat_kw"][-1] == 3.0
    graph.states.publish(SupervisorState(controllers=[ControllerHealth(name="nmpc")]))
    statuses = graph.node.create_publisher(ControllerStatus, "fsw/nmpc/status", STREAM)
    wait_until(statuses.get_subscription_count, "the page at the status")
    statuses.publish(
        ControllerStatus(
            controller="nmpc",
            selected=True,
            disturbance_names=[SHARE_NAME],
            disturbances=[0.75],
        )
    )
    page.until("state", lambda frame: frame["known_heat_share"] == 0.75)
    plans.publish(convert.heat_plan_message(None, 0))
    page.until("heat", lambda frame: frame["angle_deg"] == [])


def test_set_points_out_of_reach_are_told_beside_what_is_attainable_until_they_are_within(
    graph, page, monkeypatch
):
    health = ControllerHealth(name="nmpc", warm=True, healthy=True)
    graph.states.publish(
        SupervisorState(
            actual_mode="auto", target_mode="auto", actual_controller="nmpc", controllers=[health]
        )
    )
    statuses = graph.node.create_publisher(ControllerStatus, "fsw/nmpc/status", STREAM)
    wait_until(statuses.get_subscription_count, "the page at the status")
    graph.stated.publish(convert.reference_message(Reference(2.66, 830.0), 0, issued_ns=1))
    events = []
    graph.node.create_subscription(AlarmEvent, "fsw/alarms", events.append, LATCHED)

    def goes_for(temperature_c, source="nmpc"):
        attainable_values = {
            "attainable_depth_mm": 2.66,
            "attainable_temperature_c": temperature_c,
        }
        proposal = Proposal(
            Command(78.0, 400.0), diagnosis=Diagnosis(disturbances=attainable_values)
        )
        statuses.publish(convert.status_message(proposal, START_NS, "nmpc", source, ()))

    def is_shown(attainable, alarm_state):
        with suppress(TimeoutError):
            frame = page.receive(0.05)
            listed = frame["t"] == "alarms" and dict(states(frame)).get("out_of_reach")
            return listed == alarm_state and frame["attainable"] == attainable
        return False

    goes_for(815.04)
    graph.tick_until(
        lambda: is_shown({"depth_mm": 2.66, "temperature_c": 815.0}, "active"), "the alarm"
    )
    goes_for(815.04, source="decentral")  # another one commands, who tells nothing
    graph.tick_until(lambda: is_shown(None, "cleared"), "its end")
    changes = ["raised", "cleared"]  # on a topic of its own, which may come after the page's frame

    def journal():
        return [AlarmChange(event.kind).word for event in events if event.id == "out_of_reach"]

    graph.tick_until(lambda: journal() == changes, "the journal")
    text = next(event.text for event in events if event.id == "out_of_reach")
    assert "830 °C" in text and "815 °C" in text


def test_answers_of_services(graph, page):
    askers = []

    def on_mode(request, response):
        askers.append(request.who)
        response.ok, response.message = (
            request.mode in ("hold", "safe_stop"),
            f"{request.mode} {request.axial_force:g}",
        )
        response.code = "mode_next"
        return response

    def on_switch(request, response):
        askers.append(request.who)
        response.ok, response.message = (
            True,
            f"{request.name} {request.strictness} {request.timeout.sec}",
        )
        return response

    def on_request(request, response):
        askers.append(request.who)
        response.ok, response.code, response.message = False, "cause_present", "still hot"
        return response

    refused = page.ask("mode", mode="hold")
    assert (refused["outcome"], refused["code"]) == ("refused", "no_service")
    graph.serve(SetMode, "fsw/set_mode", on_mode)
    graph.serve(SwitchController, "fsw/switch_controller", on_switch)
    wait_until(graph.hmi._orders._set_mode.service_is_ready, "the service")
    wait_until(graph.hmi._orders._switch.service_is_ready, "the service")
    assert page.ask("mode", mode="hold") | {"id": 0} == {
        "t": "answer",
        "id": 0,
        "outcome": "done",
        "code": "mode_next",
        "message": "hold nan",
    }
    manual = page.ask("mode", mode="manual", force_kn=78.0, speed_rpm=400.0)
    assert (manual["outcome"], manual["message"]) == ("refused", "manual 78000")
    assert page.ask("switch", controller="nmpc", wait_s=2)["message"] == "nmpc 1 2"
    assert page.ask("safe_stop")["message"] == "safe_stop nan"
    graph.serve(OperatorRequest, "fsw/acknowledge", on_request)
    graph.serve(OperatorRequest, "fsw/weld/abort", on_request)
    wait_until(graph.hmi._orders._acknowledge.service_is_ready, "the service")
    assert page.ask("acknowledge_stop")["message"] == "still hot"
    wait_until(graph.hmi._orders._weld["abort"].service_is_ready, "the service")
    assert page.ask("weld", action="abort")["code"] == "cause_present"
    wait_until(lambda: len(graph.actions) == 9, "the record of all actions")
    assert [(action.action, action.code) for action in graph.actions[:1]] == [
        ("log in", "logged_in")
    ]
    assert [action.code for action in graph.actions[-5:]] == [
        "mode_next",
        "service",
        "mode_next",
        "cause_present",
        "cause_present",
    ]
    assert set(askers) == {action.who for action in graph.actions} and len(askers) == 6
    assert "78 kN, 400 rpm" in graph.actions[-5].action
    assert [(RequestKind(action.kind), action.outcome) for action in graph.actions][-5:] == [
        (RequestKind.MODE, "refused"),
        (RequestKind.SWITCH, "done"),
        (RequestKind.SAFE_STOP, "done"),
        (RequestKind.ACKNOWLEDGE_STOP, "refused"),
        (RequestKind.WELD, "refused"),
    ]
    assert all(action.who.startswith("anna (") for action in graph.actions)
    listed = page.seen("actions", lambda frame: len(frame["actions"]) == 9)["actions"]
    assert [
        (action["who"], action["action"], action["outcome"], action["code"]) for action in listed
    ] == [(action.who, action.action, action.outcome, action.code) for action in graph.actions]


@pytest.mark.requirement("S19")
def test_safe_stop_is_asked_for_until_somebody_answers(graph, page):
    number = page.send("safe_stop")

    def on_mode(_, response):
        response.ok, response.message = True, "at last"
        return response

    graph.serve(SetMode, "fsw/set_mode", on_mode)
    assert page.until("answer", lambda frame: frame["id"] == number)["message"] == "at last"


@pytest.mark.requirement("S19")
@pytest.mark.parametrize("graph", [0.5], indirect=True)
def test_safe_stop_is_a_new_one_though_the_copy_of_the_register_is_stopped_already(graph, page):
    page.ask("safe_stop")
    before = graph.hmi._register.value
    assert before.stopped
    page.ask("safe_stop")
    assert graph.hmi._register.value.epoch > before.epoch


@pytest.mark.requirement("S20")
@pytest.mark.parametrize("graph", [0.5], indirect=True)
def test_request_without_an_answer_times_out(graph, page):
    assert page.ask("safe_stop")["code"] == "asked_again"
    assert page.frames["answer"]["outcome"] == "timed_out"


@pytest.mark.parametrize("graph", [0.5], indirect=True)
def test_safe_stop_reaches_a_supervisor_that_comes_after_the_page_was_answered(graph, page):
    assert page.ask("safe_stop")["outcome"] == "timed_out"
    asked = []

    def on_mode(request, response):
        asked.append(request.mode)
        response.ok = True
        return response

    graph.serve(SetMode, "fsw/set_mode", on_mode)
    wait_until(lambda: asked, "the safe stop")
    wait_until(lambda: len(graph.actions) == 4, "the record of what became of it")
    assert [action.outcome for action in graph.actions][1:] == [
        "done",
        "timed_out",
        "done",
    ]  # the first: control taken
    assert asked[0] == "safe_stop"


def test_set_points_are_asked_for_and_the_answer_is_the_supervisors(graph, page):
    alone = page.ask("set_reference", depth_mm=2.7, temperature_c=820)
    assert alone["code"] == "no_service"
    asked = []

    def on_set_points(request, response):
        asked.append((round(request.depth * 1e3, 6), request.temperature, request.ramp))
        response.ok, response.code, response.message = len(asked) > 1, "tested", "as a test"
        return response

    graph.serve(SetReference, "fsw/set_reference", on_set_points)
    wait_until(graph.hmi._orders._set_reference.service_is_ready, "the service")
    refused = page.ask("set_reference", depth_mm=2.7, temperature_c=820)
    assert (refused["outcome"], refused["code"]) == ("refused", "tested")
    assert (
        page.ask("set_reference", depth_mm=2.66, temperature_c=826, ramp=True)["outcome"] == "done"
    )
    for timer in graph.hmi.timers:  # a report is shown when it comes, not with the next second's
        if timer.timer_period_ns == NANOSECONDS:
            timer.cancel()
    graph.progress.publish(
        WeldProgress(state="running", phase="joint_line", way_back=31.5, depth=2.66e-3)
    )
    programme = page.seen("progress", lambda frame: frame["state"] == "running")
    assert (
        page.ask("set_reference", depth_mm=2.7, temperature_c=820)["outcome"] == "done"
    )  # the page does not judge
    assert asked == [(2.7, 820.0, False), (2.66, 826.0, True), (2.7, 820.0, False)]
    assert (programme["left"], programme["way_back_s"], programme["depth_mm"]) == (
        False,
        31.5,
        2.66,
    )


@pytest.mark.requirement("S17")
def test_alarm_is_raised_shelved_cleared_raised_again_and_all_of_it_is_in_the_journal(graph, page):
    events = []
    graph.node.create_subscription(AlarmEvent, "fsw/alarms", events.append, LATCHED)
    diagnostics = graph.node.create_publisher(DiagnosticArray, "/diagnostics", STREAM)
    wait_until(diagnostics.get_subscription_count, "the page at the diagnostics")

    def report(level, message):
        status = DiagnosticStatus(name="fsw_recorder: recording", level=level, message=message)
        diagnostics.publish(DiagnosticArray(status=[status]))

    def now(state):
        return lambda frame: [row["state"] for row in of_recorder(frame)] == [state]

    def of_recorder(frame):
        return [row for row in frame["alarms"] if row["id"] == "part:fsw_recorder"]

    report(DiagnosticStatus.ERROR, "disk full")
    (alarm,) = of_recorder(page.seen("alarms", now("active")))
    assert alarm["text"] == "fsw_recorder: recording: disk full"
    shelve = {"alarm": alarm["id"], "minutes": 20, "reason": "a new disk"}
    assert page.ask("shelve", **shelve | {"reason": " "})["code"] == "value_error"
    assert page.ask("shelve", **shelve | {"alarm": "other"})["outcome"] == "refused"
    assert page.ask("shelve", **shelve)["outcome"] == "done"
    page.seen("alarms", now("shelved"))
    assert page.ask("unshelve", alarm=alarm["id"])["outcome"] == "done"
    page.seen("alarms", now("active"))
    report(DiagnosticStatus.OK, "")
    page.seen("alarms", now("cleared"))
    report(DiagnosticStatus.ERROR, "disk full")
    (again,) = of_recorder(page.seen("alarms", now("active")))
    assert (again["count"], again["raised_s"] > alarm["raised_s"]) == (2, True)
    assert page.ask("acknowledge", ids=[alarm["id"]])["outcome"] == "done"

    def journal():
        return [AlarmChange(event.kind).word for event in events if event.id == alarm["id"]]

    wait_until(lambda: len(journal()) == 6, "the journal")
    assert journal() == ["raised", "shelved", "unshelved", "cleared", "re-raised", "acknowledged"]
    assert (events[1].reason, events[1].shelved_for, events[1].who[:6]) == (
        "a new disk",
        1200.0,
        "anna (",
    )
    assert {(event.id, event.priority) for event in events} == {("part:fsw_recorder", "medium")}


def test_odd_names_and_floods_leave_the_page_alive(graph, page):
    diagnostics = graph.node.create_publisher(DiagnosticArray, "/diagnostics", STREAM)
    wait_until(diagnostics.get_subscription_count, "the page at the diagnostics")
    odd = ["näme/x", "a b", "1st", "x" * 300, "ends_", "", "{why}", "tab\t"]
    health = [
        ControllerHealth(
            name=name,
            lack=ControllerHealth.INHIBITED,
            why=[Reason(code=Reason.OTHER, detail="{why}")],
            latched_out=True,
        )
        for name in odd * 10
    ]
    graph.states.publish(
        SupervisorState(
            actual_mode="\n",
            actual_controller="ü",
            controllers=health,
            interlocks=[Interlock(name=name, level=77) for name in odd * 100],
        )
    )
    page.seen("state", lambda frame: len(frame["controllers"]) == 20)
    broken = serialize_message(SupervisorState(who="no UTF-8")).replace(
        b"UTF-8", b"\xff\xfe-\xff8"
    )
    graph.states.publish(broken)
    flood = [
        DiagnosticStatus(name=f"rogue{i}: {name}", level=DiagnosticStatus.ERROR, message=name)
        for i in range(200)
        for name in odd
    ]
    diagnostics.publish(DiagnosticArray(status=flood))
    own = DiagnosticStatus(
        name="fsw_recorder: recording", level=DiagnosticStatus.ERROR, message="disk full"
    )
    diagnostics.publish(DiagnosticArray(status=[own]))
    shown = page.seen(
        "alarms",
        lambda frame: {"flood:low", "part:fsw_recorder"} <= {name for name, _ in states(frame)},
    )
    assert page.ask("acknowledge", ids=[name for name, _ in states(shown)])["outcome"] == "done"
    graph.tick_until(lambda: page.receive()["t"] == "tick", "a tick")


def test_supervisors_interlocks_reach_the_page(graph, page):
    def on_parameters(request, response):
        trips = {"interlocks.depth_high.trip": 3.0}
        response.values = [
            ParameterValue(type=3, double_value=trips[name]) if name in trips else ParameterValue()
            for name in request.names
        ]
        return response

    graph.serve(GetParameters, "fsw_supervisor/get_parameters", on_parameters)
    graph.states.publish(SupervisorState(term=1, leader="leader"))
    page.seen("hello", lambda frame: frame["limits"]["depth_mm"].get("trip") == [None, 3.0])


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--token-file", "none"], "No such file"),
        (["--port", "70000"], "70000"),
        (["--host", "no.such.host.invalid", "--port", "0"], "cannot listen on"),
        (["surplus"], "unrecognized arguments: surplus"),
    ],
)
def test_wrong_arguments_are_told_in_a_line(domain_id, capfd, arguments, text):
    try:
        code = main.main(["run_hmi.py", *arguments])
    except SystemExit as ended:
        code = ended.code
    assert code == 2
    assert text in capfd.readouterr().err.strip().splitlines()[-1]


def test_further_pages_are_those_that_are_registered(tmp_path, monkeypatch):
    registered = {"history": lambda folder: f"<p>{folder.name}</p>"}
    monkeypatch.setattr(hmi_node, "all_loaded", {"fsw.pages": registered}.__getitem__)
    assert pages_of("") == {}
    assert pages_of(str(tmp_path / "welds"))["history"]() == "<p>welds</p>"
    registered.clear()
    assert pages_of(str(tmp_path)) == {}


def test_procedure_changed_after_signing_is_refused(tmp_path):
    pytest.importorskip(
        "securesystemslib", reason="not installed: pip install -r requirements/signing.lock"
    )
    file, key = tmp_path / "lid.yaml", tmp_path / "key"
    file.write_text(yaml.safe_dump(short_procedure().model_dump(mode="json", exclude_none=True)))
    assert book_of("") is default() and book_of(str(file)).id == "copper_lid"
    make_key(key)
    signed = sign(
        file.read_bytes(), file.name, Purpose.PROCEDURE, load_private(key), datetime.now(UTC)
    )
    signature_path(file).write_text(signed)
    assert book_of(str(file)).id == "copper_lid"
    file.write_text(file.read_text().replace("910.0", "911.0"))
    with pytest.raises(EvidenceError) as caught:
        book_of(str(file))
    assert [finding.code for finding in caught.value.findings] == [Code.CONTENT_CHANGED]
