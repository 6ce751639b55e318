"""The monitor as a node: watches the weld, names causes and advice.

It publishes no command and no set-point.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from math import nan
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.subscription import Subscription

from fsw_control import messages_ros as convert
from fsw_control.coded import Fact, Worded
from fsw_control.contract import Command
from fsw_control.light_node_ros import LightNode
from fsw_control.message_synchronizer import SampleSet
from fsw_control.node_arguments import NodeArguments
from fsw_control.node_main_ros import run
from fsw_control.parameters_ros import ParameterValues
from fsw_control.reports_ros import OK, WARN, DiagnosticsPublisher, Report
from fsw_control.topics_ros import SENT, STREAM, subscribe_drives, subscribe_sensors
from fsw_control.weld_ticks_ros import WeldTicks
from fsw_model import ModelParameters
from fsw_msgs.msg import WeldCommand, WeldEstimate, WeldFinding, WeldHealth
from fsw_quality.diagnosis import Finding, WatchCause
from fsw_quality.likelihood import covariance_from
from fsw_quality.monitor import Monitor, Sample
from fsw_quality.parameters import MonitorParameters

_LOOK_S, _REPORT_S = 0.1, 1.0
#: without drives for longer, the plant may be gone; the next one must not take this node for a
#: part of its graph
_SILENT_S = 2.0
_UNKNOWN = Command(nan, nan)


class Watching(Worded):
    """State of the watch, and of a cause that was an alarm."""

    NOTHING = "nothing to watch: no measurements of a weld"
    LEARNING = "learning the disturbances of this weld"
    WATCHING = "watching"
    SHOWN = "watching; {findings}"
    OVER = "no warning"


class MonitorNode(LightNode, Node):  # type: ignore[misc]  # rclpy has no types everywhere
    """Joins a weld's topics into ticks for :class:`~fsw_quality.monitor.Monitor`; reports.

    A plant may wait with its first tick for a number of subscribers of its sensors, meant are the
    controllers. So this node subscribes to the sensors only while it hears the drives.
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__("fsw_monitor", **arguments)
        self._settings = ParameterValues(self, MonitorParameters)
        self._process, model = self._settings["process"], self._settings["model_file"]
        parameters = ModelParameters.from_file(model) if model else None
        self._monitor = Monitor(
            self._process, parameters, covariance_from(self._settings["covariance_file"])
        )
        self._ticks = WeldTicks(self, self._consume, _UNKNOWN, await_drives=True)
        self._applied = self._ticks.applied
        self._sensors: list[Subscription] = []
        self._drives_s = float("-inf")
        self._newest_ns = 0
        self._shown: dict[WatchCause, Finding | None] = {}  # once present; None: no longer
        self._longest_step_s = 0.0
        self._health = self.create_publisher(WeldHealth, "fsw/monitor/health", SENT)
        self._diagnostics = DiagnosticsPublisher(self)
        self.create_subscription(WeldCommand, "fsw/command", self._ticks.on_command, STREAM)
        subscribe_drives(self, self._on_drives)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_LOOK_S, self._look, clock=steady)
        self.create_timer(_REPORT_S, self._report, clock=steady)

    # ---------------------------------------------------------------- ticks

    def _on_drives(self, stamp_ns: int, acting: Command) -> None:
        self._drives_s = time.monotonic()
        if not self._sensors:
            self._sensors = subscribe_sensors(self, self._ticks.on_sample)
        self._ticks.on_drives(stamp_ns, acting)

    def _look(self) -> None:
        self._ticks.expire(self._settings["patience_s"])
        if self._sensors and time.monotonic() - self._drives_s > _SILENT_S:
            for subscription in self._sensors:
                self.destroy_subscription(subscription)
            self._sensors = []

    def _consume(self, ticks: list[SampleSet]) -> None:
        for tick in ticks:
            if tick.restarted:
                self._applied.restart()
                self._monitor.restart()
            command = self._applied.before(tick.stamp_ns)
            drives, values = tick.drives or _UNKNOWN, tick.values
            began_s, before = time.perf_counter(), self._monitor.seconds
            self._monitor.step(
                Sample(
                    tick.stamp_ns * 1e-9,
                    values.get("depth", nan),
                    values.get("torque", nan),
                    values.get("thermocouple", nan),
                    *drives,
                    *command,
                )
            )
            self._longest_step_s = max(self._longest_step_s, time.perf_counter() - began_s)
            self._newest_ns = tick.stamp_ns
            if self._monitor.seconds != before:
                self._publish()

    # ---------------------------------------------------------------- reports

    def _publish(self) -> None:
        """Publish what was found.

        New alarms also as diagnostics, which otherwise come once a second.
        """
        monitor, gains = self._monitor, self._monitor.gains
        torque_nm, force_kn, temperature_c = monitor.disturbances
        self._health.publish(
            WeldHealth(
                header=convert.header(self._newest_ns),
                process=self._process,
                learning=monitor.learning,
                findings=[_message(finding) for finding in monitor.findings],
                estimates=[
                    WeldEstimate(
                        cause=int(estimate.cause), reason=int(estimate.reason), **estimate.si
                    )
                    for estimate in monitor.estimates
                ],
                gain_names=list(gains),
                gains=[gain for gain, _ in gains.values()],
                gain_errors=[error for _, error in gains.values()],
                torque=torque_nm,
                force=1e3 * force_kn,
                temperature=temperature_c,
            )
        )
        now: dict[WatchCause, Finding | None] = {
            finding.cause: finding for finding in monitor.findings if finding.alarm
        }
        changed = now.keys() != {
            cause for cause, finding in self._shown.items() if finding is not None
        }
        self._shown = dict.fromkeys(self._shown) | now
        if changed:
            self._report()

    def _report(self) -> None:
        watched = bool(self._sensors) and self._monitor.seconds > 0
        shown = tuple(finding.fact for finding in self._monitor.findings if not finding.alarm)
        state = Fact.of(Watching.WATCHING)
        if not watched:
            state = Fact.of(Watching.NOTHING)
        elif shown:
            state = Fact.of(Watching.SHOWN, findings=shown)
        elif self._monitor.learning:
            state = Fact.of(Watching.LEARNING)
        step_ms = f"{1e3 * self._longest_step_s:.3f}"
        sizes = (
            {estimate.cause.word: estimate.text for estimate in self._monitor.estimates}
            if watched
            else {}
        )
        lines = [Report("watch", OK, state, {"longest step [ms]": step_ms, **sizes})]
        for cause, finding in self._shown.items():
            if finding is None or not watched:
                lines.append(Report(cause.word, OK, Fact.of(Watching.OVER), {}))
                continue
            likelihood = (
                {"log likelihood ratio": f"{finding.log_likelihood:.1f}"}
                if cause.of_process
                else {}
            )
            lines.append(
                Report(cause.word, WARN, finding.fact, {"action": finding.action, **likelihood})
            )
        self._diagnostics.publish(lines)


def _message(finding: Finding) -> WeldFinding:
    size, error = finding.si
    return WeldFinding(
        cause=int(finding.cause),
        alarm=finding.alarm,
        size=size,
        error=error,
        log_likelihood=finding.log_likelihood,
        others=[int(cause) for cause in finding.others],
    )


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is stopped; returns the exit code."""
    about = "Watches a weld and warns of faults early, with cause and advice. Commands nothing."
    return run(MonitorNode, args, NodeArguments("fsw_monitor", about, MonitorParameters))


if __name__ == "__main__":
    sys.exit(main())
