"""Every alarm of the page at a real graph.

Raised, shelved, taken back, cleared, raised again, acknowledged.
"""

import signal
import time
from functools import partial
from threading import Event, Thread

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.context import Context
from rclpy.parameter import Parameter

from fsw_control import messages_ros as convert
from fsw_control.cause import AlarmChange
from fsw_control.contract import Command
from fsw_control.free_domain import free_domain
from fsw_control.parameters import defaults
from fsw_control.topics_ros import LATCHED
from fsw_msgs.msg import AlarmEvent, WeldCommand
from fsw_plant import event_schema
from fsw_plant.events import Disturbance
from fsw_plant.services_ros import SERVICES, event_request
from fsw_scenario.graph import STANDBY
from fsw_scenario.launcher import Launcher
from fsw_supervisor.parameters import SupervisorParameters
from fsw_test_support.page_client import Page
from fsw_test_support.patient_weld import PATIENT_ARGUMENTS
from fsw_test_support.ros_graph import Spinner
from fsw_test_support.waiting import PATIENCE_S, wait_for_text

pytestmark = [pytest.mark.real_time, pytest.mark.full]

#: what is cold after a stop is no further cause to stop; an NMPC that cannot heat as it may be
#: asked to
COLD_IS_FINE = [
    "-p",
    "interlocks.temperature_low.warn:=310.0",
    "-p",
    "interlocks.temperature_low.trip:=300.0",
]
SLOW_SPINDLE = ["--ros-args", "-p", "speed_max:=415.0"]
SOON = [
    "-p",
    "deviation_persistence_s:=0.3",
    "-p",
    "quality_persistence_s:=0.3",
    "-p",
    "request_timeout_s:=60.0",
]
SUPERVISOR = "fsw_supervisor.supervisor_node"
PARTS = {
    "decentral": ("fsw_decentral.decentral_node", []),
    "nmpc": ("fsw_nmpc.nmpc_node", SLOW_SPINDLE),
    "supervisor": (SUPERVISOR, ["--ros-args", *PATIENT_ARGUMENTS, *COLD_IS_FINE]),
    "plant": ("fsw_plant.plant_node", []),
    "standby": (
        SUPERVISOR,
        [
            "--ros-args",
            "-r",
            f"__node:={STANDBY}",
            "-p",
            "standby:=true",
            *PATIENT_ARGUMENTS,
            *COLD_IS_FINE,
        ],
    ),
}
#: what an interlock warns of is there when its limit is on the wrong side of the weld's values
WRONG = {
    "temperature_low": 905.0,
    "temperature_high": 700.0,
    "depth_low": 3.2,
    "depth_high": 2.0,
    "depth_deviation_high": -1.0,
    "force_high": 40.0,
    "torque_low": 1200.0,
    "torque_high": 500.0,
    "power_high": 20.0,
    "torque_model_low": 20.0,
    "torque_model_high": -20.0,
    "depth_model_low": 0.5,
    "depth_model_high": -0.5,
    "temperature_model_low": 100.0,
    "temperature_model_high": -100.0,
}
DEFAULTS = defaults(SupervisorParameters)
USUAL = {
    name: {level: DEFAULTS[f"interlocks.{name}.{level}"] for level in ("warn", "trip")}
    for name in WRONG
} | {"temperature_low": {"warn": 310.0, "trip": 300.0}}
DEPTH_MM, TEMPERATURE_C = 2.66, 816.4


