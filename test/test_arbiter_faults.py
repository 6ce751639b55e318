"""Faults in the running graph: what reached the plant, tick by tick, while parts of it died, stopped or lied."""

from __future__ import annotations

import itertools
import math
import os
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

rclpy = pytest.importorskip("rclpy")

from builtin_interfaces.msg import Duration  # noqa: E402
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from sensor_msgs.msg import Temperature  # noqa: E402

from fsw_control import messages_ros as convert  # noqa: E402
from fsw_control.contract import Command  # noqa: E402
from fsw_experiment.launcher import Launcher, free_domain  # noqa: E402
from fsw_msgs.msg import ControllerStatus, PlantState, SupervisorState, WeldCommand, WeldReference  # noqa: E402
from fsw_msgs.srv import SetFault, SwitchController  # noqa: E402

MODULES = {
    "plant": "fsw_plant.plant_node",
    "decentral": "fsw_decentral.decentral_node",
    "nmpc": "fsw_nmpc.nmpc_node",
    "tight": Path(__file__).stem,
    "supervisor": "fsw_supervisor.supervisor_node",
    "recorder": "fsw_recorder.recorder_node",
}
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
DEEP = QoSProfile(depth=2000)
MOVE_KN, MOVE_RPM = 1.0, 3.0
WINDOW_C = (790.0, 910.0)


def main():
    """A second decentralized controller, called ``tight``: a light shadow for the tests in real time."""
    from fsw_control import run_controller
    from fsw_decentral import DecentralController

    return run_controller(DecentralController, name="tight", parameters=("fsw_decentral", "decentral.yaml"))


@dataclass
class Outcome:
    """What reached the plant since a mark."""

    ticks: int
    lost: int
    sources: list[str]
    jump_kn: float
    jump_rpm: float
    depth_mm: float
    coldest_c: float
    hottest_c: float

    def assert_steady(self, lost=0, depth_mm=0.1):
        """No more ticks lost than that, no bump, and the process where it was."""
        assert self.lost <= lost, self
        assert self.jump_kn <= MOVE_KN + 1e-6, self
        assert self.jump_rpm <= MOVE_RPM + 1e-6, self
        assert self.depth_mm <= depth_mm, self
        assert WINDOW_C[0] < self.coldest_c, self
        assert self.hottest_c < WINDOW_C[1], self


