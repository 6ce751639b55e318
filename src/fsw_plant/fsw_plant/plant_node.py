"""The plant as a node: publishes the emulator's samples and applies incoming commands."""

from __future__ import annotations

import sys
import time
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import Header

from fsw_control import messages_ros as convert
from fsw_control.command_gate import Rejection
from fsw_control.command_writers_ros import CommandWriters
from fsw_control.fence import Barrier, Fence
from fsw_control.managed_node_ros import ManagedNode
from fsw_control.node_main_ros import main_of
from fsw_control.parameters import problem
from fsw_control.parameters_ros import ParameterValues
from fsw_control.reports_ros import OK, DiagnosticsPublisher, Report, log
from fsw_control.single_instance_ros import SEARCHING, STARTING, SingleInstanceGuard
from fsw_control.stop import StopCause
from fsw_control.stop_ros import StopHolder
from fsw_control.topics_ros import (
    LATEST,
    PLAYER_READY,
    SENT,
    STREAM,
    display_publisher,
    sensor_publishers,
)
from fsw_control.weld import TICK_NS, TICK_S
from fsw_msgs.msg import DriveFeedback, PlantState, WeldCommand, WeldProgress
from fsw_plant import reports_ros as reports
from fsw_plant.config import PlantConfig
from fsw_plant.emulator import PlantEmulator, WatchdogState, come_to_rest
from fsw_plant.pace import Lockstep, TickStamps
from fsw_plant.parameters import PlantParameters
from fsw_plant.process import prepare
from fsw_plant.schedule import PlantSchedule
from fsw_plant.services_ros import PlantServices

_WATCH_S = 0.2
_REPORT_S = 1.0
_READY_POLL_S = 0.02
#: period, in ticks, of lockstep's wait for slow subscribers: far less than any publisher's queue
#: (``SENT``, ``LATCHED``), as the other nodes do not wait
_ARRIVAL_TICKS = 50


