"""The player among real topics: stamps that are not believed; hold, set-points by hand, resume."""

import re
from unittest.mock import create_autospec

import pytest
import rclpy
import yaml
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.task import Future
from std_msgs.msg import Header

from fsw_control import messages_ros as convert
from fsw_control.coded import Fact, RefusedError
from fsw_control.contract import Reference
from fsw_control.ranges import WELD_RATE_DEPTH_MM_PER_S, WELD_RATE_TEMPERATURE_C_PER_S
from fsw_control.topics_ros import LATEST, PLAYER_READY
from fsw_model import nominal
from fsw_model.heat_profile import HeatProfile, HeatSource, ThermalModel
from fsw_msgs.action import RunWeld
from fsw_msgs.msg import HeatPlan, SupervisorState, WeldReferencePlan
from fsw_msgs.srv import SetMode, SwitchController
from fsw_scenario.discovery_ros import Discovery
from fsw_scenario.launcher import ABORTED
from fsw_scenario.running_kpi import HeldFor, Outcome, WeldEnd
from fsw_scenario.scenario_node import ALONE_S, ScenarioNode
from fsw_scenario.set_points_ros import SetPoints
from fsw_test_support import player_graph
from fsw_test_support.player_graph import START_NS, STEP_NS, PlayerGraph
from fsw_test_support.waiting import PATIENCE_S

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("domain_id")]
WELD = {
    "name": "short",
    "phases": [
        {
            "name": "dwell",
            "duration_s": 60.0,
            "set_points": [{"at_s": 1.0, "temperature_c": 818.4, "over_s": 2.0}],
        }
    ],
}


@pytest.fixture
def graph(tmp_path):
    path = tmp_path / "weld.yaml"
    path.write_text(yaml.safe_dump(WELD))
    player_graph = PlayerGraph(str(path))
    yield player_graph
    player_graph.end()


def heat_profile():
    """A profile along 30 mm."""
    return HeatProfile(
        type="short",
        model=ThermalModel.of(nominal()),
        welds=(HeatSource(weld="C001", sha256="a" * 64),),
        travel_mm=(0.0, 30.0),
        heat_kw=(0.0, 1.0),
        deviation_kw=(0.1, 0.1),
    )


def test_known_heat_is_announced_withdrawn_by_a_hold_and_comes_back_later(tmp_path):
    """The path resumes later, by the time that the tool stood."""
    phases = [*WELD["phases"], {"name": "start", "to_deg": 3.0, "length_mm": 30.0}]
    weld = WELD | {"phases": phases, "announced": True}
    (tmp_path / "weld.yaml").write_text(yaml.safe_dump(weld))
    (tmp_path / "heat.yaml").write_text(heat_profile().text)
    graph = PlayerGraph(str(tmp_path / "weld.yaml"), f"heat_file:={tmp_path / 'heat.yaml'}")
    plans, announced = [], []
    graph.peer.create_subscription(HeatPlan, "fsw/heat_plan", plans.append, LATEST)
    graph.peer.create_subscription(
        WeldReferencePlan, "fsw/reference_plan", announced.append, LATEST
    )
    try:
        graph.tick()
        graph.until(lambda: len(plans) == 1)
        begun = convert.heat_plan(plans[0])
        assert (begun.type, begun.profile) == ("short", heat_profile().sha256)
        assert begun.place(begun.at_s[-1]) == pytest.approx(30.0)
        assert begun.at_s[0] == pytest.approx(START_NS * 1e-9, abs=0.2)
        graph.ask("hold")
        graph.until(lambda: len(plans) == 2)
        assert convert.heat_plan(plans[1]) is None
        for _ in range(3):
            graph.tick()
        graph.ask("resume")
        graph.until(lambda: len(plans) == 3 and len(announced) == 3)
        later = convert.heat_plan(plans[2])
        assert later.at_s[0] - begun.at_s[0] == pytest.approx(0.3, abs=1e-3)
        for plan in (plans[2], announced[2]):
            assert convert.stamp_ns(plan.header.stamp) == graph.weld.time.stamp_ns
    finally:
        graph.end()


