"""The operator's page at a real weld.

Everything as processes, in lockstep where no time is what is tested.
"""

import itertools
import json
import signal

import pytest
import rclpy
from rclpy.context import Context
from rclpy.qos import QoSProfile

from fsw_control import messages_ros as convert
from fsw_control.contract import Reference
from fsw_control.free_domain import free_domain
from fsw_control.topics_ros import LATCHED, LATEST
from fsw_hmi.control_room import LOST
from fsw_msgs.msg import OperatorAction, SupervisorState, WeldCommand, WeldReference
from fsw_recorder.bag_reader import BagReader
from fsw_scenario.graph import STANDBY
from fsw_scenario.launcher import ABORTED, Launcher
from fsw_scenario.scenario_file import parse
from fsw_test_support.bags import decode
from fsw_test_support.page_client import Page
from fsw_test_support.patient_weld import PATIENT_ARGUMENTS, PatientWeld
from fsw_test_support.ros_graph import Spinner
from fsw_test_support.waiting import wait_for_text

DEEP = QoSProfile(depth=2000)
TICK_NS = 100_000_000
MODULES = {
    "decentral": "fsw_decentral.decentral_node",
    "nmpc": "fsw_nmpc.nmpc_node",
    "supervisor": "fsw_supervisor.supervisor_node",
    "standby": "fsw_supervisor.supervisor_node",
    "plant": "fsw_plant.plant_node",
}
PARTS = tuple(MODULES)
PROGRAMME = """
name: small_weld
announced: true
plant: {start.temperature_c: 820.0}
phases:
  - {name: dwell, duration_s: 2.0}
  - {name: joint_line, to_deg: 20.0, set_points: [{at_s: 1.0, temperature_c: 825.0, over_s: 10.0}]}
"""


class Weld(Spinner):
    """Processes of a weld with an observer, and a page."""

    def __init__(self, folder, domain, launcher):
        self.folder, self.launcher = folder, launcher
        self.context = Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        super().__init__(self.context)
        self.node = node = rclpy.create_node("observer", context=self.context)
        self.executor.add_node(node)
        self.actions, self.commands, self.states, self.stated = [], [], [], []
        node.create_subscription(
            OperatorAction, "fsw/operator_action", self.actions.append, LATCHED
        )
        node.create_subscription(WeldCommand, "fsw/command", self.commands.append, DEEP)
        node.create_subscription(
            SupervisorState, "fsw/supervisor/state", self.states.append, LATEST
        )
        node.create_subscription(
            WeldReference, "fsw/supervisor/reference", self.stated.append, LATEST
        )
        self.page = None

    def close(self):
        if self.page is not None:
            self.page.socket.socket.close()
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()

    def serve(self, *arguments):
        """Start the page's server."""
        patient = [
            "--ros-args",
            "-p",
            "request_timeout_s:=60.0",
        ]  # a machine may stand still for some time
        self.launcher.start("hmi", "fsw_hmi.main", ["--port", "0", *patient, *arguments])
        self.url = wait_for_text(self.launcher, "hmi", r"http://\S+")
        self.token = wait_for_text(self.launcher, "hmi", r"token: \S+").split()[1]

    def command(self):
        """Open a page, log in and take control."""
        self.page = Page(self.url)
        return self.page.command(self.token)

    def start(self, *names, waits=0, lockstep=False):
        for name in names:
            arguments = {
                "plant": ["-p", f"wait_for_subscribers:={waits}", "-p", "lockstep_timeout_s:=0.2"],
                "supervisor": PATIENT_ARGUMENTS,
                "standby": ["-r", f"__node:={STANDBY}", "-p", "standby:=true", *PATIENT_ARGUMENTS],
            }.get(name, [])
            if lockstep:
                given = (
                    ("clock:=simulated", "speed:=0.0")
                    if name == "plant"
                    else ("use_sim_time:=true",)
                )
                patient = ("lockstep_deadline_s:=60.0", "lockstep_shadow_wait_s:=60.0")
                given += patient if name in ("supervisor", "standby") else ()
                arguments = [
                    *arguments,
                    *(word for parameter in given for word in ("-p", parameter)),
                ]
            self.launcher.start(
                name, MODULES[name], ["--ros-args", *arguments] if arguments else []
            )

    def start_weld(self, *arguments, lockstep=False):
        """Start all parts and the page, and give the first set-points."""
        self.serve(*arguments)
        self.start(*PARTS, waits=len(PARTS) - 1, lockstep=lockstep)
        page = self.command()
        page.until("tick")
        page.seen(
            "state", lambda frame: "no set-point yet" in frame["reason"]
        )  # a controller waits for them
        answer = page.ask("set_reference", depth_mm=2.66, temperature_c=816.4)
        assert answer["outcome"] == "done", answer
        page.seen("state", lambda frame: frame["actual_mode"] == "auto")
        return page

    def mode(self):
        return self.states[-1].actual_mode if self.states else ""

    def unanswered_ticks(self):
        """Gaps between the commands that this observer has heard, some of them twice."""
        stamps = sorted({convert.stamp_ns(command.header.stamp) for command in self.commands})
        return sum(round((b - a) / TICK_NS) - 1 for a, b in itertools.pairwise(stamps))