class AlarmWeld(Spinner):
    """A weld in processes, a page in control of it, and the journal of alarms."""

    def __init__(self, domain, launcher):
        self.launcher, self.journal = launcher, []
        self.context = Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        super().__init__(self.context)
        self.node = node = rclpy.create_node("bystander", context=self.context)
        self.executor.add_node(node)
        node.create_subscription(AlarmEvent, "fsw/alarms", self.journal.append, LATCHED)
        self.diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 100)
        self.parameters = node.create_client(
            SetParametersAtomically, "fsw_supervisor/set_parameters_atomically"
        )
        self.emulator = {
            kind: node.create_client(*arguments) for kind, arguments in SERVICES.items()
        }
        self.commands = self.another_journal = None
        self.statuses, self.closed = [], Event()
        self.reporter = Thread(target=self._keep_reporting)
        self.reporter.start()
        launcher.start("hmi", "fsw_hmi.main", ["--port", "0", "--ros-args", *SOON])
        url = wait_for_text(launcher, "hmi", r"http://\S+")
        self.page = Page(url).command(wait_for_text(launcher, "hmi", r"token: \S+").split()[1])

    def close(self):
        self.closed.set()
        self.reporter.join()
        self.page.socket.socket.close()
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()

    # ---- what is done

    def start(self, *names):
        for name in names:
            self.launcher.start(name, *PARTS[name])

    def signal(self, number, *names):
        for name in names:
            self.launcher.children[name].process.send_signal(number)

    def kill(self, name):
        self.signal(signal.SIGKILL, name)
        self.launcher.children[name].process.wait()

    def until_done(self, do, **content):
        """Ask until it is done.

        On a busy machine a tick may have been missed, and a controller is not ready yet.
        """
        end_s = time.monotonic() + PATIENCE_S
        while (answer := self.page.ask(do, **content))["outcome"] != "done":
            assert time.monotonic() < end_s, answer
            self.page.until("tick")

    def ask(self, do, **content):
        answer = self.page.ask(do, **content)
        assert answer["outcome"] == "done", answer

    def weld(self):
        """Start all parts of a weld, and wait until it is under way, commanded by the NMPC."""
        self.start("decentral", "nmpc", "supervisor", "plant")
        self.page.until("tick")
        self.page.seen(
            "state", lambda frame: "no set-point yet" in frame["reason"]
        )  # a controller waits for them
        self.refer()
        self.until_auto()
        # one whose library is still being compiled is not yet known
        self.page.seen(
            "state",
            lambda frame: (
                {"nmpc", "decentral"}
                <= {controller["name"] for controller in frame["controllers"]}
            ),
        )
        if self.page.frames["state"]["actual_controller"] != "nmpc":
            self.until_done("switch", controller="nmpc", wait_s=10)
        self.until_auto("nmpc")
        return self

    def refer(self, temperature_c=TEMPERATURE_C, depth_mm=DEPTH_MM):
        self.ask("set_reference", depth_mm=depth_mm, temperature_c=temperature_c)

    def until_auto(self, controller=""):
        self.page.seen(
            "state",
            lambda frame: (
                frame["actual_mode"] == "auto" and controller in ("", frame["actual_controller"])
            ),
        )

    def limit(self, name, **levels):
        """Set the levels of an interlock; by default the usual ones."""
        values = {
            f"interlocks.{name}.{level}": value
            for level, value in ({**USUAL[name], **levels}).items()
        }
        request = SetParametersAtomically.Request(
            parameters=[
                Parameter(key, value=value).to_parameter_msg() for key, value in values.items()
            ]
        )
        result = self.call(self.parameters, request).result
        assert result.successful, result.reason

    def happen(self, event):
        """Disturb the emulated plant, or let one of its sensors fail."""
        client = self.emulator[isinstance(event, Disturbance)]
        result = self.call(client, event_request(event))
        assert result.ok, result.message

    def acknowledge_stop(self):
        for do, content in (("acknowledge_stop", {}), ("mode", {"mode": "auto"})):
            self.until_done(do, **content)
        self.until_auto()

    def report(self, level, text, *nodes):
        """Diagnostics of nodes that are not there, from now on as often as nodes report."""
        self.statuses = [
            DiagnosticStatus(name=f"{node}: part", level=level, message=text, hardware_id="test")
            for node in nodes
        ]

    def _keep_reporting(self):
        while not self.closed.wait(0.5):
            if statuses := self.statuses:
                self.diagnostics.publish(DiagnosticArray(status=statuses))

    def interfere(self):
        """A command of another node."""
        self.commands = self.node.create_publisher(WeldCommand, "fsw/command", 10)
        self.until(lambda: self.commands.get_subscription_count() >= 4, "all who hear commands")
        self.commands.publish(convert.command_message(Command(78.0, 400.0), 0, "stranger"))

    def leave(self):
        self.node.destroy_publisher(self.commands)

    def keep_another_journal(self):
        """As another page does.

        A real one would also tell its own alarms, which this journal could not tell apart.
        """
        self.another_journal = self.node.create_publisher(AlarmEvent, "fsw/alarms", LATCHED)

    def drop_another_journal(self):
        self.node.destroy_publisher(self.another_journal)

    # ---- what is seen

    def alarm(self, name, state, text=""):
        """Wait until an alarm is in a state (``""``: gone) and says a text; returns its row."""

        def row(frame):
            return next((alarm for alarm in frame["alarms"] if alarm["id"] == name), None)

        def is_it(frame):
            alarm = row(frame) or {"state": "", "text": ""}
            return alarm["state"] == state and text in alarm["text"]

        return row(self.page.seen("alarms", is_it))

    def cycle(self, name, start, end, text=""):
        """Raise, shelve, take back, clear, raise again, acknowledge and clear an alarm."""
        start()
        raised = self.alarm(name, "active", text)
        shelved = self.page.ask("shelve", alarm=name, minutes=5, reason="test")
        if raised["priority"] == "high":
            assert shelved["code"] == "high_priority"
        else:
            assert shelved["outcome"] == "done", shelved
            self.alarm(name, "shelved")
            self.ask("unshelve", alarm=name)
            self.alarm(name, "active")
        end()
        self.alarm(name, "cleared")
        start()
        assert self.alarm(name, "active", text)["count"] == raised["count"] + 1
        self.ask("acknowledge", ids=[name])
        self.alarm(name, "acknowledged")
        end()
        self.alarm(name, "")
        seen = [
            "raised" if raised["count"] == 1 else "re-raised",
            "cleared",
            "re-raised",
            "acknowledged",
            "cleared",
        ]
        shelf = [] if raised["priority"] == "high" else ["shelved", "unshelved"]
        expected = [*seen[:1], *shelf, *seen[1:]]
        self.until(lambda: self.told(name)[-len(expected) :] == expected, f"the journal of {name}")

    def told(self, name):
        return [AlarmChange(event.kind).word for event in self.journal if event.id == name]

    def seen(self):
        return f"journal: {[(event.id, event.kind) for event in self.journal]}"


