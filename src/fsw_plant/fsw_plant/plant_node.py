"""The plant as a node: publishes what the emulator's sensors say and passes on the commands that arrive."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import Temperature

from fsw_control import messages_ros as convert
from fsw_control import units
from fsw_control.node_main_ros import run
from fsw_control.parameters import ParameterError
from fsw_control.parameters_ros import ParameterValues
from fsw_control.topics_ros import LATEST, STREAM
from fsw_model import OperatingPointError
from fsw_msgs.msg import DriveFeedback, PlantState, ShoulderDepth, SpindleTorque, SupervisorState, WeldCommand
from fsw_msgs.srv import ResetPlant, SetDisturbance, SetFault
from fsw_plant import reports
from fsw_plant.claim_ros import STARTING, Claim
from fsw_plant.config import PlantConfig, specs
from fsw_plant.disturbances import DisturbanceError
from fsw_plant.emulator import PlantEmulator
from fsw_plant.schedule import PlantSchedule
from fsw_plant.tick_stamps import TickStamps
from fsw_plant.truth_ros import FROM_WIRE, TruthMessage, reading_messages

CLOCK = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
#: sources of commands that are no controllers
BUILT_IN_SOURCES = ("manual", "hold", "safe_stop")
_PATROL_S = 0.2
_REPORT_S = 1.0
_READY_POLL_S = 0.02


class PlantNode(Node):
    """Ticks the emulator and connects it to the graph.

    Three ways to tick (parameters ``clock`` and ``speed``): every 0.1 s of the wall clock; simulated time at a pace;
    or lockstep, in which the command that answers a tick brings on the next one.
    """

    def __init__(self) -> None:
        super().__init__("fsw_plant")
        self._settings = ParameterValues(self, specs())
        values = self._settings.values
        self._plant = PlantEmulator(
            PlantConfig.from_values(values), PlantSchedule.from_text_or_file(values["scenario"])
        )
        self._speed = float(values["speed"])
        self._lockstep = self._speed == 0.0
        self._simulated = (
            self._speed != 1.0 or values["clock"] == "simulated" or bool(self.get_parameter("use_sim_time").value)
        )
        self._scenario = values["scenario"]
        self._stamps = TickStamps()
        self._truth = TruthMessage()
        self._clock_message = ClockMessage()
        self._answered = True
        self._sent_s = 0.0
        self._complaints = 0
        self._command_publishers: list[str] = []
        self._announced_sources: tuple[str, ...] = ()
        self._seen = (self._plant.watchdog.state, self._plant.stopped)
        self._reported_refusals = 0
        self._running = False
        self._open_topics()
        self._claim = Claim(self)
        self._claim.make(values["discovery_s"], self._announce)
        self._open_services()
        self._settings.add_check(self._why_not)
        self._settings.on_change(self._configure)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._steady = steady
        self._report_timer = self.create_timer(_REPORT_S, self._report, clock=steady)
        self._patrol_timer = self.create_timer(_PATROL_S, self._patrol, clock=steady)
        self._ready_timer = self.create_timer(_READY_POLL_S, self._start_when_ready, clock=steady)
        self._waiting_told_s = time.monotonic()

    def _open_topics(self) -> None:
        self._depths = self.create_publisher(ShoulderDepth, "fsw/depth", STREAM)
        self._torques = self.create_publisher(SpindleTorque, "fsw/spindle_torque", STREAM)
        self._temperatures = self.create_publisher(Temperature, "fsw/thermocouple", STREAM)
        self._drives = self.create_publisher(DriveFeedback, "fsw/drives", STREAM)
        self._truths = self.create_publisher(PlantState, "fsw/plant/truth", STREAM)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", STREAM)
        self._clocks = self.create_publisher(ClockMessage, "/clock", CLOCK) if self._simulated else None
        self.create_subscription(WeldCommand, "fsw/command", self._on_command, STREAM)
        self.create_subscription(SupervisorState, "fsw/supervisor/state", self._on_supervisor, LATEST)

    def _open_services(self) -> None:
        self.create_service(SetDisturbance, "fsw/plant/set_disturbance", self._on_set_disturbance)
        self.create_service(SetFault, "fsw/plant/set_fault", self._on_set_fault)
        self.create_service(ResetPlant, "fsw/plant/reset", self._on_reset)

    # ---------------------------------------------------------------- ticks

    def _start_when_ready(self) -> None:
        missing = self._missing()
        if missing:
            now_s = time.monotonic()
            if now_s >= self._waiting_told_s + self._settings["lockstep_timeout_s"]:
                self._waiting_told_s = now_s
                self.get_logger().warning(f"first tick waits for {', '.join(missing)}")
            return
        self._ready_timer.cancel()
        self.destroy_timer(self._ready_timer)
        self._running = True
        self._publish_tick()
        if not self._lockstep:
            self._tick_timer = self.create_timer(0.1 / self._speed, self._next_tick, clock=self._steady)

    def _missing(self) -> list[str]:
        """What the first tick still has to wait for."""
        wanted = self._settings["wait_for_subscribers"]
        missing = [
            f"{wanted - count} more subscribers of {publisher.topic_name}"
            for publisher in (self._depths, self._torques, self._temperatures)
            if (count := publisher.get_subscription_count()) < wanted
        ]
        # Lockstep cannot advance without a commanding node, and a tick without subscribers would have to be sent twice.
        if (wanted or self._lockstep) and not self.count_publishers("fsw/command"):
            missing.append("a publisher of fsw/command")
        return missing

    def _next_tick(self) -> None:
        self._plant.step()
        self._publish_tick()

    def _publish_tick(self) -> None:
        plant = self._plant
        stamp_ns = None if self._simulated else self._stamps.next(self._now_ns())
        reading = plant.measure(stamp_ns)
        self._sent_s = time.monotonic()
        self._complaints = 0
        self._answered = False
        self._send()
        seen = (plant.watchdog.state, plant.stopped)
        if seen != self._seen:
            self._tell(reading.stamp_ns)

    def _send(self) -> None:
        """Publish the present tick; the drives first, because the sensors' last sample completes the tick."""
        plant = self._plant
        reading = plant.measure()
        truth = self._truth.fill(plant.truth())
        if self._clocks is not None:
            clock = self._clock_message.clock
            clock.sec, clock.nanosec = truth.header.stamp.sec, truth.header.stamp.nanosec
            self._clocks.publish(self._clock_message)
        self._truths.publish(truth)
        drives, depths, torques, temperatures = reading_messages(reading)
        self._drives.publish(drives)
        for depth in depths:
            self._depths.publish(depth)
        for torque in torques:
            self._torques.publish(torque)
        for temperature in temperatures:
            self._temperatures.publish(temperature)

    def _on_command(self, message: WeldCommand) -> None:
        if not self._running:
            return
        stamp_ns = convert.stamp_ns(message.header.stamp)
        refusal = self._plant.apply(convert.command(message), stamp_ns, message.source, message.healthy)
        if refusal:
            self.get_logger().warning(f"command refused: {self._plant.gate.last_refusal}", throttle_duration_sec=1.0)
        # A command that is refused for its content is an answer too: the tick goes on with the last valid one.
        if self._lockstep and not self._answered and refusal != "source" and stamp_ns == self._plant.measure().stamp_ns:
            self._answered = True
            self._next_tick()

    def _on_supervisor(self, message: SupervisorState) -> None:
        self._announced_sources = (*(record.name for record in message.controllers), *BUILT_IN_SOURCES)
        self._set_sources()

    def _set_sources(self) -> None:
        """With a second publisher of commands about, only sources that the supervisor knows are obeyed."""
        sources = self._plant.config.sources
        if not sources and len(self._command_publishers) > 1:
            sources = self._announced_sources
        self._plant.gate.sources = frozenset(sources)

    # ---------------------------------------------------------------- watching

    def _patrol(self) -> None:
        publishers = sorted(info.node_name for info in self.get_publishers_info_by_topic("fsw/command"))
        if publishers != self._command_publishers:
            self._command_publishers = publishers
            self._set_sources()
            if len(publishers) > 1:
                self.get_logger().error(f"{len(publishers)} publishers of fsw/command: {', '.join(publishers)}")
        if self._lockstep and self._running and not self._answered:
            self._watch_answer(time.monotonic() - self._sent_s)

    def _watch_answer(self, waited_s: float) -> None:
        values = self._settings.values
        publishers = ", ".join(self._command_publishers) or "no node"
        what = (
            f"no command for tick {self._plant.tick} within {waited_s:.1f} s (fsw/command is published by {publishers})"
        )
        if 0.0 < values["lockstep_give_up_s"] <= waited_s:
            raise SystemExit(f"fsw_plant: {what}; giving up")
        if waited_s >= values["lockstep_timeout_s"] * (self._complaints + 1):
            self._complaints += 1
            self.get_logger().error(f"{what}; tick sent again")
            self._send()
            self._report()

    def _tell(self, stamp_ns: int) -> None:
        """Log and report what has changed of watchdog and process."""
        plant = self._plant
        before, self._seen = self._seen, (plant.watchdog.state, plant.stopped)
        if self._seen[0] != before[0]:
            report = reports.watchdog(plant)
            self._log(report.level, f"watchdog: {report.text}")
        if plant.stopped and not before[1]:
            self._log(reports.Level.ERROR, reports.process(plant).text)
        self._report()

    def _log(self, level: reports.Level, text: str) -> None:
        logger = self.get_logger()
        if level is reports.Level.ERROR:
            logger.error(text)
        elif level is reports.Level.WARN:
            logger.warning(text)
        else:
            logger.info(text)

    def _announce(self) -> None:
        self._publish_reports([reports.Report("clock", reports.Level.OK, STARTING, {})])

    def _report(self) -> None:
        plant = self._plant
        refused = plant.gate.total()
        new, self._reported_refusals = max(0, refused - self._reported_refusals), refused
        self._publish_reports(
            [
                reports.clock(self._mode(), self._running, self._stamps.jumps, self._complaints),
                reports.process(plant),
                reports.watchdog(plant),
                reports.commands(plant, new, self._command_publishers),
                reports.sensors(plant),
            ]
        )

    def _mode(self) -> str:
        if self._lockstep:
            return "lockstep"
        return f"simulated time at speed {self._speed:g}" if self._simulated else "real time"

    def _publish_reports(self, lines: list[reports.Report]) -> None:
        now_ns = self._plant.measure().stamp_ns if self._simulated and self._running else self._now_ns()
        messages = [
            convert.diagnostics_message(
                now_ns,
                f"{self.get_name()}: {line.part}",
                bytes([line.level]),
                line.text,
                line.values,
                self._claim.hardware_id,
            )
            for line in lines
        ]
        whole = messages[0]
        whole.status = [message.status[0] for message in messages]
        self._diagnostics.publish(whole)

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    # ---------------------------------------------------------------- settings and services

    def _why_not(self, values: dict[str, Any]) -> str | None:
        """Why parameters cannot be taken together, or None."""
        try:
            PlantConfig.from_values(values)
            if values["scenario"] != self._scenario:
                PlantSchedule.from_text_or_file(values["scenario"])
        except (ParameterError, DisturbanceError) as error:
            return str(error)
        return None

    def _configure(self, values: dict[str, Any]) -> None:
        if values["scenario"] != self._scenario:
            self._scenario = values["scenario"]
            self._plant.schedule = PlantSchedule.from_text_or_file(self._scenario)
        self._plant.reconfigure(PlantConfig.from_values(values))
        self._set_sources()

    def _on_set_disturbance(
        self, request: SetDisturbance.Request, response: SetDisturbance.Response
    ) -> SetDisturbance.Response:
        try:
            amplitude = FROM_WIRE.get(request.channel, float)(request.amplitude)
            self._plant.set_disturbance(request.channel, request.shape, amplitude, request.duration, request.period)
        except DisturbanceError as error:
            response.ok, response.message = False, f"refused: {error}"
        else:
            response.ok, response.message = True, f"{request.channel}: {request.shape} from the next tick on"
            self.get_logger().info(f"disturbance {response.message}, amplitude {request.amplitude:g}")
        return response

    def _on_set_fault(self, request: SetFault.Request, response: SetFault.Response) -> SetFault.Response:
        in_metres = request.sensor == "depth" and request.kind != "delay"
        magnitude = units.mm_from_m(request.magnitude) if in_metres else request.magnitude
        try:
            self._plant.set_fault(request.sensor, request.kind, magnitude, request.duration)
        except DisturbanceError as error:
            response.ok, response.message = False, f"refused: {error}"
        else:
            response.ok, response.message = True, f"{request.sensor}: {request.kind} from the next tick on"
            self.get_logger().info(f"fault {response.message}, magnitude {request.magnitude:g}")
        return response

    def _on_reset(self, request: ResetPlant.Request, response: ResetPlant.Response) -> ResetPlant.Response:
        try:
            self._plant.reset(
                seed=None if request.seed < 0 else request.seed,
                depth_mm=units.mm_from_m(request.depth) if request.depth != 0.0 else None,
                temperature_c=request.temperature if request.temperature != 0.0 else None,
            )
        except OperatingPointError as error:
            response.ok, response.message = False, f"refused: {error}"
            return response
        self._set_sources()
        truth = self._plant.truth()
        response.ok = True
        response.message = f"at equilibrium: {truth.depth_mm:.3f} mm, {truth.temperature_c:.1f} degC"
        self.get_logger().info(f"reset: {response.message}")
        return response


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run(PlantNode, args)


if __name__ == "__main__":
    sys.exit(main())