class Weld:
    """The graph as processes and one observer; it can play a controller called ``rogue``, too."""

    def __init__(self, domain, launcher, folder, lockstep):
        self.launcher, self.folder, self.lockstep = launcher, folder, lockstep
        self.commands, self.truths, self.states, self.reports = {}, [], [], []
        self.misbehave = None
        self.pending = []
        self.applied = Command(78.4, 407.576)
        rclpy.init(args=[], domain_id=domain)
        self.node = node = rclpy.create_node("observer")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(node)
        node.create_subscription(WeldCommand, "fsw/command", self.on_command, DEEP)
        node.create_subscription(PlantState, "fsw/plant/truth", self.truths.append, DEEP)
        node.create_subscription(SupervisorState, "fsw/supervisor/state", self.states.append, LATCHED)
        node.create_subscription(DiagnosticArray, "/diagnostics", self.reports.append, DEEP)
        node.create_subscription(Temperature, "fsw/thermocouple", self.on_measurement, DEEP)
        self.references = node.create_publisher(WeldReference, "fsw/reference", LATCHED)
        self.proposals = node.create_publisher(WeldCommand, "fsw/rogue/proposal", 10)
        self.statuses = node.create_publisher(ControllerStatus, "fsw/rogue/status", 10)
        self.switching = node.create_client(SwitchController, "fsw/switch_controller")
        self.faults = node.create_client(SetFault, "fsw/plant/set_fault")
        self.refer(2.66, 850.0)

    def run(self, controllers):
        """Start everything and wait until all controllers are ready."""
        for name in ("plant", *controllers, "supervisor"):
            self.start(name)
        self.until(lambda: len(self.truths) > 15 and self.ready(*controllers, "rogue"), 60.0, "the weld to run")

    def start(self, name):
        settings = {"plant": ["wait_for_subscribers:=3"]}.get(name, [])
        if name == "plant":
            settings += ["clock:=simulated", "speed:=0.0"] if self.lockstep else []
        elif self.lockstep:
            settings.append("use_sim_time:=true")
        if name == "tight":
            settings.append("tuning:=tight")
        if name == "supervisor":
            settings.append("fallbacks:=[decentral, tight, nmpc]")
        if name == "recorder":
            settings.append(f"output:={self.folder / 'bag'}")
        arguments = [item for setting in settings for item in ("-p", setting)]
        self.launcher.start(name, MODULES[name], ["--ros-args", *arguments] if arguments else [])

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()

    # ---- what happens

    def on_command(self, message):
        stamp = convert.stamp_ns(message.header.stamp)
        if message.source != "foreign":
            self.commands.setdefault(stamp, message)
            self.applied = convert.command(message)

    def on_measurement(self, message):
        stamp = convert.stamp_ns(message.header.stamp)
        self.statuses.publish(ControllerStatus(header=message.header, controller="rogue"))
        proposal = convert.command_message(self.applied, stamp, "rogue")
        if self.misbehave is None:
            self.proposals.publish(proposal)
        else:
            self.misbehave(proposal)

    def spin(self, timeout_s=0.02):
        now_s = time.monotonic()
        for at_s, proposal in [item for item in self.pending if item[0] <= now_s]:
            self.pending.remove((at_s, proposal))
            self.proposals.publish(proposal)
        self.executor.spin_once(timeout_sec=timeout_s)

    def until(self, condition, timeout_s=30.0, what="the condition"):
        end_s = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < end_s, f"{what} did not come; state: {self.states[-1:]}"
            self.spin()

    def ticks(self, count):
        goal = len(self.truths) + count
        self.until(lambda: len(self.truths) >= goal, 30.0 + count, f"{count} ticks")

    def ready(self, *names):
        health = {item.name: item for item in self.states[-1].controllers} if self.states else {}
        return all(name in health and not health[name].reason and health[name].warm for name in names)

    # ---- what is done to it

    def refer(self, depth_mm, temperature_c):
        header = convert.header(self.node.get_clock().now().nanoseconds if not self.lockstep else 0)
        self.references.publish(WeldReference(header=header, depth=depth_mm * 1e-3, temperature=temperature_c))

    def call(self, client, request):
        self.until(client.service_is_ready, what="the service")
        future = client.call_async(request)
        self.until(future.done, what="the answer")
        return future.result()

    def switch(self, name):
        request = SwitchController.Request(
            name=name, strictness=SwitchController.Request.BEST_EFFORT, timeout=Duration(sec=20)
        )
        answer = self.call(self.switching, request)
        assert answer.ok, answer.message

    def signal(self, name, number):
        self.launcher.children[name].process.send_signal(number)

    def source(self):
        return self.commands[max(self.commands)].source

    # ---- what came of it

    def outcome(self, first):
        """From truth number ``first`` on; the last ticks are left out, their commands may be on the way."""
        truths = self.truths[first:-3]
        stamps = [convert.stamp_ns(truth.header.stamp) for truth in truths]
        given = [convert.command(self.commands[stamp]) for stamp in stamps if stamp in self.commands]
        pairs = list(itertools.pairwise(given))
        return Outcome(
            ticks=len(stamps),
            lost=sum(stamp not in self.commands for stamp in stamps),
            sources=list(dict.fromkeys(self.commands[stamp].source for stamp in stamps if stamp in self.commands)),
            jump_kn=max(abs(b.force_kn - a.force_kn) for a, b in pairs),
            jump_rpm=max(abs(b.speed_rpm - a.speed_rpm) for a, b in pairs),
            depth_mm=max(abs(truth.depth * 1e3 - 2.66) for truth in truths),
            coldest_c=min(truth.temperature for truth in truths),
            hottest_c=max(truth.temperature for truth in truths),
        )