@pytest.fixture
def graph(tmp_path):
    with free_domain() as domain, Launcher(tmp_path / "log", domain) as launcher:
        weld = AlarmWeld(domain, launcher)
        yield weld
        weld.close()


def test_alarms_of_the_process(graph):
    weld = graph.weld()

    def fault(kind, magnitude=0.0, sensor="thermocouple"):
        return partial(weld.happen, event_schema.fault(sensor, kind, magnitude))

    def disturb(channel, shape, amplitude=0.0):
        return partial(weld.happen, event_schema.disturbance(channel, shape, amplitude))

    weld.cycle(
        "sensor:torque",
        fault("nan", sensor="torque"),
        fault("none", sensor="torque"),
        "its value is no number",
    )
    weld.cycle(
        "quality:depth_error_mm",
        disturb("depth", "step", 0.2),
        disturb("depth", "none"),
        "Depth off",
    )
    weld.cycle(
        "quality:temperature_error_c", fault("bias", 25.0), fault("none"), "Temperature off"
    )
    weld.cycle(
        "essential:temperature_c", fault("bias", -30.0), fault("none"), "outside 790 to 910"
    )
    for value, channel, amplitude in (
        ("force_kn", "axial_force", 10.0),
        ("speed_rpm", "spindle_speed", 40.0),
    ):
        weld.cycle(
            f"deviation:{value}",
            disturb(channel, "step", amplitude),
            disturb(channel, "none"),
            "does not follow",
        )
    weld.cycle("out_of_reach", lambda: weld.refer(860.0), weld.refer, "860 °C asked")
    for name, wrong in WRONG.items():
        weld.cycle(
            f"interlock:{name}",
            partial(weld.limit, name, warn=wrong),
            partial(weld.limit, name),
            ": warning",
        )