class PlantNode(ManagedNode):
    """Ticks the emulator and connects it to the graph.

    Three ways to tick (parameters ``clock`` and ``speed``): every 0.1 s of the wall clock;
    simulated time at a given speed; or lockstep, in which the command that answers a tick starts
    the next one, once a player, if present, has sent what precedes it. It is a managed node: it
    ticks and accepts commands while it is active.
    """

    def __init__(self) -> None:
        super().__init__("fsw_plant")
        self._settings = ParameterValues(self, PlantParameters)
        self._settings.add_check(self._why_not)
        self._settings.on_change(self._on_parameters)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._running = False
        self._fence = Fence()  # outlasts a deactivation
        if self._settings["autostart"]:
            self.start()

    def configure(self) -> None:
        """Create the emulator and announce its topics."""
        values = self._settings.values
        config = PlantConfig.from_values(values)
        schedule = PlantSchedule.from_text_or_file(values["scenario"])
        prepare(config, self._log_preparation)
        self.emulator = PlantEmulator(config, schedule)
        self._speed = float(values["speed"])
        self._lockstep = self._speed == 0.0
        self._simulated = (
            self._speed != 1.0
            or values["clock"] == "simulated"
            or bool(self.get_parameter("use_sim_time").value)
        )
        self._scenario = values["scenario"]
        self._stamps = TickStamps()
        self._reported_refusals = 0
        self._guard = SingleInstanceGuard(self)
        self._open_topics(self._guard.instance)

    def activate(self) -> None:
        """Ensure that the plant is alone, and start ticking once all peers are present."""
        self._pace = Lockstep()
        self._reported = (self.emulator.watchdog.state, self.emulator.stopped)
        self._stop = StopHolder(self, self._fence.register, self._fence.hear)
        self.create_subscription(WeldCommand, "fsw/command", self._on_command, STREAM)
        # before the player's word that a tick is complete
        self.create_subscription(WeldProgress, "fsw/weld_progress", self._on_progress, LATEST)
        if self._lockstep:
            self.create_subscription(Header, PLAYER_READY, self._on_player_ready, LATEST)
        self._writers = CommandWriters(
            self, lambda: self.emulator.gate, lambda: self._settings["commands.sources"]
        )
        self._guard.check(self._settings["discovery_s"], self._announce)
        self._requests = PlantServices(self, self.emulator, on_reset=self._writers.set_sources)
        self.create_timer(_REPORT_S, self._report, clock=self._steady)
        self.create_timer(_WATCH_S, self._watch, clock=self._steady)
        self._ready_timer = self.create_timer(
            _READY_POLL_S, self._start_when_ready, clock=self._steady
        )
        self._waiting_logged_s = time.monotonic()

    def deactivate(self) -> None:
        """Bring the drives into the safe state, as the watchdog does; nothing is measured then."""
        was_running, self._running = self._running, False
        if was_running:
            come_to_rest(self.emulator)
            self._fence.stop(StopCause.WATCHDOG, self.emulator.measure().stamp_ns)
        force_kn = self.emulator.applied.force_kn
        self.get_logger().info(
            f"deactivated; the drives are in the safe state at {force_kn:.4g} kN"
        )

    def _open_topics(self, instance: str) -> None:
        # The first tick waits for subscribers of the sensors. A recorder subscribes to what it has
        # discovered; as the sensors are announced last, it then has the other topics of a tick,
        # too.
        self._clocks = (
            self.create_publisher(ClockMessage, "/clock", SENT) if self._simulated else None
        )
        self._truths = display_publisher(self, PlantState, "fsw/plant/truth")
        self._drives = self.create_publisher(DriveFeedback, "fsw/drives", SENT)
        self._sensors = sensor_publishers(self, self.emulator.core.sensors)
        self._diagnostics = DiagnosticsPublisher(self, instance=instance)

    def _log_preparation(self, share: float, what: str) -> None:
        self.get_logger().info(
            f"canister, {100.0 * share:.0f} %: {what}", throttle_duration_sec=2.0
        )

    # ---------------------------------------------------------------- ticks

    def _start_when_ready(self) -> None:
        if missing := self._missing():
            now_s = time.monotonic()
            if now_s >= self._waiting_logged_s + self._settings["lockstep_timeout_s"]:
                self._waiting_logged_s = now_s
                self.get_logger().warning(f"first tick waits for {', '.join(missing)}")
            return
        self._ready_timer.cancel()
        self.destroy_timer(self._ready_timer)
        self._writers.look()  # publishers that are present from the start get the first tick
        self._running, self._stepped_s = True, time.monotonic()
        self._pace.player_present = self.count_publishers(PLAYER_READY) > 0
        self._publish_tick()
        if not self._lockstep:
            self.create_timer(0.1 / self._speed, self._next_tick, clock=self._steady)

    def _missing(self) -> list[str]:
        """Conditions that delay the first tick."""
        required = self._settings["wait_for_subscribers"]
        missing = [
            f"{required - count} more subscribers of {publisher.topic_name}"
            for publisher in self._sensors.values()
            if (count := publisher.get_subscription_count()) < required
        ]
        # Lockstep cannot advance without a commanding node, and a tick without subscribers would
        # have to be sent twice.
        if (required or self._lockstep) and not self.count_publishers("fsw/command"):
            missing.append("a publisher of fsw/command")
        return missing

    def _next_tick(self) -> None:
        if self._fence.overdue:
            self.emulator.watchdog.expire()
        # In simulated time the watchdog counts ticks, as the wait for a command is no time there;
        # in real time it counts the steady clock, as a late timer is time without commands
        stamp_ns = self.emulator.measure().stamp_ns
        before_s, self._stepped_s = self._stepped_s, time.monotonic()
        self.emulator.step(TICK_S if self._simulated else self._stepped_s - before_s)
        if self.emulator.watchdog.state is WatchdogState.SAFE:
            self._fence.stop(StopCause.WATCHDOG, stamp_ns)
        self._publish_tick()
        self._stop.look()

    def _publish_tick(self) -> None:
        plant = self.emulator
        self._fence.measure()
        wall_ns = self.get_clock().now().nanoseconds
        plant.measure(None if self._simulated else self._stamps.next(wall_ns, time.monotonic_ns()))
        self._pace.begin(time.monotonic())
        self._send()
        if (plant.watchdog.state, plant.stopped) != self._reported:
            self._report_changes()

    def _send(self) -> None:
        """Publish the present tick: drives first, as the last sensor sample completes the tick."""
        reading, truth = self.emulator.measure(), reports.truth_message(self.emulator.truth())
        if not self._pace.resent:  # the player, which stays, has answered a repeated tick, or will
            depths = reading.samples["depth"]
            self._pace.await_player(depths[-1].stamp_ns if depths else None)
        if self._clocks is not None:
            self._clocks.publish(ClockMessage(clock=truth.header.stamp))
        self._truths.publish(truth)
        self._drives.publish(
            convert.drives_message(reading.drives, reading.stamp_ns, self._fence.state)
        )
        for name, publisher in self._sensors.items():
            for stamp_ns, value in reading.samples[name]:
                message = convert.sensor_message(name, value, stamp_ns)
                if name == "depth":
                    convert.add_basis(
                        message,
                        reading.fused,
                        reading.footprint_bias_mm,
                        self.emulator.config.footprint_sha256,
                    )
                publisher.publish(message)

    def _on_command(self, message: WeldCommand) -> None:
        if not self._running:
            return
        stamp_ns = convert.stamp_ns(message.header.stamp)
        gate = self.emulator.gate
        if barred := self._fence.check(convert.signature(message), message.source):
            refusal = gate.refuse(barred)
        else:
            command = convert.command(message)
            refusal = self.emulator.apply(command, stamp_ns, message.source, message.healthy)
        if not refusal:
            self._fence.take(message.source, stamp_ns)
        elif gate.last:
            self._writers.note_refused(message.leader)
            text = f"command refused: {gate.last.words}"
            self.get_logger().warning(text, throttle_duration_sec=1.0)
        # A command that is refused for its content is an answer too: the tick continues with the
        # last valid one.
        foreign = refusal in (Rejection.SOURCE, Barrier.LEADER)
        own = not foreign and stamp_ns == self.emulator.measure().stamp_ns
        if self._lockstep and own and not self._pace.answered:
            self._pace.answered = True
            self._go_on()
        self._stop.look()

    def _on_progress(self, message: WeldProgress) -> None:
        """Move the tool by the weld's programme; it stands while the programme is held."""
        if not (self._running and self.emulator.follows_programme):
            return
        age_ns = self.emulator.measure().stamp_ns - convert.stamp_ns(message.header.stamp)
        time_s = self.emulator.schedule.path_end_s - message.time_left
        self.emulator.follow_programme(time_s, message.state != "running", round(age_ns / TICK_NS))

    def _on_player_ready(self, message: Header) -> None:
        if self._pace.on_player(convert.stamp_ns(message.stamp)):
            self._go_on()

    def _go_on(self) -> None:
        """Begin the next tick of lockstep if nothing is awaited any more."""
        # Only who commands and who plays are awaited at each tick; a recorder or a page is awaited
        # now and then, before a queue overflows, so that a weld is no slower than its controllers
        if self._running and self._pace.complete:
            if self.emulator.tick % _ARRIVAL_TICKS == 0:
                self.await_arrival(self._settings["lockstep_timeout_s"])
            self._next_tick()

    def _go_on_without_player(self) -> None:
        self._pace.player_present = False
        self.await_arrival(
            self._settings["lockstep_timeout_s"]
        )  # the parent process may end this one now
        self._go_on()

    # ---------------------------------------------------------------- watching

    def _watch(self) -> None:
        writers = self._writers.names
        self._writers.look()
        if not (self._lockstep and self._running):
            return
        if self._writers.names and self._writers.names != writers:
            self._pace.on_new_writer()
        waited_s = self._pace.waited_s(time.monotonic())
        if not self._pace.answered:
            self._watch_answer(waited_s)
        elif not self.count_publishers(PLAYER_READY):
            self.get_logger().info(
                f"tick {self.emulator.tick}: the scenario's player has left; continuing without it"
            )
            self._go_on_without_player()
        elif waited_s >= self._settings["lockstep_timeout_s"]:
            self.get_logger().warning(
                f"tick {self.emulator.tick}: the player does not answer; continuing without it"
            )
            self._go_on_without_player()

    def _watch_answer(self, waited_s: float) -> None:
        values = self._settings.values
        publishers = ", ".join(self._writers.names) or "no node"
        text = f"no command for tick {self.emulator.tick} within {waited_s:.1f} s"
        text += f" (fsw/command is published by {publishers})"
        if 0.0 < values["lockstep_give_up_s"] <= waited_s:
            raise SystemExit(f"fsw_plant: {text}; giving up")
        if not self._pace.must_repeat(time.monotonic(), values["lockstep_timeout_s"]):
            return
        if waited_s >= values["lockstep_timeout_s"]:
            self.get_logger().error(f"{text}; tick repeated")
        self._send()
        self._report()

    def _report_changes(self) -> None:
        """Log and report changes of watchdog and process."""
        plant = self.emulator
        (state, stopped), self._reported = self._reported, (plant.watchdog.state, plant.stopped)
        changed = [reports.watchdog(plant)] if plant.watchdog.state != state else []
        changed += [reports.process(plant)] if plant.stopped and not stopped else []
        for line in changed:
            log(self, line.level, f"{line.part}: {line.words}")
        self._report()

    def _announce(self) -> None:
        self._publish_reports([Report("clock", OK, SEARCHING, STARTING)])

    def _report(self) -> None:
        mode, refused = _mode(self._speed, self._simulated), self.emulator.gate.total()
        new, self._reported_refusals = max(0, refused - self._reported_refusals), refused
        clock = reports.clock(mode, self._running, self._stamps.jumps, self._pace.resent)
        self._publish_reports([clock, *reports.parts(self.emulator, self._writers, new)])

    def _publish_reports(self, lines: list[Report]) -> None:
        time_ns = self.emulator.measure().stamp_ns if self._simulated and self._running else None
        self._diagnostics.publish(lines, time_ns)

    # ---------------------------------------------------------------- settings and services

    def _why_not(self, values: dict[str, Any]) -> str | None:
        """Why parameters contradict each other; None if they do not."""
        before = self.emulator.config if self.is_configured else None
        why = problem(lambda changed: PlantConfig.from_values(changed, before), values)
        scenario = values["scenario"]
        if why or (self.is_configured and scenario == self._scenario):
            return why
        return problem(lambda new: PlantSchedule.from_text_or_file(new["scenario"]), values)

    def _on_parameters(self, values: dict[str, Any]) -> None:
        if not self.is_configured:
            return
        if values["scenario"] != self._scenario:
            self._scenario = values["scenario"]
            self.emulator.take(PlantSchedule.from_text_or_file(self._scenario))
        self.emulator.reconfigure(PlantConfig.from_values(values, self.emulator.config))
        if self.is_active:
            self._writers.set_sources()


def _mode(speed: float, simulated: bool) -> str:
    if speed == 0.0:
        return "lockstep"
    return f"simulated time at speed {speed:g}" if simulated else "real time"


main = main_of(PlantNode, "fsw_plant", __doc__, PlantParameters)


if __name__ == "__main__":
    sys.exit(main())
