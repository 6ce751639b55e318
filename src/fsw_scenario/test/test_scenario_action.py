"""The action fsw/run_weld.

Goals, feedback, cancellation and results of a player that waits for them.
"""

import json
from math import isnan

import pytest
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.action import ActionClient

from fsw_control import messages_ros as convert
from fsw_control.contract import Reference
from fsw_control.topics_ros import LATEST, STREAM
from fsw_msgs.action import RunWeld
from fsw_msgs.msg import Reason, SupervisorState, WeldCommand
from fsw_msgs.srv import SetDisturbance, SetMode, SwitchController
from fsw_test_support.player_graph import PlayerGraph
from fsw_test_support.waiting import PATIENCE_S

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("domain_id")]
SHORT = {
    "name": "short",
    "duration_s": 3.0,
    "events": [
        {"at_s": 1.0, "reference": {"depth_mm": 2.86}},
        {"at_s": 2.0, "disturbance": {"channel": "depth", "shape": "step", "amplitude_mm": 0.1}},
    ],
}
LONG = {"name": "long", "phases": [{"name": "dwell", "duration_s": 60.0}]}


class Caller(PlayerGraph):
    """A client of a player that waits for goals, beside an emulated plant that takes disturbances."""

    def __init__(self, *parameters):
        super().__init__("", *parameters)
        self.asked, self.feedback = [], []
        self.peer.create_service(SetDisturbance, "fsw/plant/set_disturbance", self.on_disturbance)
        self.states = self.peer.create_publisher(SupervisorState, "fsw/supervisor/state", LATEST)
        self.reports = self.peer.create_publisher(DiagnosticArray, "/diagnostics", STREAM)
        self.client = ActionClient(self.peer, RunWeld, "fsw/run_weld")
        self.until(self.client.server_is_ready, "the action")
        self.until(
            lambda: self.reports.get_subscription_count(), "the player to listen to diagnostics"
        )

    def on_disturbance(self, request, response):
        self.asked.append((self.weld.machine.tick, request.channel, round(request.amplitude, 9)))
        response.ok = True
        return response

    def send(self, content, overrides=()):
        text = content if isinstance(content, str) else json.dumps(content)
        goal = RunWeld.Goal(scenario=text, overrides=list(overrides))
        future = self.client.send_goal_async(
            goal, feedback_callback=lambda message: self.feedback.append(message.feedback)
        )
        self.until(future.done, "the answer to the goal")
        return future.result()

    def begin(self, content, overrides=()):
        handle = self.send(content, overrides)
        self.until(lambda: self.weld.listening and self.listens(), "the beginning")
        self.before = self.number
        return handle

    def result(self, handle):
        future = handle.get_result_async()
        self.until(future.done, "the result")
        return future.result()

    def refusal(self, content):
        answer = self.result(self.send(content))
        assert (answer.status, answer.result.verdict) == (GoalStatus.STATUS_ABORTED, "refused")
        return answer.result

    def supervisor_answers(self):
        def on_mode(request, response):
            response.ok, response.message = True, f"the mode is {request.mode}"
            return response

        self.peer.create_service(SetMode, "fsw/set_mode", on_mode)


@pytest.fixture
def caller():
    graph = Caller()
    yield graph
    graph.end()


