"""A weld as processes, what is done to it, and what came of it."""

from __future__ import annotations

import itertools
import random
import re
import signal
import time
from dataclasses import dataclass

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Temperature

from fsw_control import messages_ros as convert
from fsw_control import units, weld
from fsw_control.contract import Command
from fsw_control.topics_ros import LATEST
from fsw_msgs.msg import (
    ControllerStatus,
    DriveFeedback,
    PlantState,
    ShoulderDepth,
    SpindleTorque,
    SupervisorState,
    WeldCommand,
    WeldReference,
)
from fsw_msgs.srv import SetFault, SwitchController
from fsw_test_support.ros_graph import Spinner

MODULES = {
    "plant": "fsw_plant.plant_node",
    "decentral": "fsw_decentral.decentral_node",
    "nmpc": "fsw_nmpc.nmpc_node",
    "supervisor": "fsw_supervisor.supervisor_node",
    "standby": "fsw_supervisor.supervisor_node",
    "recorder": "fsw_recorder.recorder_node",
    "scenario": "fsw_scenario.scenario_node",
}
SUPERVISORS = ("supervisor", "standby")
DEEP = QoSProfile(depth=2000)
LOSSY = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
MOVE_KN, MOVE_RPM = 1.0, 3.0
#: After so many ticks without commands the plant's watchdog begins to lower the force.
SAFE_TICKS = 50
WINDOW_C = (790.0, 910.0)
#: topics of the plant that a relay can stand in for, with their types
RELAYED = {
    "fsw/depth": ShoulderDepth,
    "fsw/spindle_torque": SpindleTorque,
    "fsw/thermocouple": Temperature,
    "fsw/drives": DriveFeedback,
    "fsw/plant/truth": PlantState,
}
#: of these, the topics of which the relay loses nothing
RELIABLE = ("fsw/drives", "fsw/plant/truth")


@dataclass
class Outcome:
    """What reached the plant since a mark; deviations are from the values at the mark.

    What time decides is exact in lockstep only: in real time a busy machine loses ticks and makes
    controllers late that nothing is done to. How soon a fault is answered is tested with a clock
    by hand (fsw_supervisor/test).
    """

    exact: bool
    ticks: int
    lost: int
    sources: list[str]
    reasons: list[str]  #: why each of these commanded first
    jump_kn: float
    jump_rpm: float
    depth_mm: float
    temperature_c: float
    coldest_c: float
    hottest_c: float

    def assert_steady(self, lost=0, depth_mm=0.1, jump_kn=MOVE_KN, jump_rpm=MOVE_RPM):
        """No more ticks lost than that, no bump, and the process where it was."""
        assert self.ticks > 0, self
        assert self.lost <= lost or not self.exact, self
        assert self.jump_kn <= jump_kn + 1e-6, self
        assert self.jump_rpm <= jump_rpm + 1e-6, self
        assert self.depth_mm <= depth_mm or self.lost >= SAFE_TICKS, self
        assert WINDOW_C[0] < self.coldest_c, self
        assert self.hottest_c < WINDOW_C[1], self

    def assert_sources(self, *names):
        """These commanded, in this order; in lockstep nobody else did."""
        rest = iter(self.sources)
        assert (self.sources == [*names]) if self.exact else all(name in rest for name in names), (
            self
        )


