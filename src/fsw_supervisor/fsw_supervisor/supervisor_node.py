"""The supervisor as a node: converts messages, calls the arbiter, publishes."""

from __future__ import annotations

import sys
import time
import uuid

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher

from fsw_control import messages_ros as convert
from fsw_control.cause import Cause
from fsw_control.deadline_timer_ros import DeadlineTimer
from fsw_control.light_node_ros import DELIVERY_S, LightNode
from fsw_control.node_main_ros import main_of
from fsw_control.parameters_ros import ParameterValues
from fsw_control.ranges import beyond_trip
from fsw_control.reason import Reason
from fsw_control.references_ros import KeptReference
from fsw_control.reports_ros import DiagnosticsPublisher, log
from fsw_control.stop import Stop
from fsw_control.stop_ros import StopHolder
from fsw_control.topics_ros import LATEST, SENT, STREAM, subscribe_sensors
from fsw_msgs.msg import ControllerStatus, DriveFeedback, SupervisorState, WeldCommand
from fsw_supervisor import reports_ros as reports
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.confirmation import Confirmations
from fsw_supervisor.controller_topics_ros import ControllerTopics
from fsw_supervisor.failover import Failover, Role
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.services_ros import Leadership, OperatorServices
from fsw_supervisor.state_machine import Mode, Standing
from fsw_supervisor.tick import Decision, ProposalInput

_HOUSEKEEPING_S = 0.2
_REPORT_S = 1.0


