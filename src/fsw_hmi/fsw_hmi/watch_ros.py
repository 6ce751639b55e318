"""What the page hears of the graph."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from math import degrees
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.subscription import Subscription

from fsw_control import messages_ros as convert
from fsw_control.contract import SENSORS, Command
from fsw_control.references_ros import reference_queue, subscribe_references
from fsw_control.topics_ros import LATEST, STREAM, subscribe_drives, subscribe_sensors
from fsw_hmi import reports_ros
from fsw_hmi.alarm_rules import NO_REPORT_S, Part
from fsw_hmi.weld_view import Row, WeldView
from fsw_msgs.msg import ControllerStatus, Prediction, SupervisorState, WeldCommand, WeldProgress

#: A plant that is silent for longer may be gone; the next one must not take this node for a part of its graph.
_SILENT_S = 1.0
#: A part that has not reported for longer is forgotten; so many are kept at most.
_FORGET_S, _MOST_PARTS = 600.0, 200
_PREDICTION_PERIOD_S = 0.5
_LEVELS = ("ok", "warn", "error", "stale")
_MOST_CONTROLLERS, _LONGEST_TEXT = 20, 200


class Watch:
    """Subscribes to everything that the page shows.

    A plant may wait with its first tick for a number of subscribers of its sensors, meant are the controllers. So this
    node subscribes to the sensors only while it hears the drives, whose subscribers are not counted.

    Parameters
    ----------
    node : Node
    on_rows : callable
        Gets the rows that are over, and whether another weld has begun.
    on_prediction : callable
        Gets a controller's prediction as the content of its frame.
    on_state : callable
        Called when the supervisor has reported.

    Attributes
    ----------
    references : ReferenceQueue
    view : WeldView
    state, progress : dict or None
        As the page gets them.
    state_s, progress_s : float
        When they came, on a steady clock.
    leader : str
        Signature of the leading supervisor.
    sensor_reasons : dict of str to str
        What the supervisor says of each sensor.
    row : Row or None
        The newest one.
    """

    def __init__(
        self,
        node: Node,
        on_rows: Callable[[list[Row], bool], None],
        on_prediction: Callable[[dict[str, Any]], None],
        on_state: Callable[[], None],
    ) -> None:
        self._node, self._on_rows, self._on_prediction, self._show_state = node, on_rows, on_prediction, on_state
        self.references = reference_queue(node)
        self.view = WeldView(self.references.at)
        self.state: dict[str, Any] | None = None
        self.progress: dict[str, Any] | None = None
        self.state_s = self.progress_s = float("-inf")
        self.leader = ""
        self.sensor_reasons: dict[str, str] = {}
        self.row: Row | None = None
        self._parts: dict[str, tuple[Part, float]] = {}
        self._sensors: list[Subscription] = []
        self._controllers: dict[str, float] = {}
        subscribe_references(node, self.references)  # what is refused, the supervisor and every controller report
        subscribe_drives(node, self._on_drives)
        node.create_subscription(WeldCommand, "fsw/command", self._on_command, STREAM)
        node.create_subscription(SupervisorState, "fsw/supervisor/state", self._on_state, LATEST)
        node.create_subscription(WeldProgress, "fsw/weld_progress", self._on_progress, LATEST)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, STREAM)

    # ---------------------------------------------------------------- ticks

    def look(self) -> None:
        """Leave the sensors of a plant that is silent; to be called several times a second."""
        tick_s = self.view.tick_s
        if self._sensors and tick_s is not None and time.monotonic() - tick_s > _SILENT_S:
            for subscription in self._sensors:
                self._node.destroy_subscription(subscription)
            self._sensors = []

    def _on_drives(self, stamp_ns: int, acting: Command) -> None:
        now_s = time.monotonic()
        if not self._sensors:
            self._sensors = subscribe_sensors(self._node, self._on_sample)
            self.view.good_s = dict.fromkeys(SENSORS, now_s + _SILENT_S)  # they have time to be found
        self._take(*self.view.on_drives(stamp_ns, acting, now_s))

    def _on_sample(self, sensor: str, stamp_ns: int, value: float) -> None:
        self._take(self.view.on_sample(sensor, stamp_ns, value, time.monotonic()))

    def _take(self, rows: list[Row], restarted: bool = False) -> None:
        if rows:
            self.row = rows[-1]
        if rows or restarted:
            self._on_rows(rows, restarted)

    def _on_command(self, message: WeldCommand) -> None:
        self.view.on_command(convert.stamp_ns(message.header.stamp), convert.command(message), time.monotonic())

    # ---------------------------------------------------------------- reports

    def _on_state(self, message: SupervisorState) -> None:
        self.state, self.state_s = reports_ros.state(message), time.monotonic()
        self.leader = message.header.frame_id
        for one in message.controllers:
            if one.name not in self._controllers and len(self._controllers) < _MOST_CONTROLLERS:
                self._follow(one.name)
        self._show_state()

    def _follow(self, controller: str) -> None:
        """Listen to a controller that the supervisor knows."""
        self._controllers[controller] = float("-inf")
        node, topic = self._node, f"fsw/{controller}"
        node.create_subscription(ControllerStatus, f"{topic}/status", self._on_status, STREAM)
        node.create_subscription(Prediction, f"{topic}/prediction", partial(self._on_plan, controller), STREAM)

    def _on_status(self, message: ControllerStatus) -> None:
        if message.selected:
            self.view.solve_ms = 1e3 * message.solve_time if message.solver_status else float("nan")

    def _on_plan(self, controller: str, message: Prediction) -> None:
        now_s = time.monotonic()
        if now_s - self._controllers[controller] >= _PREDICTION_PERIOD_S:
            self._controllers[controller] = now_s
            self._on_prediction(reports_ros.prediction(controller, message))

    def _on_progress(self, message: WeldProgress) -> None:
        self.progress, self.progress_s = reports_ros.progress(message), time.monotonic()
        self.view.angle_deg = degrees(message.angle)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        now_s = time.monotonic()
        for status in message.status:
            level = _LEVELS[min(int.from_bytes(status.level, "little"), 3)]
            if status.name in self._parts or len(self._parts) < _MOST_PARTS:
                self._parts[status.name] = (Part(level, status.message[:_LONGEST_TEXT]), now_s)
            if status.name == "fsw_supervisor: process":
                values = {pair.key: pair.value for pair in status.values}
                self.sensor_reasons = {name: values.get(f"{name} state", "good") for name in SENSORS}

    def parts(self) -> dict[str, Part]:
        """Diagnostics of every part by name."""
        now_s = time.monotonic()
        for name in [name for name, (_, heard_s) in self._parts.items() if now_s - heard_s > _FORGET_S]:
            del self._parts[name]
        return {
            name: part if now_s - heard_s <= NO_REPORT_S else Part("stale", part.text)
            for name, (part, heard_s) in sorted(self._parts.items())
        }
