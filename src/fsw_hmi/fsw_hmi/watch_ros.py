"""What the page hears of the graph."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import degrees, nan
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.subscription import Subscription

from fsw_control import messages_ros as convert
from fsw_control import units
from fsw_control.cause import Cause, Severity
from fsw_control.contract import SAFE_STOP, Command
from fsw_control.depth_channels import ChannelHealth
from fsw_control.diagnostic_names import local_name
from fsw_control.heat_plan import SHARE_NAME
from fsw_control.reason import Reason
from fsw_control.references_ros import reference_queue, subscribe_references
from fsw_control.reports_ros import CODE
from fsw_control.sensors import DEPTH_CHANNELS, REQUIRED, SENSORS
from fsw_control.topics_ros import LATEST, STREAM, subscribe_drives, subscribe_sensors
from fsw_hmi.alarm_rules import (
    NO_PROGRAMME_S,
    NO_REPORT_S,
    RECORDING,
    UNDER_WAY,
    Part,
    Situation,
    standby_ready,
)
from fsw_hmi.frames import COLUMNS, heat_band, readable, short
from fsw_hmi.weld_view import Awake, Row, WeldView
from fsw_msgs.msg import (
    ControllerHealth,
    ControllerStatus,
    HeatPlan,
    Prediction,
    ShoulderDepth,
    SupervisorState,
    WeldCommand,
    WeldProgress,
)

#: A plant that is silent for longer may be gone; the next one must not take this node for a part
#: of its graph.
_SILENT_S = 1.0
#: A part that has not reported for longer is forgotten.
_FORGET_S = 600.0
#: parts of this software's own nodes, and of all others, at most
_MOST_PARTS = 400
_PREDICTION_PERIOD_S = 0.5
_LEVELS = ("ok", "warn", "error", "stale")
_WORDS = ("target_controller", "actual_controller", "target_mode", "actual_mode")
_MOST_CONTROLLERS = 20
#: what can be a part of a topic's name
_NAME = re.compile("[A-Za-z]([A-Za-z0-9_]{0,98}[A-Za-z0-9])?")


class Watch:
    """Subscribes to everything that the page shows.

    A plant may wait with its first tick for a number of subscribers of its sensors, meant are the
    controllers. So this node subscribes to the sensors only while it hears the drives, whose
    subscribers are not counted.

    ``on_rows`` gets the rows that are over, and whether time went back; it is called without rows
    at a report of the programme. ``show`` gets the kind and the content of a frame, and of
    predictions whose it is.
    """

    def __init__(
        self,
        node: Node,
        on_rows: Callable[[list[Row], bool], None],
        show: Callable[..., None],
    ) -> None:
        self._node, self._on_rows, self._show = node, on_rows, show
        self._known_heat_share = nan  # that the controller which commands uses
        self.references = reference_queue(node)
        self.view = WeldView(self.references.at)
        self.awake = Awake()  #: how old things are, without this process's own pauses
        self.now = Situation()  #: what has been heard; :class:`AlarmDesk` adds how old it is
        self.progress: dict[str, Any] | None = None  #: as the page gets it
        self.source = ""  #: who computed the last command
        self.state_s = self.progress_s = float("-inf")  #: when they came, on a steady clock
        self._goes_for = ""  # the controller that told what is attainable
        self.recording: dict[str, str] = {}  #: what the recorder has reported last
        self._parts: dict[tuple[str, str], tuple[Part, float]] = {}  # by node and part
        self._sensors: list[Subscription] = []
        self._controllers: dict[str, float] = {}
        # what is refused, the supervisor and every controller report
        subscribe_references(node, self.references)
        subscribe_drives(node, self._on_drives)
        node.create_subscription(WeldCommand, "fsw/command", self._on_command, STREAM)
        node.create_subscription(SupervisorState, "fsw/supervisor/state", self._on_state, LATEST)
        node.create_subscription(WeldProgress, "fsw/weld_progress", self._on_progress, LATEST)
        node.create_subscription(HeatPlan, "fsw/heat_plan", self._on_heat_plan, LATEST)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, STREAM)

    # ---------------------------------------------------------------- ticks

    @property
    def stopped(self) -> bool:
        """Whether the supervisor reports a safe stop."""
        return self.now.state is not None and self.now.state["actual_mode"] == SAFE_STOP

    def look(self) -> None:
        """Leave the sensors of a plant that is silent; to be called every 0.05 s."""
        self.awake.look(time.monotonic())
        tick_s = self.view.tick_s
        if self._sensors and tick_s is not None and time.monotonic() - tick_s > _SILENT_S:
            for subscription in self._sensors:
                self._node.destroy_subscription(subscription)
            self._sensors = []

    def _on_drives(self, stamp_ns: int, acting: Command) -> None:
        now_s = time.monotonic()
        if not self._sensors:
            self._sensors = subscribe_sensors(self._node, self._on_sample)
            depth = SENSORS["depth"].topic
            self._sensors.append(
                self._node.create_subscription(ShoulderDepth, depth, self._on_depth, STREAM)
            )
            # they have time to be found
            self.view.good_s = dict.fromkeys(REQUIRED, now_s + _SILENT_S)
        self._take(*self.view.on_drives(stamp_ns, acting, now_s))

    def _on_depth(self, message: ShoulderDepth) -> None:
        self.now.channels = channels_of(message)

    def _on_sample(self, sensor: str, stamp_ns: int, value: float) -> None:
        self._take(self.view.on_sample(sensor, stamp_ns, value, time.monotonic()))

    def _take(self, rows: list[Row], restarted: bool = False) -> None:
        if rows:
            self.now.values = dict(zip(COLUMNS[1:], rows[-1].values, strict=True))
        if rows or restarted:
            self._on_rows(rows, restarted)

    def _on_command(self, message: WeldCommand) -> None:
        self.source = readable(message.source, 100)
        self.view.on_command(
            convert.stamp_ns(message.header.stamp), convert.command(message), time.monotonic()
        )

    # ---------------------------------------------------------------- reports

    def _on_state(self, message: SupervisorState) -> None:
        self.now.state, self.state_s = _state(message), time.monotonic()
        self.now.leader = message.leader
        for controller in message.controllers:
            name = controller.name
            fits = len(self._controllers) < _MOST_CONTROLLERS and _NAME.fullmatch(name)
            if fits and name not in self._controllers:
                self._follow(name)
        self._show("state", self.state_frame())

    def _follow(self, controller: str) -> None:
        """Listen to a controller that the supervisor knows."""
        self._controllers[controller] = float("-inf")
        node, topic = self._node, f"fsw/{controller}"
        node.create_subscription(ControllerStatus, f"{topic}/status", self._on_status, STREAM)
        node.create_subscription(
            Prediction, f"{topic}/prediction", partial(self._on_plan, controller), STREAM
        )

    def _on_status(self, message: ControllerStatus) -> None:
        if message.selected:
            self.view.solve_ms = (
                1e3 * message.solve_time if message.solver_status else float("nan")
            )
            self.now.attainable, self._goes_for = convert.attainable(message), message.controller
            disturbances = dict(zip(message.disturbance_names, message.disturbances, strict=False))
            self._known_heat_share = disturbances.get(SHARE_NAME, nan)
        elif message.controller == self._goes_for:  # it no longer commands
            self.now.attainable = None

    def _on_plan(self, controller: str, message: Prediction) -> None:
        now_s = time.monotonic()
        if now_s - self._controllers[controller] >= _PREDICTION_PERIOD_S:
            self._controllers[controller] = now_s
            self._show("prediction", _prediction(controller, message), controller)

    def _on_heat_plan(self, message: HeatPlan) -> None:
        self._show("heat", heat_band(convert.heat_plan(message)))

    def _on_progress(self, message: WeldProgress) -> None:
        self.progress, self.progress_s = _progress(message), time.monotonic()
        self.view.angle_deg = degrees(message.angle)
        self._on_rows([], False)  # another weld may have begun
        self.show_progress()

    def show_progress(self) -> None:
        """Send what a programme has reported last; one that no longer reports is silent."""
        if self.progress is not None:
            old = self.awake.age_s(self.progress_s, time.monotonic()) > NO_PROGRAMME_S
            silent = {"state": "silent"} if old and self.programme() else {}
            self._show("progress", self.progress | silent)

    def programme(self) -> dict[str, Any] | None:
        """What a programme that is under way has reported last."""
        return self.progress if self.progress and self.progress["state"] in UNDER_WAY else None

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        now_s = time.monotonic()
        for status in message.status:
            name = local_name(status.name, status.hardware_id, self._node.get_namespace())
            if name is None:
                continue
            node, _, what = (readable(word, 100) for word in name.partition(": "))
            if (node, what) not in self._parts and self._is_full(node):
                continue
            level = _LEVELS[min(int.from_bytes(status.level, "little"), 3)]
            values = {pair.key: pair.value for pair in status.values}
            permissive = None if "permissive" not in values else values["permissive"] == "True"
            action = readable(values.get("action", ""), 100)
            text, code = readable(status.message), readable(values.get(CODE, ""), 100)
            names = readable(values.get(f"{CODE}: names", ""))
            part = Part(level, text, permissive, action, code, names)
            self._parts[node, what] = part, now_s
            if what == RECORDING:
                self.recording = values
            if name == "fsw_supervisor: process":
                self.now.sensor_states = {
                    name: readable(values.get(f"{name} state", "good")) for name in SENSORS
                }

    def recorder(self) -> Part:
        """The recorder's last report, of level ``stale`` if it is old; empty before the first."""
        reports = (parts[RECORDING] for parts in self.parts().values() if RECORDING in parts)
        return min(reports, key=lambda part: part.level == "stale", default=Part("", ""))

    def _is_full(self, node: str) -> bool:
        """Whether the table of parts is full.

        A flood of others leaves the own nodes their room.
        """
        own = node.startswith("fsw_")
        return sum(name.startswith("fsw_") == own for name, _ in self._parts) >= _MOST_PARTS

    def state_frame(self) -> dict[str, Any]:
        """Content of the frame ``state``; ``known`` is false if the supervisor is silent."""
        return {
            "known": self.awake.age_s(self.state_s, time.monotonic()) <= NO_REPORT_S,
            "known_heat_share": short(self._known_heat_share),
            "standby": standby_ready(self.parts()),
            **(self.now.state or _state(SupervisorState())),
        }

    def parts(self) -> dict[str, dict[str, Part]]:
        """Diagnostics by node and part."""
        now_s = time.monotonic()
        self._parts = {
            name: entry for name, entry in self._parts.items() if now_s - entry[1] <= _FORGET_S
        }
        by_node: dict[str, dict[str, Part]] = {}
        for (node, what), (part, heard_s) in sorted(self._parts.items()):
            old = self.awake.age_s(heard_s, now_s) > NO_REPORT_S
            by_node.setdefault(node, {})[what] = replace(part, level="stale") if old else part
        return by_node