class SupervisorNode(LightNode, Node):
    """The only writer of ``fsw/command``, or the standby of that writer.

    Every message is passed to the pure :class:`Arbiter` at once; its decisions are published from
    the same callback, without extra delay. A timer on the steady clock, set to the arbiter's next
    wake-up, handles the deadlines. The leader's publishers and services exist only while this node
    leads.
    """

    def __init__(self) -> None:
        super().__init__("fsw_supervisor")
        self._values = ParameterValues(self, SupervisorParameters)
        values = self._values.values
        lockstep = values["lockstep"]
        is_lockstep = lockstep == "on"
        if lockstep == "auto":
            is_lockstep = bool(self.get_parameter("use_sim_time").value)
        read = SupervisorParameters.from_values
        self._arbiter = Arbiter(read(values), is_lockstep)
        self._values.on_change(lambda changed: self._arbiter.configure(read(changed)))
        identity, now_s = uuid.uuid4().hex[:12], time.monotonic()
        self._failover = Failover(self._arbiter, identity, values["standby"], now_s)
        self._role: Role | None = None
        self._commands: Publisher | None = None
        self._states: Publisher | None = None
        self._leadership = Leadership(self, self._failover)
        lockstep_wait_s = 2.0 * values["lockstep_deadline_s"] if self._arbiter.lockstep else 0.0
        self._confirmations = Confirmations(self._failover, lockstep_wait_s)
        parts = self._arbiter, self._leadership.certain, self._confirmations, self._publish
        self._operator_services = OperatorServices(self, *parts)
        self._stop = StopHolder(self, self._arbiter.machine.register, self._on_stop)
        self._diagnostics = DiagnosticsPublisher(self, "fsw_supervisor")
        self._command_topic = self.resolve_topic_name("fsw/command")
        self._published_revision = -1
        self._next_report_s = 0.0
        self._kept_reference = KeptReference(
            self,
            self._leadership.certain,
            lambda depth_mm, temperature_c: beyond_trip(
                depth_mm, temperature_c, self._values.values
            ),
        )
        takers = self._on_proposal, self._on_status, self._kept_reference.listen_to
        self._controllers = ControllerTopics(self, self._arbiter.registry, *takers)
        self.create_subscription(DriveFeedback, "fsw/drives", self._on_drives, STREAM)
        subscribe_sensors(self, self._on_sample, self._arbiter.on_depth_deviation)
        self.create_subscription(WeldCommand, "fsw/command", self._on_command, STREAM)
        states = "fsw/supervisor/state"
        self.create_subscription(SupervisorState, states, self._on_leader_state, LATEST)
        for name in (values["controller"], *values["fallbacks"]):
            self._controllers.subscribe(name)
        self._wakeup = DeadlineTimer(self, self._on_wakeup)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_HOUSEKEEPING_S, self._on_housekeeping, clock=steady)
        self._on_housekeeping()

    # ---------------------------------------------------------------- topics

    def _on_sample(self, sensor: str, stamp_ns: int, value: float) -> None:
        self._publish(self._arbiter.on_sample(sensor, stamp_ns, value, time.monotonic()))

    def _on_drives(self, message: DriveFeedback) -> None:
        now_s = time.monotonic()
        self._failover.on_actuator(convert.actuator_state(message), now_s)
        self._confirmations.on_report()
        stamp_ns = convert.stamp_ns(message.header.stamp)
        self._publish(self._arbiter.on_drives(stamp_ns, convert.command(message), now_s))

    def _on_stop(self, stop: Stop) -> None:
        self._failover.on_stop(stop)
        self._publish([])

    def _on_proposal(self, name: str, message: WeldCommand) -> None:
        stamp_ns = convert.stamp_ns(message.header.stamp)
        command, reason = convert.command(message), convert.reason(message)
        proposal = ProposalInput(stamp_ns, message.source, command, message.healthy, reason)
        self._publish(self._arbiter.on_proposal(name, proposal, time.monotonic()))

    def _on_status(self, name: str, message: ControllerStatus) -> None:
        sensors = tuple(message.tolerated_sensors)
        now_s, source = time.monotonic(), message.applied_source
        self._publish(self._arbiter.on_status(name, sensors, message.selected, now_s, source))

    def _on_command(self, message: WeldCommand) -> None:
        stamp_ns, command = convert.stamp_ns(message.header.stamp), convert.command(message)
        self._failover.on_command(convert.signature(message), stamp_ns, message.source, command)
        self._publish([])

    def _on_leader_state(self, message: SupervisorState) -> None:
        if self._failover.on_leader_state(convert.signature(message)):
            inhibited = {
                item.name: Reason.of_messages(item.why)
                for item in message.controllers
                if item.latched_out
            }
            mode, controller = message.actual_mode, message.actual_controller
            cause, why = Cause(message.cause), Reason.of_messages(message.why)
            actual = Standing(mode, controller, cause, why, message.who)
            target = message.target_controller, message.target_mode
            self._arbiter.follow_operator(*target, inhibited, actual)
        self._publish([])

    def _on_wakeup(self) -> None:
        if self._arbiter.machine.mode is Mode.START:
            # All controllers in the graph have to report which of them was active.
            self._controllers.look()
        self._publish(self._arbiter.on_time(time.monotonic()))

    # ---------------------------------------------------------------- leader and standby

    def _publish(self, decisions: list[Decision]) -> None:
        """After every call of the arbiter: send, set the timer, and report changes."""
        permitted = self._failover.pass_on(decisions, time.monotonic())
        if self._role is not self._failover.role:
            self._role = self._failover.role
            if self._role is Role.ACTIVE:
                self._open()
            else:
                self._kept_reference.drop()
            self.get_logger().info(f"role: {self._role}")
            self._report_changes()
        elif self._failover.unanswered:
            # A publisher needs some time to be discovered before its first command.
            self._open_commands()
        for decision in permitted:
            self._open_commands().publish(reports.command(decision, self._failover.signature))
        if self._arbiter.ticks.present is not None:
            self._kept_reference.on_tick(self._arbiter.ticks.present.stamp_ns)
        self._stop.look()
        self._leadership.look()
        self._confirmations.look(time.monotonic())
        self._wakeup.set(self._failover.wakeup_s)
        if self._arbiter.machine.revision != self._published_revision or self._failover.asserting:
            self._report_changes()

    def _open_commands(self) -> Publisher:
        if self._commands is None:
            self._commands = self.create_publisher(WeldCommand, "fsw/command", SENT)
        return self._commands

    def _open(self) -> None:
        """Create the leader's publishers and services."""
        self._open_commands()
        self._kept_reference.open()
        if self._states is None:
            self._states = self.create_publisher(SupervisorState, "fsw/supervisor/state", LATEST)
        self._operator_services.open()

    def _close(self) -> None:
        """Destroy the leader's publishers and services, after open requests have been answered."""
        self._operator_services.close()
        self._kept_reference.close()
        if self._states is not None:
            self.destroy_publisher(self._states)
            self._states = None
        if self._commands is not None and not self._failover.unanswered:
            self.destroy_publisher(self._commands)
            self._commands = None

    def _report_changes(self) -> None:
        """Publish the state and log the events; deferred until the role is decided."""
        if self._role is Role.LISTENING:
            return
        machine = self._arbiter.machine
        self._published_revision = machine.revision
        self._failover.asserting = False
        while machine.events:
            event = machine.events.popleft()
            text = f"[{event.who}] {event.fact.words}"
            if self._role is Role.ACTIVE:
                log(self, reports.LEVELS[event.level], text)
            else:
                self.get_logger().debug(text)
        if self._states is not None and self._role is Role.ACTIVE:
            if self._arbiter.lockstep:  # else the state before this one might be lost
                self.await_arrival(DELIVERY_S, self._states)
            now, signature = self.get_clock().now().to_msg(), self._failover.signature
            self._states.publish(reports.state(self._arbiter, now, signature))

    # ---------------------------------------------------------------- graph

    def _on_housekeeping(self) -> None:
        now_s = time.monotonic()
        self._kept_reference.look(now_s)
        self._controllers.look()
        own = self._commands is not None
        self._failover.rival_writer = self.count_publishers(self._command_topic) > own
        self._publish(self._arbiter.on_time(now_s))
        if self._role is not Role.ACTIVE:
            self._close()
        if now_s >= self._next_report_s:
            self._next_report_s = now_s + _REPORT_S
            self._report_changes()
            self._diagnose()

    def _diagnose(self) -> None:
        if self._role is Role.LISTENING:
            # for a second at most; whoever watches would miss the report afterwards
            return
        if self._role is not Role.ACTIVE:
            line = reports.standby(str(self._role), self._failover.unanswered, self.get_name())
            self._diagnostics.publish([line])
            return
        names = [record.name for record in self._arbiter.registry]
        namesakes = {name: self._controllers.proposers(name) for name in names}
        limits = (self._values["latency_warn_s"], self._values["latency_error_s"])
        writers = self.count_publishers(self._command_topic)
        lines = reports.diagnostics(self._arbiter, writers, namesakes, limits)
        self._diagnostics.publish([*lines, self._kept_reference.report()])


main = main_of(SupervisorNode, "fsw_supervisor", __doc__, SupervisorParameters)


if __name__ == "__main__":
    sys.exit(main())
