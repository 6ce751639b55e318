"""The gateway to a machine as a node; it replaces the plant emulator."""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Mapping
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from fsw_control import messages_ros as convert
from fsw_control.coded import Fact
from fsw_control.command_writers_ros import CommandWriters
from fsw_control.depth_footprint import Footprint
from fsw_control.managed_node_ros import ManagedNode
from fsw_control.node_main_ros import main_of
from fsw_control.parameters_ros import ParameterValues
from fsw_control.reports_ros import OK, DiagnosticsPublisher, Report, log
from fsw_control.reports_ros import commands as commands_report
from fsw_control.schema.extensions import Extra
from fsw_control.single_instance_ros import SEARCHING, STARTING, SingleInstanceGuard
from fsw_control.stop_ros import StopHolder
from fsw_control.topics_ros import SENT, STREAM, sensor_publishers
from fsw_machine import gateway_reports_ros as reports
from fsw_machine.gateway import Gateway, Publication
from fsw_machine.machine_file import MachineFile
from fsw_machine.parameters import GatewayParameters
from fsw_machine.samples import CycleRead
from fsw_msgs.msg import DriveFeedback, WeldCommand

_EXTRA = Extra("fsw-control", "machine", ("asyncua",))
_EXTRA.missing()  # a clone of the repository installs it
try:
    from fsw_machine import certificates
    from fsw_machine.node_check import LinkError
    from fsw_machine.opcua_link import (
        Connected,
        Event,
        Lost,
        MachineLink,
        Stalled,
        Written,
        password,
    )
except ModuleNotFoundError:
    print(f"fsw_machine: {_EXTRA.absence}", file=sys.stderr)
    raise SystemExit(2) from None

_CHECK_S = 0.2
_REPORT_S = 1.0


