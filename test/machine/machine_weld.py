"""A weld at the emulated machine.

Supervisor, controllers and gateway as processes, in real time.
"""

from __future__ import annotations

import itertools
import signal

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.qos import QoSProfile

from fsw_control import messages_ros as convert
from fsw_control import weld
from fsw_control.contract import Reference
from fsw_control.topics_ros import LATCHED
from fsw_msgs.msg import DriveFeedback, ShoulderDepth, WeldCommand, WeldReference
from fsw_test_support.ros_graph import Spinner
from fsw_test_support.waiting import PATIENCE_S

MODULES = {
    "gateway": "fsw_machine.machine_node",
    "server": "fsw_test_support.machine_server",
    "decentral": "fsw_decentral.decentral_node",
    "nmpc": "fsw_nmpc.nmpc_node",
    "supervisor": "fsw_supervisor.supervisor_node",
}
GRAPH = ("gateway", "nmpc", "decentral", "supervisor")
SUPERVISOR = (
    "controller:=nmpc",
    "readmit_ticks:=10",
    "return_to_target:=true",
    "storm_swaps:=0",
    # seconds without control leave the process window, which is not what these tests are about
    *(
        f"interlocks.temperature_{name}"
        for name in ("low.warn:=610.0", "low.trip:=600.0", "high.trip:=1000.0")
    ),
)
DEEP = QoSProfile(depth=1000)


class MachineWeld(Spinner):
    """The graph's processes, the machine if it runs in the test, and what nodes and machine say.

    ``machine`` is a ``RunningMachine``, or None where the machine is a process as well.
    """

    def __init__(self, domain, launcher, machine, file, server_arguments=()):
        self.launcher, self.machine = launcher, machine
        self._arguments = {
            "gateway": ["--ros-args", "-p", f"machine_file:={file}", "-p", "reconnect.max_s:=0.5"],
            "supervisor": [
                "--ros-args",
                *(item for setting in SUPERVISOR for item in ("-p", setting)),
            ],
            "server": ["--machine-file", str(file), *server_arguments],
        }
        self.commands, self.drives, self.depths, self.reports = [], [], [], {}
        self.context = Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        self.node = node = rclpy.create_node("observer", context=self.context)
        super().__init__(self.context)
        self.executor.add_node(node)
        node.create_subscription(WeldCommand, "fsw/command", self.commands.append, DEEP)
        node.create_subscription(DriveFeedback, "fsw/drives", self.drives.append, DEEP)
        node.create_subscription(ShoulderDepth, "fsw/depth", self.depths.append, DEEP)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, DEEP)
        self.references = node.create_publisher(WeldReference, "fsw/reference", LATCHED)
        self.refer(weld.DEPTH_MM)

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()

    def _on_diagnostics(self, message):
        self.reports.update({status.name: status for status in message.status})

    def seen(self):
        reports = {name: status.message for name, status in self.reports.items()}
        logs = {name: child.last_lines() for name, child in self.launcher.children.items()}
        return f"reports: {reports}; logs: {logs}"

    # ---- what is done

    def start(self, *names):
        for name in names:
            self.launcher.start(name, MODULES[name], self._arguments.get(name, []))

    def end(self, name, number):
        """End a process; a clean end has the exit code 0."""
        process = self.launcher.children[name].process
        process.send_signal(number)
        code = process.wait(PATIENCE_S)
        assert number == signal.SIGKILL or code == 0, self.launcher.children[name].last_lines()

    def refer(self, depth_mm):
        self.references.publish(
            convert.reference_message(Reference(depth_mm, weld.TEMPERATURE_C), 0)
        )

    # ---- what is seen

    def report(self, part):
        """Text of the gateway's diagnostics of a part."""
        status = self.reports.get(f"fsw_machine: {part}")
        return "" if status is None else status.message

    def value(self, part, key):
        """A value of the gateway's last diagnostics of a part, as a text."""
        name = f"fsw_machine: {part}"
        self.until(lambda: name in self.reports, f"diagnostics of {part}")
        return next(pair.value for pair in self.reports[name].values if pair.key == key)

    def until_report(self, part, text):
        self.until(lambda: text in self.report(part), f"{part}: {text}")

    @property
    def source(self):
        return self.commands[-1].source if self.commands else ""

    def taken(self):
        """Commands that the machine has taken: counter, command, and what was in force before."""
        return self.machine.do(lambda server: list(server.taken))

    def runs(self, source="", more=8):
        """Wait until the machine has taken some more commands, of a source."""
        self.until(lambda: source in self.source, f"commands of {source}")
        goal = len(self.taken()) + more
        self.until(lambda: len(self.taken()) >= goal, f"{more} commands taken")

    def assert_no_bump(self, first):
        """From command number ``first`` on, each was within a move of what was in force.

        The machine's watchdog may lower the force between the read that a command answers and the
        command.
        """
        taken = self.taken()[first - 1 :]
        safe_kn = weld.TICK_S * self.machine.server.plant.config["watchdog.safe_rate_kn_per_s"]
        assert len(taken) > 1
        for (last, *_), (counter, command, before) in itertools.pairwise(taken):
            ramp_kn = safe_kn * (
                1 + min(counter - last, 5)
            )  # a busy gateway answers a read of some cycles ago
            seen = f"{command} after {before} at cycle {counter} after {last}"
            assert counter > last, seen
            assert (
                abs(command.force_kn - before.force_kn) <= weld.FORCE_STEP_KN + ramp_kn + 1e-6
            ), seen
            assert abs(command.speed_rpm - before.speed_rpm) <= weld.SPEED_STEP_RPM + 1e-6, seen

    def in_force(self):
        """Set-points in force at the machine."""
        return self.machine.do(lambda server: server.plant.applied)

    def temperature_c(self):
        """Temperature of the process."""
        return self.machine.do(lambda server: server.plant.truth().temperature_c)

    def until_safe(self):
        """Wait until the machine's watchdog has gone to its safe state.

        Returns the set-points in force then.
        """
        self.until(
            lambda: self.machine.do(lambda server: server.plant.watchdog.state.name) == "SAFE",
            "the watchdog",
        )
        return self.in_force()