class Relay:
    """Stands between the plant and the others.

    Loses messages of best-effort readers and shifts the clock.
    """

    def __init__(self, weld):
        self.weld, self.loss, self.shift_ns = weld, 0.0, 0
        self.random = random.Random(4)
        self.out = {}
        self.stamps = {}  #: of the measurements that were passed on, to those of the plant
        for topic, kind in RELAYED.items():
            self.out[topic] = weld.node.create_publisher(kind, topic, 10)
            quality = DEEP if topic in RELIABLE else LOSSY
            weld.node.create_subscription(
                kind, f"raw/{topic}", lambda m, t=topic: self.forward(t, m), quality
            )
        self.commands = weld.node.create_publisher(WeldCommand, "raw/fsw/command", 10)
        weld.node.create_subscription(WeldCommand, "fsw/command", self.back, DEEP)

    def forward(self, topic, message):
        if topic not in RELIABLE and self.random.random() < self.loss:
            return
        stamp_ns = convert.stamp_ns(message.header.stamp)
        self.stamps[stamp_ns + self.shift_ns] = stamp_ns
        message.header.stamp = convert.stamp_from_ns(stamp_ns + self.shift_ns)
        self.out[topic].publish(message)

    def back(self, message):
        """The command to the measurement that it answers, whatever the clock is by now."""
        stamp_ns = self.stamps.get(convert.stamp_ns(message.header.stamp))
        if stamp_ns is not None:
            message.header.stamp = convert.stamp_from_ns(stamp_ns)
            self.commands.publish(message)