def test_one_depth_stamp_far_ahead_does_not_end_the_programme(graph):
    for _ in range(3):
        graph.tick()
    graph.depth(36_000)
    for _ in range(3):
        graph.tick()
    assert not graph.weld.finished
    assert graph.weld.machine.tick == graph.number
    assert graph.weld.machine.held == 0


def test_held_programme_stands_still_until_it_is_resumed(graph):
    for _ in range(5):
        before = graph.tick()
    graph.until(lambda: graph.follows.n_waiting == 20, "the ramp that is sent ahead")
    refused = graph.ask("resume")
    assert refused.code == "not_possible" and not refused.ok
    assert graph.ask("hold").ok
    graph.until(lambda: graph.progress[-1].state == "held", "the hold")
    held = graph.progress[-1]
    graph.until(
        lambda: graph.in_force and graph.follows.mark == "programme 1",
        "the set-points of the hold",
    )
    for _ in range(60):
        assert graph.tick() == before, "the set-points that were sent ahead are void"
    refused = graph.ask("hold")
    assert refused.code == "not_possible" and not refused.ok
    graph.until(
        lambda: (
            graph.tick()
            and convert.stamp_ns(graph.progress[-1].header.stamp) > START_NS + 60 * STEP_NS
        ),
        "a report",
    )
    now = graph.progress[-1]
    assert (now.state, now.angle, now.length, now.time_left) == (
        "held",
        held.angle,
        held.length,
        held.time_left,
    )
    assert graph.ask("resume").ok
    graph.until(lambda: graph.tick().temperature_c == 818.4, "the set-point that was put off")
    assert graph.progress[-1].state == "running"


@pytest.mark.parametrize("verb", ["hold", "resume"])
def test_a_scenario_without_phases_refuses_to_be_held(verb):
    """Without the service 'ros2 service call' would wait for ever."""
    graph = PlayerGraph("quick")
    try:
        graph.tick()
        refused = graph.ask(verb)
    finally:
        graph.end()
    assert refused.code == "no_phases" and not refused.ok


def test_late_result_of_a_long_weld_keeps_its_verdict(graph, monkeypatch):
    graph.tick()
    player = graph.player
    player._began_s -= 3600.0
    monkeypatch.setattr(
        ScenarioNode, "_on_result", lambda *_: None, raising=False
    )  # it never arrives
    played = Outcome("done", Fact.of(WeldEnd.OVER, scenario="played", time_s=1.0))
    player._over.set_result(played)
    graph.until(lambda: player.ended is not None, "the end")
    assert player.ended is played


@pytest.mark.parametrize("first", ["", "hold"])
def test_aborted_programme_repeats_its_request_for_a_safe_stop(graph, first, capsys):
    graph.tick()
    if first:
        assert graph.ask(first).ok
    assert graph.ask("abort", "anna (3f2a)").ok
    graph.until(lambda: graph.progress[-1].state == "aborted", "the report")
    assert graph.ask("abort", "bert (4e3b)").code == "not_possible"
    asked = []

    def on_mode(request, response):
        asked.append((request.mode, request.who))
        response.ok, response.message = len(asked) > 1, "the mode is safe_stop"
        return response

    graph.peer.create_service(SetMode, "fsw/set_mode", on_mode)
    with pytest.raises(SystemExit) as ended:
        graph.until(lambda: False)
    assert ended.value.code == ABORTED
    assert asked == [("safe_stop", "anna (3f2a)")] * 2
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert last.startswith("scenario: ") and "phase dwell" in last and "safe_stop" in last