def test_consecutive_goals_do_not_affect_each_other(caller):
    pair = KeyValue(key="bag", value="out/weld_7")
    caller.reports.publish(
        DiagnosticArray(status=[DiagnosticStatus(name="fsw_recorder: recording", values=[pair])])
    )
    caller.until(lambda: caller.player.bag)
    for _ in range(2):
        caller.asked.clear()
        handle = caller.begin(SHORT, ["events[0].reference.depth_mm=2.76"])
        for _ in range(29):
            caller.tick()
        caller.number += 1
        caller.depth(caller.number)
        answer = caller.result(handle)
        assert (answer.status, answer.result.verdict) == (GoalStatus.STATUS_SUCCEEDED, "done")
        assert answer.result.bag == "out/weld_7"
        # the depth shown is 2.66 mm throughout; the set-point is 2.76 mm from the tenth tick on
        assert answer.result.kpi.depth_max_error == pytest.approx(0.1e-3)
        assert answer.result.kpi.depth_iae == pytest.approx(2.1 * 0.1e-3)
        [(tick, *what)] = caller.asked
        assert (tick >= 19, what) == (
            True,
            ["depth", 0.1e-3],
        )  # what is asked for begins with the next tick
        assert caller.weld is None
        caller.until(
            lambda: caller.peer.count_publishers("fsw/reference") == 1, "its publishers' end"
        )
        caller.until(
            lambda: (
                not any(
                    publisher.get_subscription_count() for publisher in caller.sensors.values()
                )
            ),
            "its subscriptions' end",
        )
    assert caller.feedback[-1].progress.state == "done"
    times_left = [item.progress.time_left for item in caller.feedback[:3]]
    assert times_left == pytest.approx([2.9, 1.9, 0.9])


def test_one_weld_at_a_time_and_a_second_goal_gets_the_reason(caller):
    caller.begin(LONG)
    caller.tick()
    refused = caller.refusal(SHORT)
    assert refused.code == "under_way" and caller.weld.machine.describe().words in refused.message
    caller.tick()
    assert not caller.weld.finished


@pytest.mark.parametrize(
    ("content", "code", "names"),
    [
        ("", "empty", "scenario"),
        ("no_such_scenario", "invalid", "no_such_scenario"),
        ("{name: short, duration_s: -1}", "invalid", "duration_s = -1"),
        ("{name: [", "invalid", "YAML"),
        ("open_loop_force_steps", "by_open_loop", "open_loop_force_steps"),
        ("canister_weld_heat", "on_canister", "canister_weld_heat"),
    ],
)
def test_wrong_goals_are_rejected_with_the_reason(caller, content, code, names):
    refused = caller.refusal(content)
    assert refused.code == code and names in refused.message
    assert caller.weld is None


def test_disturbances_need_the_emulated_plant(domain_id):
    caller = Caller()
    [service] = [
        service for service in caller.peer.services if service.srv_name.endswith("set_disturbance")
    ]
    caller.peer.destroy_service(service)
    caller.until(
        lambda: (
            not any(
                "set_disturbance" in name
                for name, _ in caller.player.get_service_names_and_types()
            )
        )
    )
    assert caller.refusal(SHORT).code == "no_emulator"
    caller.end()


@pytest.mark.parametrize("content", [LONG, SHORT], ids=["programme", "scenario"])
def test_a_cancelled_weld_is_canceling_until_the_safe_stop_and_a_new_one_may_follow(
    caller, content
):
    handle = caller.begin(content)
    caller.tick()
    cancelled = handle.cancel_goal_async()
    caller.until(cancelled.done, "the answer to the cancellation")
    assert len(cancelled.result().goals_canceling) == 1
    caller.tick()
    caller.until(lambda: handle.status == GoalStatus.STATUS_CANCELING, "the status")
    again = handle.cancel_goal_async()
    caller.until(again.done, "the answer to the second cancellation")
    assert not again.result().goals_canceling
    caller.supervisor_answers()
    answer = caller.result(handle)
    assert (answer.status, answer.result.verdict) == (GoalStatus.STATUS_CANCELED, "aborted")
    assert answer.result.code == "cancelled" and "safe_stop" in answer.result.message
    caller.begin(content)


@pytest.mark.parametrize("content", [LONG, SHORT], ids=["programme", "scenario"])
def test_a_safe_stop_by_the_supervisor_aborts_the_goal(caller, content):
    handle = caller.begin(content)
    caller.tick()
    caller.states.publish(
        SupervisorState(
            actual_mode="safe_stop", why=[Reason(code=Reason.OTHER, detail="an interlock")]
        )
    )
    answer = caller.result(handle)
    assert (answer.status, answer.result.verdict) == (GoalStatus.STATUS_ABORTED, "aborted")
    assert answer.result.code == "stopped" and "an interlock" in answer.result.message