class MachineNode(ManagedNode):
    """Publishes the machine's measurements and writes the commands that its gateway accepts.

    The link's thread appends events to a queue and triggers a guard condition; everything else
    happens in the executor's thread. It is a managed node, with a session while it is active.
    """

    def __init__(self) -> None:
        super().__init__("fsw_machine")
        self._settings = ParameterValues(self, GatewayParameters)
        self._settings.add_check(self._why_not)
        self._settings.on_change(self._on_parameters)
        self._link: MachineLink | None = None
        if self._settings["autostart"]:
            self.start()

    def configure(self) -> None:
        """Read the machine file, check its requirements, and announce the topics."""
        file_name = self._settings["machine_file"]
        shipped = Path(str(resources.files("fsw_machine") / "machine.yaml"))
        path = Path(file_name).expanduser() if file_name else shipped
        self._machine = MachineFile.load(path)
        self._check_secrets()
        part = self._machine.depth_fusion
        file = None if part is None else part.footprint_file
        footprint, self._footprint_sha256 = Footprint.from_named(file)
        self._gateway = Gateway(self._machine, self._settings.values, footprint)
        self._events: deque[Event] = deque()
        self._lost, self._retry_s, self._losses, self._attempts = "", 0.0, 0, 0
        self._stalled_s = self._longest_write_s = 0.0
        self._reported = (0, 0)
        self._logged: dict[str, tuple[object, ...]] = {}
        self._refused = ""
        self._guard = SingleInstanceGuard(self)
        self._sensors = sensor_publishers(self)
        self._drives = self.create_publisher(DriveFeedback, "fsw/drives", SENT)
        self._diagnostics = DiagnosticsPublisher(self, instance=self._guard.instance)

    def activate(self) -> None:
        """Ensure that the gateway is alone, and connect."""
        self._stop = StopHolder(self, self._gateway.fence.register, self._gateway.fence.hear)
        self.create_subscription(WeldCommand, "fsw/command", self._on_command, STREAM)
        sources = partial(self._settings.__getitem__, "commands.sources")
        self._writers = CommandWriters(self, lambda: self._gateway.gate, sources)
        self._guard.check(self._settings["discovery_s"], self._announce)
        self._wake = self.create_guard_condition(self._on_events)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_CHECK_S, self._writers.look, clock=steady)
        self.create_timer(_REPORT_S, self._report, clock=steady)
        settings = GatewayParameters.from_values(self._settings.values)
        self._link = MachineLink(self._machine, settings, self._deliver)
        self._link.start()

    def deactivate(self) -> None:
        """Close the session; without a heartbeat the machine's watchdog makes it safe."""
        self._end_session()
        self._events.clear()
        self._gateway.on_lost()
        self._logged.clear()  # so that the next session logs it again
        text = "the session is closed, and the machine's own watchdog makes it safe"
        self.get_logger().info(f"deactivated: {text}")

    def _end_session(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.stop()

    def _check_secrets(self) -> None:
        """Reject unusable certificates or passwords at the start and at every attempt."""
        if self._machine.security is not None:
            certificates.check(self._machine.security, certificates.now())
        if self._machine.user is not None:
            password(self._machine.user)

    def destroy_node(self) -> None:
        """Close the session, then destroy the node."""
        self._end_session()
        super().destroy_node()

    # ---------------------------------------------------------------- the link

    def _deliver(self, event: Event) -> None:
        """Called in the link's thread."""
        self._events.append(event)
        self._wake.trigger()

    def _on_events(self) -> None:
        while self._events:
            self._on_event(self._events.popleft())

    def _on_event(self, event: Event) -> None:
        gateway = self._gateway
        if isinstance(event, CycleRead):
            stalled, self._stalled_s = self._stalled_s, 0.0
            permissive, joined = gateway.permissive, gateway.joined
            publication = gateway.on_read(event)
            if publication is not None:
                self._publish(publication)
                self._stop.look()
            if stalled or (permissive, joined) != (gateway.permissive, gateway.joined):
                self._report()
        elif isinstance(event, Written):
            waiting = gateway.on_written(event.order, event.failure, time.monotonic())
            if waiting is not None and self._link is not None:
                self._link.write(waiting)
            self._longest_write_s = max(self._longest_write_s, event.took_s)
            if event.failure:
                text = f"command not taken: {event.failure}"
                self.get_logger().error(text, throttle_duration_sec=1.0)
        elif isinstance(event, Connected):
            self._attempts, self._stalled_s = 0, 0.0
            gateway.on_connected()
            self._report()
        elif isinstance(event, Lost):
            self._losses += gateway.connected
            self._attempts += 1
            self._lost, self._retry_s = event.reason, event.retry_s
            gateway.on_lost()
            self._report()
        elif isinstance(event, Stalled):
            self._stalled_s = event.age_s
            self._report()

    def _publish(self, out: Publication) -> None:
        """Publish the drives first, because the sensors' last sample completes the tick."""
        state = self._gateway.fence.state
        self._drives.publish(convert.drives_message(out.drives, out.stamp_ns, state))
        for name, publisher in self._sensors.items():
            if name not in out.values:
                continue
            message = convert.sensor_message(name, out.values[name], out.stamp_ns)
            if name == "depth" and (fused := out.fused) is not None:
                convert.add_basis(message, fused, fused.footprint_mm, self._footprint_sha256)
            publisher.publish(message)

    def _on_command(self, message: WeldCommand) -> None:
        gateway, stamp_ns = self._gateway, convert.stamp_ns(message.header.stamp)
        refused = gateway.gate.total()
        now_s = time.monotonic()
        command, signature = convert.command(message), convert.signature(message)
        sender = message.source, message.healthy
        order = gateway.on_command(command, stamp_ns, *sender, now_s, signature)
        self._stop.look()
        if order is not None and self._link is not None:
            self._refused = ""
            self._link.write(order)
        elif gateway.gate.last and gateway.gate.total() > refused:
            self._writers.note_refused(message.leader)
            why = gateway.gate.last
            if why.code != self._refused:
                self.get_logger().warning(f"command refused: {why.words}")
            self._refused = why.code

    # ---------------------------------------------------------------- reports

    def _why_not(self, values: dict[str, Any]) -> str | None:
        """Why parameters contradict the connected machine; None if they do not."""
        try:
            if self._link is not None:
                self._link.check(GatewayParameters.from_values(values).limits)
        except LinkError as error:
            return str(error)
        return None

    def _on_parameters(self, values: dict[str, Any]) -> None:
        if self.is_configured:
            self._gateway.configure(values)
        if self._link is not None:
            self._writers.set_sources()
            self._link.settings = GatewayParameters.from_values(values)

    def _announce(self) -> None:
        self._diagnostics.publish([Report("connection", OK, SEARCHING, STARTING)])

    def _report(self) -> None:
        gateway, link = self._gateway, self._link
        if link is None:
            return
        totals = (gateway.gate.total(), gateway.failed)
        refused, failed = (new - old for new, old in zip(totals, self._reported, strict=True))
        self._reported = totals
        longest_s, self._longest_write_s = self._longest_write_s, 0.0
        attempts, retry_s = self._attempts, self._retry_s
        endpoint, connected = self._machine.endpoint, gateway.connected
        lines = [
            reports.connection(endpoint, connected, self._lost, self._losses, attempts, retry_s),
            reports.machine(gateway, self._stalled_s, link.tracker.skipped, link.tracker.restarts),
            reports.clock(gateway, self._settings.values),
            commands_report(
                gateway.gate, refused, self._writers.names, self._writers.unauthorised()
            ),
            reports.writes(gateway, failed, longest_s),
        ]
        self._diagnostics.publish(lines)
        for line in lines:
            if line.part not in ("connection", "machine"):
                continue
            logged = (line.level, line.code, _names(line.what))
            if self._logged.get(line.part) != logged:
                self._logged[line.part] = logged
                log(self, line.level, f"{line.part}: {line.words}")


def _names(data: Any) -> Any:
    """A fact's fields without its figures, so that a count or a time alone is nothing new."""
    if isinstance(data, Fact):
        return data.code, tuple(_names(item) for item in data.data.values())
    if isinstance(data, Mapping):
        return tuple((key, _names(item)) for key, item in data.items())
    if isinstance(data, list | tuple):
        return tuple(map(_names, data))
    return None if isinstance(data, int | float) else str(data)


main = main_of(MachineNode, "fsw_machine", __doc__, GatewayParameters)


if __name__ == "__main__":
    sys.exit(main())