def test_resume_goes_back_to_the_programme_and_the_next_hold_steps_nothing(graph):
    for _ in range(40):
        graph.tick()
    programme = Reference(2.66, 818.4)
    graph.until(lambda: graph.in_force == programme)
    assert graph.ask("hold").ok
    graph.by_hand.publish(convert.reference_message(Reference(2.65, 815.0), 0))
    graph.until(
        lambda: (
            graph.in_force.temperature_c == 815.0
            and graph.weld.set_points.received.at(0) != programme
        )
    )
    graph.until(lambda: graph.tick().temperature_c == 815.0 and graph.progress[-1].way_back > 3.0)
    assert graph.progress[-1].left and graph.progress[-1].temperature == 818.4
    answer = graph.ask("resume")
    assert answer.ok
    assert re.search(r"\b815 degC .* 2\.66 mm, 818\.4 degC", answer.message)
    before = graph.in_force
    for _ in range(60):
        after = graph.tick()
        assert abs(after.depth_mm - before.depth_mm) <= 3 * 0.1 * WELD_RATE_DEPTH_MM_PER_S
        assert (
            abs(after.temperature_c - before.temperature_c)
            <= 3 * 0.1 * WELD_RATE_TEMPERATURE_C_PER_S
        )
        before = after
    # the player keeps what it has received itself, also of its own set-points
    graph.until(
        lambda: (
            graph.in_force.temperature_c == graph.weld.set_points.in_force().temperature_c == 818.4
        )
    )
    before = graph.in_force
    assert graph.ask("hold").ok
    assert graph.tick() == graph.in_force == before


def test_set_points_by_hand_in_the_running_programme_stay_until_a_resume(graph):
    for _ in range(10):
        graph.tick()
    assert not graph.ask("resume").ok
    graph.by_hand.publish(convert.reference_message(Reference(2.65, 815.0), 0))
    graph.until(lambda: graph.in_force.temperature_c == 815.0)
    graph.until(lambda: graph.tick() and graph.progress[-1].left)
    for _ in range(30):
        assert graph.tick().temperature_c == 815.0
    assert graph.progress[-1].state == "running"
    assert graph.ask("resume").ok
    graph.until(lambda: graph.tick().temperature_c == 818.4)


def test_lockstep_measures_after_the_set_points_have_arrived(tmp_path, monkeypatch):
    path = tmp_path / "scenario.yaml"
    path.write_text(yaml.safe_dump({"name": "steps", "duration_s": 5.0, "announced": True}))
    answers = []

    def have_arrived(set_points):
        assert all(publisher.wait_for_all_acked() for publisher in set_points.publishers)
        answers.append(len(answers) == 3)
        return answers[-1]

    monkeypatch.setattr(SetPoints, "have_arrived", have_arrived)
    graph = PlayerGraph(str(path), "use_sim_time:=true")
    try:
        assert answers == [False, False, False, True], "the sensors were not subscribed to before"
    finally:
        graph.end()


class SwitchGraph(PlayerGraph):
    """A supervisor that does not answer a switch yet, and a plant that waits for the player."""

    def __init__(self, path):
        super().__init__(str(path), "use_sim_time:=true")
        self.requests, self.permitted = [], []
        self.peer.create_subscription(Header, PLAYER_READY, self.on_ready, LATEST)
        self.states = self.peer.create_publisher(SupervisorState, "fsw/supervisor/state", LATEST)

    def offer(self, answers):
        """Offer the service; without ``answers`` a request has no answer as long as it pends."""

        async def on_request(request, response):
            self.requests.append((request.name, request.strictness, request.timeout.sec))
            if not answers:
                await Future()
            return response

        group = ReentrantCallbackGroup()
        name = "fsw/switch_controller"
        self.peer.create_service(SwitchController, name, on_request, callback_group=group)

    def on_ready(self, message):
        self.permitted.append(round((convert.stamp_ns(message.stamp) - START_NS) / STEP_NS))


@pytest.fixture
def switching(tmp_path, monkeypatch):
    path = tmp_path / "scenario.yaml"
    events = [{"at_s": 0.3, "switch": "decentral"}]
    path.write_text(yaml.safe_dump({"name": "swap", "duration_s": 5.0, "events": events}))
    monkeypatch.setattr(Discovery, "absent", lambda _: "")
    monkeypatch.setattr(player_graph, "START_NS", 0)
    monkeypatch.setattr(f"{__name__}.START_NS", 0)
    monkeypatch.setattr("fsw_scenario.switching_ros._DELIVERY_S", PATIENCE_S)
    graph = SwitchGraph(path)
    yield graph
    graph.end()