class Weld(Spinner):
    """The graph as processes and one observer; it can play a controller called ``rogue``, too."""

    def __init__(self, domain, launcher, folder, lockstep=False, relayed=False, standby=False):
        self.launcher, self.folder, self.lockstep, self.relayed = (
            launcher,
            folder,
            lockstep,
            relayed,
        )
        self.supervisors = SUPERVISORS if standby else SUPERVISORS[:1]
        self.parts = ("plant", "decentral", "nmpc", *self.supervisors)
        self.commands, self.truths, self.states, self.reports = {}, [], [], []
        self.misbehave = None
        self.bags = itertools.count()
        self.applied = Command(weld.FORCE_KN, weld.SPEED_RPM)
        rclpy.init(args=[], domain_id=domain)
        self.node = node = rclpy.create_node("observer")
        super().__init__()
        self.executor.add_node(node)
        raw = "raw/" if relayed else ""
        node.create_subscription(WeldCommand, f"{raw}fsw/command", self.on_command, DEEP)
        node.create_subscription(PlantState, f"{raw}fsw/plant/truth", self.truths.append, DEEP)
        node.create_subscription(
            SupervisorState, "fsw/supervisor/state", self.states.append, LATEST
        )
        node.create_subscription(DiagnosticArray, "/diagnostics", self.reports.append, DEEP)
        # rogue answers the newest: one that works off a queue never comes back once lockstep has
        # ceased to wait for it
        node.create_subscription(
            Temperature, "fsw/thermocouple", self.on_measurement, QoSProfile(depth=1)
        )
        self.references = node.create_publisher(WeldReference, "fsw/reference", LATEST)
        self.switching = node.create_client(SwitchController, "fsw/switch_controller")
        self.proposals = node.create_publisher(WeldCommand, "fsw/rogue/proposal", 10)
        self.statuses = node.create_publisher(ControllerStatus, "fsw/rogue/status", 10)
        self.faults = node.create_client(SetFault, "fsw/plant/set_fault")
        self.relay = Relay(self) if relayed else None
        self.refer(weld.DEPTH_MM)

    def start(self, name):
        settings, remaps = [], []
        if name == "plant":
            settings.append(f"wait_for_subscribers:={1 if self.relayed else 3}")
            settings += ["clock:=simulated", "speed:=0.0"] if self.lockstep else []
            # after a tick of which all was lost; until the only supervisor of a busy machine is
            # back
            if self.relayed:
                settings.append(
                    "lockstep_timeout_s:=0.5" if self.lockstep else "watchdog.hold_s:=60.0"
                )
            remaps = (
                [f"{topic}:=raw/{topic}" for topic in (*RELAYED, "fsw/command")]
                if self.relayed
                else []
            )
        elif self.lockstep:
            settings.append("use_sim_time:=true")
        if name in SUPERVISORS:
            settings += ["fallbacks:=[decentral, nmpc]", "storm_swaps:=0", "readmit_ticks:=10"]
            # the times of a machine that may stand still meanwhile
            settings += [
                "takeover_wait_s:=2.0",
                "lockstep_deadline_s:=5.0",
                "lockstep_shadow_wait_s:=5.0",
            ]
        if name == "standby":
            settings.append("standby:=true")
            remaps.append("__node:=fsw_supervisor_standby")
        if name == "recorder":
            settings.append(f"output:={self.bag}")
        if name == "scenario":
            settings.append(f"scenario:={self.folder / 'scenario.yaml'}")
        arguments = [item for setting in settings for item in ("-p", setting)]
        arguments += [item for remap in remaps for item in ("-r", remap)]
        self.launcher.start(name, MODULES[name], ["--ros-args", *arguments] if arguments else [])

    def record(self):
        """Start a recorder on a bag of its own."""
        self.bag = self.folder / f"bag{next(self.bags)}"
        self.start("recorder")
        self.until(self.bag.exists, what="the bag")
        self.ticks(3)

    def restore(self):
        """Bring the weld back to all parts running, under ``decentral``.

        Returns the first truth that it answered.
        """
        self.misbehave = None
        for name in self.parts:
            if name in self.launcher.children and self.launcher.children[name].running:
                self.signal(name, signal.SIGCONT)
            else:
                self.start(name)
        roles = sorted(("active", "standby")[: len(self.supervisors)])
        self.until(
            lambda: sorted(map(self.role, self.supervisors)) == roles,
            what="one leading supervisor",
        )
        self.until(
            lambda: len(self.truths) > 15 and self.ready("decentral", "nmpc", "rogue"),
            "the weld to run",
        )
        first = self.switch("decentral")
        self.ticks(3)
        return first

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()

    # ---- what happens

    def on_command(self, message):
        if message.source != "foreign":
            stamp = convert.stamp_ns(message.header.stamp)
            if self.lockstep and stamp < max(
                self.commands, default=0
            ):  # the plant's time has begun anew
                self.commands.clear()
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

    def seen(self):
        return f"state: {self.states[-1:]}"

    def ticks(self, count):
        goal = len(self.truths) + count
        self.until(lambda: len(self.truths) >= goal, f"{count} ticks")

    def ready(self, *names):
        health = {item.name: item for item in self.states[-1].controllers} if self.states else {}
        return all(
            name in health and not health[name].lack and health[name].warm for name in names
        )

    def roles(self, name):
        """Roles that a supervisor has had since it started."""
        return re.findall(r"role: (\w+)", self.launcher.children[name].text())

    def role(self, name):
        """Role that a supervisor has told last."""
        return (self.roles(name) or [""])[-1]

    @property
    def leader(self):
        """The one that leads.

        On a busy machine two may do so for a moment, until one of them steps back.
        """
        self.until(lambda: [*map(self.role, self.supervisors)].count("active") == 1, "one leader")
        return next(name for name in self.supervisors if self.role(name) == "active")

    # ---- what is done to it

    def refer(self, depth_mm):
        header = convert.header(
            self.node.get_clock().now().nanoseconds if not self.lockstep else 0
        )
        self.references.publish(
            WeldReference(header=header, depth=depth_mm * 1e-3, temperature=weld.TEMPERATURE_C)
        )

    def call(self, client, request):
        response = super().call(client, request)
        assert response.ok, response.message

    def switch(self, name):
        """Ask for a controller until it commands.

        Returns the number of a truth that it answered.
        """
        ask_s = 0.0

        def applied():
            nonlocal ask_s
            if time.monotonic() >= ask_s:
                ask_s = time.monotonic() + 3.0
                self.switching.call_async(convert.switch_request(name, 5.0))
            return self.source() == name and self.states[-1].target_controller == name

        self.until(applied, what=f"the switch to {name}")
        newest = max(self.commands)
        self.until(
            lambda: convert.stamp_ns(self.truths[-1].header.stamp) >= newest,
            "the truth of this tick",
        )
        stamps = [convert.stamp_ns(truth.header.stamp) for truth in self.truths]
        return len(stamps) - 1 - stamps[::-1].index(newest)

    def signal(self, name, number):
        self.launcher.children[name].process.send_signal(number)
        if number == signal.SIGKILL:
            self.launcher.children[name].process.wait()

    def kill_the_plant(self):
        """Kill it while it has force and speed of a fresh one.

        Else its restart is a move by itself: a safe stop.
        """

        def has_those_of_a_fresh_one():
            self.signal("plant", signal.SIGSTOP)
            end_s = (
                time.monotonic() + 3.0
            )  # a tick is never answered if the signal has stopped its publication
            self.until(lambda: self.answered() or time.monotonic() > end_s)
            force, speed = (
                abs(a - b)
                for a, b in zip(self.applied, (weld.FORCE_KN, weld.SPEED_RPM), strict=True)
            )
            if self.answered() and force < 0.3 * MOVE_KN and speed < 0.3 * MOVE_RPM:
                return True
            self.signal("plant", signal.SIGCONT)
            self.ticks(5)
            return False

        self.until(has_those_of_a_fresh_one, "force and speed of a fresh plant")
        self.signal("plant", signal.SIGKILL)

    def answered(self):
        """Whether the last truth has its command; in real time one may never get it."""
        return not self.lockstep or convert.stamp_ns(self.truths[-1].header.stamp) in self.commands

    def new_time(self, first):
        """Number of the first truth of a time that began anew, from ``first`` on.

        None while there is none.
        """
        stamps = [convert.stamp_ns(truth.header.stamp) for truth in self.truths[first - 1 :]]
        return next(
            (first + i for i, (a, b) in enumerate(itertools.pairwise(stamps)) if b < a), None
        )

    def a_controller_commands(self):
        self.until(lambda: self.source() in ("decentral", "nmpc"), "a controller in command")

    def source(self):
        return self.commands[max(self.commands)].source if self.commands else ""

    # ---- what came of it

    def outcome(self, first):
        """From truth number ``first`` on.

        The last ticks are left out, their commands may be on the way.

        In lockstep commands may arrive here long after the plant has taken them, while truths
        overtake them.
        """
        truths = self.truths[first:-3]
        stamps = [convert.stamp_ns(truth.header.stamp) for truth in truths]
        if self.lockstep:
            end_s = time.monotonic() + 10.0  # what ends without commands never gets them
            self.until(
                lambda: max(self.commands, default=-1) >= stamps[-1] or time.monotonic() > end_s
            )
        moves = []  # pairs: what acts or was commanded, and the command that follows
        commands = [self.commands.get(stamp) for stamp in stamps]
        for k, (before, after) in enumerate(itertools.pairwise(commands), 1):
            if after is None:
                continue
            new = convert.command(after)
            if before is not None:
                moves.append((convert.command(before), new))
            # after lost ticks it goes on from what acts; the newest feedback may be some ticks
            # old, while the
            else:
                # watchdog moves the drives
                acting = (
                    Command(
                        units.kn_from_n(truth.axial_force),
                        units.rpm_from_rad_s(truth.spindle_speed),
                    )
                    for truth in truths[max(0, k - (0 if self.lockstep else 5)) : k + 1]
                )
                nearest = min(
                    acting,
                    key=lambda command: (
                        abs(command.force_kn - new.force_kn) / MOVE_KN
                        + abs(command.speed_rpm - new.speed_rpm) / MOVE_RPM
                    ),
                )
                moves.append((nearest, new))
        answers = [self.commands[stamp] for stamp in stamps if stamp in self.commands]
        groups = itertools.groupby(answers, lambda command: command.source)
        in_turn = [(source, convert.reason(next(group)).words) for source, group in groups]
        return Outcome(
            exact=self.lockstep,
            ticks=len(stamps),
            lost=len(stamps) - len(answers),
            sources=[source for source, _ in in_turn],
            reasons=[reason for _, reason in in_turn],
            jump_kn=max((abs(b.force_kn - a.force_kn) for a, b in moves), default=0.0),
            jump_rpm=max((abs(b.speed_rpm - a.speed_rpm) for a, b in moves), default=0.0),
            depth_mm=max(abs(truth.depth - truths[0].depth) * 1e3 for truth in truths),
            temperature_c=max(abs(truth.temperature - truths[0].temperature) for truth in truths),
            coldest_c=min(truth.temperature for truth in truths),
            hottest_c=max(truth.temperature for truth in truths),
        )