@pytest.mark.parametrize(
    "change", [{"controller": "unknown"}, {"events": [{"at_s": 1.0, "switch": "unknown"}]}]
)
def test_weld_without_its_controller_fails_before_the_first_tick(caller, change, monkeypatch):
    monkeypatch.setattr("fsw_scenario.weld_player_ros._CONTROLLER_S", 0.2)
    here = caller.peer.create_publisher(WeldCommand, "fsw/decentral/proposal", STREAM)
    caller.until(lambda: caller.player.count_publishers(here.topic_name), "the other controller")
    requests = []

    def on_request(request, response):
        requests.append(request)
        return response

    caller.peer.create_service(SwitchController, "fsw/switch_controller", on_request)
    answer = caller.result(caller.send(SHORT | change))
    assert (answer.status, answer.result.verdict) == (GoalStatus.STATUS_ABORTED, "failed")
    assert answer.result.code == "no_controller"
    assert "'unknown'" in answer.result.message and "decentral" in answer.result.message
    assert not requests and not caller.follows and not caller.feedback


def test_weld_begins_once_its_controller_joins(caller, monkeypatch):
    monkeypatch.setattr("fsw_scenario.weld_player_ros._CONTROLLER_S", PATIENCE_S)
    sent = caller.send(SHORT, ["controller=unknown"])
    caller.until(lambda: caller.weld is not None and "'unknown'" in caller.weld.missing())
    assert not caller.weld.listening
    caller.peer.create_publisher(WeldCommand, "fsw/unknown/proposal", STREAM)
    caller.until(lambda: caller.weld.listening and caller.listens(), "the beginning")
    caller.states.publish(SupervisorState(actual_controller="decentral"))
    caller.until(lambda: caller.weld.controller, "the supervisor's state")
    for _ in range(29):
        caller.tick()
    caller.number += 1
    caller.depth(caller.number)
    answer = caller.result(sent)
    assert answer.result.code == "over"
    assert answer.result.unrequested == ["decentral"]
    assert list(answer.result.unrequested_time) == pytest.approx([0.9])
    assert isnan(answer.result.by_hand_from)


def test_manual_set_points_stay_in_force_and_are_reported(caller):
    handle = caller.begin(SHORT)
    for _ in range(5):
        caller.tick()
    caller.by_hand.publish(convert.reference_message(Reference(2.65, 815.0), 0))
    # ticks follow each other faster than a message travels: it has arrived before the next one
    caller.until(
        lambda: caller.in_force == Reference(2.65, 815.0) and caller.weld.set_points.are_by_hand()
    )
    caller.until(
        lambda: (
            caller.tick() == Reference(2.65, 815.0) and not caller.weld.set_points.course.followed
        )
    )
    while caller.number < 29:
        assert caller.tick() == Reference(2.65, 815.0)
    caller.number += 1
    caller.depth(caller.number)
    answer = caller.result(handle)
    assert answer.result.verdict == "done" and not answer.result.unrequested
    assert 0.5 <= answer.result.by_hand_from < 3.0
    assert caller.feedback[-1].progress.left


def test_weld_continues_without_its_client(caller):
    caller.begin(LONG)
    caller.tick()
    caller.client.destroy()
    for _ in range(20):
        caller.tick()
    assert caller.weld.machine.describe().data["state"] == "running"


def test_a_weld_without_measurements_has_failed_and_the_player_stays(domain_id):
    caller = Caller("silence_timeout_s:=1.0")
    handle = caller.begin(LONG)
    answer = caller.result(handle)
    assert (answer.status, answer.result.verdict) == (GoalStatus.STATUS_ABORTED, "failed")
    assert answer.result.code == "silent" and "fsw/depth" in answer.result.message
    caller.begin(LONG)
    caller.end()