@pytest.mark.parametrize("answers", [False, True])
def test_in_lockstep_the_plant_steps_when_the_supervisor_has_a_request(switching, answers):
    """It reports the new target, or answers: a refusal."""
    graph = switching
    while not (graph.weld and graph.weld._switching.pending):
        graph.until(lambda: graph.number == 0 or graph.permitted[-1:] == [graph.number])
        graph.tick()
    asked = graph.number
    # the request is not even sent: nothing but its receipt permits the plant's next step
    graph.until(lambda: graph.permitted[-1:] == [asked - 1])
    graph.offer(answers)
    graph.until(lambda: graph.requests == [("decentral", 1, 5)])
    if not answers:
        assert graph.permitted[-1] == asked - 1
        graph.states.publish(SupervisorState(target_controller="nmpc"))
        graph.until(lambda: graph.weld._switching._target == "nmpc")
        assert graph.permitted[-1] == asked - 1
        graph.states.publish(SupervisorState(target_controller="decentral"))
    graph.until(lambda: graph.permitted[-1] == asked)


def test_in_lockstep_the_plant_steps_without_a_supervisor_after_a_time(switching, monkeypatch):
    graph = switching
    monkeypatch.setattr("fsw_scenario.switching_ros._DELIVERY_S", 0.2)
    for number in range(1, 6):
        graph.tick()
        graph.until(lambda number=number: graph.permitted[-1:] == [number])


@pytest.mark.parametrize("unmatched", ["/fsw/reference", "/fsw/reference_plan"])
def test_discovery_is_complete_when_all_subscribers_are_matched(unmatched):
    matched = {"/fsw/reference": 2, "/fsw/reference_plan": 1}
    node = create_autospec(Node, instance=True)
    node.count_subscribers.side_effect = dict(matched).get
    publishers = [create_autospec(Publisher, instance=True) for _ in matched]
    for publisher, topic in zip(publishers, matched, strict=True):
        publisher.topic_name = topic
        publisher.get_subscription_count.side_effect = lambda topic=topic: matched[topic]
    discovery = Discovery(node, publishers, wanted=0)
    assert discovery.is_complete()
    matched[unmatched] -= 1
    assert not discovery.is_complete()


@pytest.mark.parametrize("seen_after_s", [0.0, 0.2, 0.45])
@pytest.mark.parametrize("later_s", [0.0, 0.01, 0.3, 0.6, 2.0])
def test_at_most_one_of_two_players_begins(seen_after_s, later_s):
    """However they start, if they see each other within the time for which a player has to be alone."""
    players = [(0.0, HeldFor(ALONE_S)), (later_s, HeldFor(ALONE_S))]
    begun = set()
    seen_s = later_s + seen_after_s
    for now_s in (0.05 * n for n in range(100)):
        for which, (started_s, alone_long) in enumerate(players):
            if now_s >= started_s and alone_long(now_s < seen_s, now_s):
                begun.add(which)
    assert len(begun) <= 1 and (later_s < ALONE_S or begun == {0})
    assert len(begun) == 1 or seen_s < ALONE_S + 0.05


def test_player_refuses_a_goal_while_another_player_is_present(monkeypatch):
    monkeypatch.setattr(ScenarioNode, "_is_alone", lambda _: False)
    rclpy.init(args=[])
    try:
        player = ScenarioNode("")
        with pytest.raises(RefusedError) as caught:
            player.scenario_of(RunWeld.Goal(scenario="quick"))
        assert caught.value.fact.code is WeldEnd.TWO_PLAYERS
        player.destroy_node()
    finally:
        rclpy.try_shutdown()


def test_second_player_reports_that_it_waits(monkeypatch, capfd):
    monkeypatch.setattr(ScenarioNode, "_is_alone", lambda _: False)
    rclpy.init(args=[])
    try:
        player = ScenarioNode("quick")
        player._on_watch()
        player._on_watch()
        player.destroy_node()
    finally:
        rclpy.try_shutdown()
    [warning] = [line for line in capfd.readouterr().err.splitlines() if "scenario player" in line]
    assert "[WARN]" in warning and "60 s" in warning