def test_alarms_of_stops(graph):
    weld = graph.weld()

    def trip(name):
        sooner = 0.1 if name.endswith("_low") else -0.1
        weld.limit(name, warn=WRONG[name] + sooner, trip=WRONG[name])
        weld.alarm("safe_stop", "active")

    def go_on(name):
        weld.limit(name)
        weld.page.seen("state", lambda frame: not frame["interlocks"])
        weld.acknowledge_stop()

    weld.cycle("safe_stop", partial(weld.ask, "safe_stop"), weld.acknowledge_stop, "Safe stop: ")
    for name in WRONG:
        weld.cycle(f"interlock:{name}", partial(trip, name), partial(go_on, name), ": tripped")


def inhibited(frame):
    return {health["name"] for health in frame["controllers"] if health["inhibited"]}


def thawed(weld, *names):
    weld.signal(signal.SIGCONT, *names)
    weld.page.seen(
        "state", lambda frame: all(controller["ready"] for controller in frame["controllers"])
    )
    weld.until_auto()


def test_alarm_of_a_failover(graph):
    weld = graph.weld()
    weld.page.seen(
        "alarms", lambda frame: "active" not in {alarm["state"] for alarm in frame["alarms"]}
    )
    text = "decentral commands in place of nmpc: no proposal at the deadline"
    weld.cycle(
        "failover",
        partial(weld.signal, signal.SIGSTOP, "nmpc"),
        partial(thawed, weld, "nmpc"),
        text,
    )


def test_alarm_of_a_command_that_is_held(graph):
    weld, everybody = graph.weld(), ("nmpc", "decentral")
    weld.cycle(
        "hold",
        partial(weld.signal, signal.SIGSTOP, *everybody),
        partial(thawed, weld, *everybody),
        "held: ",
    )


def test_alarm_of_a_controller_that_is_inhibited(graph):
    weld = graph.weld()

    def fail():
        weld.signal(signal.SIGSTOP, "nmpc")
        weld.page.ask("acknowledge", ids=[])  # what was sent before is read
        weld.page.until("state", lambda frame: "nmpc" in inhibited(frame))
        weld.until_done("switch", controller="decentral", wait_s=10)

    def go_back():
        thawed(weld, "nmpc")
        weld.until_done("switch", controller="nmpc", wait_s=10)
        weld.until_auto("nmpc")

    weld.cycle(
        "controller:nmpc",
        fail,
        go_back,
        "Controller nmpc is inhibited: no proposal at the deadline",
    )


def test_alarm_of_a_controller_that_is_not_ready(graph):
    weld = graph.weld()
    weld.until_done("switch", controller="decentral", wait_s=10)
    weld.until_auto("decentral")
    freeze = partial(weld.signal, signal.SIGSTOP, "nmpc")
    weld.cycle(
        "controller:nmpc", freeze, partial(thawed, weld, "nmpc"), "Controller nmpc is not ready: "
    )


def test_alarms_of_nodes(graph):
    weld = graph.weld()
    weld.start("standby")

    def standby():
        if not weld.launcher.children["standby"].running:
            weld.start("standby")
        weld.page.seen("state", lambda frame: frame["standby"])

    standby()
    weld.cycle("standby", partial(weld.kill, "standby"), standby)
    weld.cycle("foreign", weld.interfere, weld.leave)
    odd, many = "fsw_odd", [f"odd_{number}" for number in range(40)]
    error = partial(weld.report, DiagnosticStatus.ERROR, "the disk is full")
    fine = partial(weld.report, DiagnosticStatus.OK, "")
    weld.cycle(f"part:{odd}", partial(error, odd), partial(fine, odd), "the disk is full")
    silence = partial(weld.report, DiagnosticStatus.OK, "")
    weld.cycle(f"node:{odd}", silence, partial(fine, odd), "no longer reports")
    weld.cycle("flood:low", partial(error, *many), partial(fine, *many), "further alarms")
    weld.cycle("other_page", weld.keep_another_journal, weld.drop_another_journal)
    weld.kill("standby")

    def weld_again():
        """A plant that nobody has commanded for long has left the state of a weld."""
        weld.kill("plant")
        weld.start("supervisor", "plant")
        weld.until_auto()

    weld.cycle("supervisor", partial(weld.kill, "supervisor"), weld_again)
    weld.cycle("measurements", partial(weld.kill, "plant"), partial(weld.start, "plant"))