@pytest.fixture
def make_weld(tmp_path, monkeypatch):
    """Starts the graph in a domain of its own."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    welds = []
    path = {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)])}
    with free_domain() as domain, Launcher(tmp_path / "log", domain, path) as launcher:

        def make(*controllers, lockstep=False):
            welds.append(Weld(domain, launcher, tmp_path, lockstep))
            welds[-1].run(controllers)
            return welds[-1]

        try:
            yield make
        finally:
            for weld in welds:
                weld.close()


@pytest.fixture
def weld(make_weld):
    """A weld in real time under ``decentral``, with ``tight`` and ``rogue`` as shadows."""
    return make_weld("decentral", "tight")


def test_a_nominal_weld_loses_nothing(weld):
    first = len(weld.truths)
    weld.ticks(30)
    outcome = weld.outcome(first)
    outcome.assert_steady(depth_mm=0.02)
    assert outcome.sources == ["decentral"]


@pytest.mark.parametrize(("other", "lockstep"), [("tight", False), ("nmpc", True)])
def test_swaps_in_both_directions_during_a_depth_step(make_weld, other, lockstep):
    weld = make_weld("decentral", other, lockstep=lockstep)
    first = len(weld.truths)
    weld.refer(2.7, 850.0)
    weld.ticks(5)
    weld.switch(other)
    weld.ticks(15)
    assert weld.source() == other
    weld.switch("decentral")
    weld.ticks(15)
    outcome = weld.outcome(first)
    outcome.assert_steady()
    assert outcome.sources == ["decentral", other]
    assert weld.source() == "decentral"


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
@pytest.mark.parametrize(
    ("active", "other", "lockstep"),
    [("decentral", "tight", False), ("decentral", "nmpc", True), ("nmpc", "decentral", True)],
)
def test_the_active_controller_is_killed_or_stopped(make_weld, active, other, number, lockstep):
    weld = make_weld(active, other, lockstep=lockstep)
    weld.switch(active)
    first = len(weld.truths)
    weld.ticks(5)
    weld.signal(active, number)
    weld.until(lambda: weld.source() == other, what="the fallback")
    weld.ticks(10)
    if number == signal.SIGSTOP:
        weld.signal(active, signal.SIGCONT)
        weld.ticks(10)
    outcome = weld.outcome(first)
    outcome.assert_steady()
    assert outcome.sources == [active, other]
    assert weld.states[-1].requested_by == "failover"


def not_finite(weld):
    def send(proposal):
        proposal.axial_force = math.nan
        weld.proposals.publish(proposal)

    return send


def late(weld):
    return lambda proposal: weld.pending.append((time.monotonic() + 0.15, proposal))


def old_stamps(weld):
    stamp = convert.stamp_from_ns(max(weld.commands))

    def send(proposal):
        proposal.header.stamp = stamp
        weld.proposals.publish(proposal)

    return send


def too_fast(weld):
    def send(proposal):
        proposal.axial_force += 1500.0
        weld.proposals.publish(proposal)

    return send


@pytest.mark.parametrize("behaviour", [not_finite, late, old_stamps, too_fast])
def test_a_controller_lies(weld, behaviour):
    weld.switch("rogue")
    first = len(weld.truths)
    weld.ticks(5)
    weld.misbehave = behaviour(weld)
    weld.until(lambda: weld.source() == "decentral", what="the fallback")
    weld.ticks(10)
    outcome = weld.outcome(first)
    outcome.assert_steady()
    assert outcome.sources == ["rogue", "decentral"]


def test_two_controllers_of_one_name(weld):
    weld.switch("rogue")
    first = len(weld.truths)

    def twice(proposal):
        weld.proposals.publish(proposal)
        proposal.axial_force += 300.0
        weld.proposals.publish(proposal)

    weld.misbehave = twice
    weld.until(lambda: weld.source() == "decentral", what="the fallback")
    weld.ticks(5)
    weld.outcome(first).assert_steady()
    assert "two controllers" in weld.states[-1].reason


def test_a_foreign_writer_is_reported_and_changes_nothing_of_the_arbiter(weld):
    foreign = weld.node.create_publisher(WeldCommand, "fsw/command", 10)
    weld.until(lambda: foreign.get_subscription_count() >= 4)
    first = len(weld.truths)
    foreign.publish(convert.command_message(Command(61.0, 310.0), 1, "foreign"))

    def reported():
        return any(
            status.name == "fsw_supervisor: command topic" and status.level == b"\x02"
            for array in weld.reports
            for status in array.status
        )

    weld.until(reported, what="the error on /diagnostics")
    weld.ticks(5)
    weld.outcome(first).assert_steady()


def test_the_supervisor_is_killed_and_restarted(weld):
    weld.switch("tight")
    weld.ticks(5)
    first = len(weld.truths)
    weld.signal("supervisor", signal.SIGKILL)
    weld.launcher.children["supervisor"].process.wait()
    before = max(weld.commands)
    weld.start("supervisor")
    weld.until(lambda: max(weld.commands) > before, what="the next command")
    weld.ticks(15)
    outcome = weld.outcome(first)
    outcome.assert_steady(lost=60)
    print(f"ticks lost by a restart of the supervisor: {outcome.lost}")
    assert weld.source() == "tight", "who was active goes on, not who is configured"


def test_the_supervisor_is_stopped_and_continued(weld):
    first = len(weld.truths)
    weld.ticks(3)
    weld.signal("supervisor", signal.SIGSTOP)
    weld.ticks(8)
    weld.signal("supervisor", signal.SIGCONT)
    weld.ticks(15)
    outcome = weld.outcome(first)
    outcome.assert_steady(lost=12)
    assert weld.source() == "decentral"
    assert weld.states[-1].target_controller == "decentral"


def test_the_plant_is_stopped_and_continued(weld):
    weld.ticks(3)
    weld.signal("plant", signal.SIGSTOP)
    count = len(weld.truths)
    end_s = time.monotonic() + 1.5
    weld.until(lambda: time.monotonic() > end_s)
    weld.signal("plant", signal.SIGCONT)
    weld.ticks(20)
    weld.outcome(count).assert_steady(lost=5)
    assert weld.source() == "decentral"


def test_the_recorder_is_killed(weld):
    weld.start("recorder")
    weld.launcher.wait_until(lambda: (weld.folder / "bag").exists(), 20.0, "the bag")
    first = len(weld.truths)
    weld.ticks(3)
    weld.signal("recorder", signal.SIGKILL)
    weld.ticks(10)
    outcome = weld.outcome(first)
    outcome.assert_steady()
    assert outcome.sources == ["decentral"]


@pytest.mark.parametrize("sensor", ["depth", "torque", "thermocouple"])
@pytest.mark.parametrize("kind", ["nan", "dropout", "freeze", "spike", "delay", "duplicate"])
def test_a_sensor_fails(make_weld, sensor, kind):
    weld = make_weld("decentral", "tight", lockstep=True)
    first = len(weld.truths)
    magnitude = {"spike": {"depth": 1e-3, "torque": 300.0, "thermocouple": 40.0}[sensor], "delay": 0.3}.get(kind, 0.0)
    answer = weld.call(weld.faults, SetFault.Request(sensor=sensor, kind=kind, magnitude=magnitude, duration=3.0))
    assert answer.ok, answer.message
    weld.ticks(80)
    weld.outcome(first).assert_steady(depth_mm=0.25)