@pytest.fixture
def weld(tmp_path):
    with free_domain() as domain, Launcher(tmp_path / "log", domain) as launcher:
        weld = Weld(tmp_path, domain, launcher)
        yield weld
        weld.close()


def junk_from_strangers(weld):
    """All of it is refused; that none of it acts, the actions that are recorded show."""
    for text in (
        "null",
        "{}",
        '{"id":1,"do":"safe_stop"}',
        "[" * 4000,
        "\x00",
        json.dumps({"id": 2, "do": "mode"}),
    ):
        with Page(weld.url) as stranger:
            stranger.socket.send(text)
            stranger.socket.send(text.encode())
            assert stranger.ask("safe_stop")["outcome"] == "refused"


@pytest.mark.requirement("S18")
def test_a_person_steers_the_weld_by_the_page_and_all_of_it_is_recorded(weld):
    page = weld.start_weld("-p", "local_stop:=false", lockstep=True)
    junk_from_strangers(weld)
    swapped = page.ask("switch", controller="nmpc", wait_s=5)
    assert swapped["outcome"] == "done", swapped
    page.seen("state", lambda frame: frame["actual_controller"] == "nmpc")
    page.seen("prediction", lambda frame: frame["controller"] == "nmpc")
    unknown = page.ask("switch", controller="nobody", wait_s=0)
    assert (unknown["outcome"], unknown["code"] == "unknown_controller") == ("refused", True)
    assert (
        page.ask("set_reference", depth_mm=2.68, temperature_c=818.4, ramp=True)["outcome"]
        == "done"
    )
    page.until("tick", lambda _: page.value("reference_temperature_c") == 818.4)
    assert page.value("reference_depth_mm") == 2.68
    assert page.ask("mode", mode="hold")["outcome"] == "done"
    page.seen("state", lambda frame: frame["actual_mode"] == "hold")
    assert page.ask("mode", mode="auto")["outcome"] == "done"
    page.seen("state", lambda frame: frame["actual_mode"] == "auto")
    assert page.ask("safe_stop")["outcome"] == "done"
    page.seen("state", lambda frame: frame["actual_mode"] == "safe_stop")
    page.seen("alarms", lambda frame: any(alarm["id"] == "safe_stop" for alarm in frame["alarms"]))
    weld.until(lambda: len(weld.actions) == 9, "all actions")
    assert [(action.action, action.outcome) for action in weld.actions] == [
        ("log in", "done"),
        ("take control", "done"),
        ("set-points 2.66 mm, 816.4 °C", "done"),
        ("switch to nmpc", "done"),
        ("switch to nobody", "refused"),
        ("set-points 2.68 mm, 818.4 °C, ramp", "done"),
        ("mode hold", "done"),
        ("mode auto", "done"),
        ("safe stop", "done"),
    ]
    assert {action.who for action in weld.actions} == {f"anna ({page.frames['hello']['session']})"}
    weld.until(lambda: weld.mode() == "safe_stop", "the safe stop")


