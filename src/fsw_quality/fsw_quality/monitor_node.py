"""The monitor as a node: watches the weld, tells causes and advice; it publishes no command and no set-point."""

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
from fsw_control.contract import Command
from fsw_control.light_node_ros import LightNode
from fsw_control.message_synchronizer import SampleSet
from fsw_control.node_arguments import NodeArguments
from fsw_control.node_main_ros import run
from fsw_control.parameters import load
from fsw_control.parameters_ros import declare
from fsw_control.references_ros import reference_queue, subscribe_references
from fsw_control.reports_ros import OK, WARN, DiagnosticsPublisher, Report
from fsw_control.topics_ros import SENT, STREAM, subscribe_drives, subscribe_sensors
from fsw_control.weld_ticks_ros import WeldTicks
from fsw_model import ModelParameters
from fsw_msgs.msg import WeldCommand, WeldHealth
from fsw_quality.diagnosis import Finding, load_limits
from fsw_quality.monitor import Monitor, Sample

_LOOK_S, _REPORT_S = 0.1, 1.0
#: without drives for longer, the plant may be gone; the next one must not take this node for a part of its graph
_SILENT_S = 2.0
_UNKNOWN = Command(nan, nan)


class MonitorNode(LightNode, Node):  # type: ignore[misc]  # rclpy has no types everywhere
    """Joins the topics of a weld into ticks for :class:`~fsw_quality.monitor.Monitor`, and reports once a second.

    A plant may wait with its first tick for a number of subscribers of its sensors, meant are the controllers. So this
    node subscribes to the sensors only while it hears the drives.
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__("fsw_monitor", **arguments)
        self._settings = declare(self, "fsw_quality", "monitor.yaml")
        self._process, model = self._settings["process"], self._settings["model_file"]
        self._limits = load_limits()[self._process].limits
        self._monitor = Monitor(self._process, ModelParameters.from_file(model) if model else None)
        self._ticks = WeldTicks(self, self._consume, _UNKNOWN, await_drives=True)
        self._applied = self._ticks.applied
        self._references = reference_queue(self)
        self._sensors: list[Subscription] = []
        self._drives_s = float("-inf")
        self._newest_ns = 0
        self._told: dict[str, Finding | None] = {}
        self._longest_step_s = 0.0
        self._health = self.create_publisher(WeldHealth, "fsw/monitor/health", SENT)
        self._diagnostics = DiagnosticsPublisher(self)
        subscribe_references(self, self._references)
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
            reference, drives, values = self._references.at(tick.stamp_ns), tick.drives or _UNKNOWN, tick.values
            points = (nan, nan) if reference is None else (reference.depth_mm, reference.temperature_c)
            began_s, before = time.perf_counter(), self._monitor.figures
            self._monitor.step(
                Sample(
                    tick.stamp_ns * 1e-9,
                    values.get("depth", nan),
                    values.get("torque", nan),
                    values.get("thermocouple", nan),
                    *drives,
                    *command,
                    *points,
                    self._applied.latest.source,
                )
            )
            self._longest_step_s = max(self._longest_step_s, time.perf_counter() - began_s)
            self._newest_ns = tick.stamp_ns
            if self._monitor.figures is not before:
                self._tell()

    # ---------------------------------------------------------------- reports

    def _tell(self) -> None:
        """Publish what is new; a change of what is told also as diagnostics, which otherwise come once a second."""
        monitor, findings = self._monitor, self._monitor.findings
        names, gains = list(monitor.figures), monitor.gains
        self._health.publish(
            WeldHealth(
                header=convert.header(self._newest_ns),
                process=self._process,
                learning=monitor.learning,
                kinds=[one.kind for one in findings],
                causes=[one.cause for one in findings],
                advice=[one.advice for one in findings],
                confidences=[one.confidence for one in findings],
                figure_names=names,
                figures=[monitor.figures[name] for name in names],
                limits=[self._limits.get(name, nan) for name in names],
                gain_names=list(gains),
                gains=[gain for gain, _ in gains.values()],
                gain_errors=[error for _, error in gains.values()],
            )
        )
        now: dict[str, Finding | None] = {one.kind: one for one in findings}
        changed = now.keys() != {kind for kind, one in self._told.items() if one is not None}
        self._told = dict.fromkeys(self._told) | now
        if changed:
            self._report()

    def _report(self) -> None:
        watched = bool(self._sensors) and self._monitor.figures != {}
        text = "watching" if watched else "nothing to watch: no measurements of a weld"
        if watched and self._monitor.learning:
            text = "learning the weld's own normal values"
        values: dict[str, object] = {
            "figures": len(self._monitor.figures),
            "alarms": len(self._monitor.findings),
            "longest step [ms]": f"{1e3 * self._longest_step_s:.3f}",
        }
        for name, time_s in self._monitor.correlations_s.items():
            values[f"noise of {name} correlated over [s]"] = f"{time_s:.1f}"
        lines = [Report("watch", OK, text, values)]
        for kind, one in self._told.items():
            if one is None or not watched:
                lines.append(Report(kind, OK, "no warning", {}))
                continue
            said = {
                "advice": one.advice,
                "confidence in this cause": f"{one.confidence:.0%}",
                one.figure: f"{one.value:.4g}",
            }
            lines.append(Report(kind, WARN, one.cause, said | {"limit": f"{one.limit:.4g}"}))
        self._diagnostics.publish(lines)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is stopped; returns the exit code."""
    about = "Watches a weld and warns of what is about to go wrong, with cause and advice. It commands nothing."
    return run(MonitorNode, args, NodeArguments("fsw_monitor", about, load("fsw_quality", "monitor.yaml")))


if __name__ == "__main__":
    sys.exit(main())