def _state(message: SupervisorState) -> dict[str, Any]:
    """The supervisor's state; of more controllers or interlocks than can be, the first."""
    cause, reason = Cause(message.cause), Reason.of_messages(message.why)
    return {
        **{name: readable(getattr(message, name)) for name in _WORDS},
        "reason": readable(reason.words),
        "tripped": [readable(name) for name in reason.interlocks],
        "acknowledgement_blocked_by": [
            readable(name) for name in message.acknowledgement_blocked_by[:_MOST_CONTROLLERS]
        ],
        "controllers": [_controller(health) for health in message.controllers[:_MOST_CONTROLLERS]],
        "interlocks": [
            {"name": readable(interlock.name), "level": Severity(interlock.level).word}
            for interlock in message.interlocks[:_MOST_CONTROLLERS]
        ],
        "cause": cause,
        "by": readable(message.who) or cause.words,
        "stop_cause": int(message.stop.cause),
        "acknowledged": not message.stop.stopped,
    }


def _controller(controller: ControllerHealth) -> dict[str, Any]:
    lacks = convert.readiness(controller)
    return {
        "name": readable(controller.name, 100),
        "ready": bool(controller.warm) and not lacks.lack,
        "healthy": bool(controller.healthy),
        "inhibited": bool(controller.latched_out),
        "reason": readable(lacks.words(controller.name)),
        "lack": int(lacks.lack),
        "why": readable(lacks.why),
        "missing_sensors": list(lacks.sensors),
        "latency_ms": short(1e3 * controller.latency_mean),
        "latency_max_ms": short(1e3 * controller.latency_max),
        "missed": controller.missed,
        "late": controller.late,
        "rejected": controller.rejected,
    }