@pytest.mark.full
def test_page_killed_in_a_ramp_changes_nothing(weld):
    """In lockstep, so that no tick is lost because the machine is busy."""
    page = weld.start_weld(lockstep=True)
    weld.until(lambda: weld.commands and weld.mode() == "auto", "control")
    transitions = weld.states[-1].transitions
    answer = page.ask("set_reference", depth_mm=2.66, temperature_c=820.4, ramp=True)
    assert answer["outcome"] == "done", answer
    weld.launcher.children["hmi"].process.send_signal(signal.SIGKILL)
    goal = Reference(2.66, 820.4)
    weld.until(
        lambda: weld.stated and convert.reference(weld.stated[-1]) == goal, "the end of the ramp"
    )
    assert weld.unanswered_ticks() == 0
    weld.serve()  # again
    with Page(weld.url) as reloaded:
        reloaded.until("tick", lambda _: reloaded.value("reference_temperature_c") == 820.4)
    count = len(weld.commands)
    weld.until(lambda: len(weld.commands) > count + 5, "more commands")
    assert (weld.mode(), weld.states[-1].transitions) == ("auto", transitions)
    assert weld.unanswered_ticks() == 0


@pytest.mark.real_time
@pytest.mark.requirement("S19")
def test_safe_stop_while_the_supervisor_changes(weld):
    page = weld.start_weld()
    weld.launcher.children["supervisor"].process.send_signal(signal.SIGKILL)
    answer = page.ask("safe_stop")
    assert answer["outcome"] == "done", answer
    weld.until(lambda: weld.mode() == "safe_stop", "the safe stop")


def recorded_actions(folder):
    with BagReader(folder) as bag:
        recorded = [decode(bag, record) for record in bag.records(topics=["/fsw/operator_action"])]
    return [(action.action, action.outcome) for action in recorded] or [("", "")]


@pytest.mark.real_time
@pytest.mark.full
def test_programme_is_held_changed_by_hand_and_resumed(weld):
    scenario = parse(PROGRAMME)
    weld.serve()
    graph = PatientWeld(scenario, weld.folder / "weld", ["decentral", "nmpc"], realtime=True)
    graph.start(weld.launcher)
    page = weld.command()
    # not its first report, so that the supervisor has heard of the programme, too
    page.seen(
        "progress", lambda frame: (frame["state"], frame["phase"]) == ("running", "joint_line")
    )
    refused = page.ask("set_reference", depth_mm=2.7, temperature_c=822)
    assert (refused["outcome"], refused["code"]) == ("refused", "programme_runs")
    assert page.ask("weld", action="hold")["outcome"] == "done"
    page.seen("progress", lambda frame: frame["state"] == "held")
    assert page.ask("set_reference", depth_mm=2.7, temperature_c=822)["outcome"] == "done"
    page.until("tick", lambda _: page.value("reference_temperature_c") == 822.0)
    assert page.ask("weld", action="resume")["outcome"] == "done"
    page.until("tick", lambda _: page.value("reference_temperature_c") == 825.0)
    assert page.ask("weld", action="abort")["outcome"] == "done"
    weld.until(lambda: not weld.launcher.children["scenario"].running, "the end of the player")
    assert weld.launcher.children["scenario"].process.returncode == ABORTED
    weld.until(lambda: weld.mode() == "safe_stop", "the safe stop")
    count = len(weld.commands)
    weld.until(lambda: len(weld.commands) >= count + 20, "two seconds more of the weld")
    assert weld.mode() == "safe_stop"
    weld.until(lambda: recorded_actions(graph.bag)[-1][0] == "weld abort", "the record")
    weld.launcher.stop("recorder")
    # on a busy machine the page may be taken for gone while nothing reads it
    assert [action for action in recorded_actions(graph.bag) if action[0] != LOST][-5:] == [
        ("set-points 2.7 mm, 822 °C", "refused"),
        ("weld hold", "done"),
        ("set-points 2.7 mm, 822 °C", "done"),
        ("weld resume", "done"),
        ("weld abort", "done"),
    ]