def _progress(message: WeldProgress) -> dict[str, Any]:
    """How far the programme has come."""
    return {
        "state": readable(message.state),
        "phase": readable(message.phase),
        "angle_deg": short(degrees(message.angle)),
        "length_mm": short(units.mm_from_m(message.length)),
        "time_left_s": short(message.time_left),
        "depth_mm": short(units.mm_from_m(message.depth)),
        "temperature_c": short(message.temperature),
        "left": bool(message.left),
        "way_back_s": short(message.way_back),
    }


def _prediction(controller: str, message: Prediction) -> dict[str, Any]:
    """A controller's plan, at times of the weld."""
    begin_s = convert.stamp_ns(message.header.stamp) / units.NANOSECONDS
    return {
        "controller": controller,
        "time_s": [round(begin_s + value, 3) for value in message.time],
        "depth_mm": [short(units.mm_from_m(value)) for value in message.depth],
        "temperature_c": [short(value) for value in message.temperature],
        "force_kn": [short(units.kn_from_n(value)) for value in message.axial_force],
        "speed_rpm": [short(units.rpm_from_rad_s(value)) for value in message.spindle_speed],
        "depth_mm:deviation": [short(units.mm_from_m(value)) for value in message.depth_deviation],
        "temperature_c:deviation": [short(value) for value in message.temperature_deviation],
    }


def channels_of(message: ShoulderDepth) -> dict[str, ChannelHealth]:
    """Health of each channel that the machine has, by sensor; empty for a depth of one sensor."""
    codes = message.channel_health
    names = DEPTH_CHANNELS if len(codes) == len(DEPTH_CHANNELS) else ()
    given = zip(names, codes, strict=False)
    return {name: ChannelHealth(code) for name, code in given if code != ChannelHealth.UNKNOWN}
