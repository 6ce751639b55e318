"""Observes a weld that is disturbed, keeps the score, and acts as its operator."""

from __future__ import annotations

import time
from collections import deque
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile

from fsw_control import messages_ros as convert
from fsw_control import weld
from fsw_control.contract import Command
from fsw_control.topics_ros import LATEST
from fsw_control.units import NANOSECONDS
from fsw_msgs.msg import DriveFeedback, ShoulderDepth, SupervisorState, WeldCommand
from fsw_msgs.srv import OperatorRequest, SetMode
from fsw_test_support.machine_server import moves_between

#: ticks in a row with a controller's command, after which the graph counts as healthy
HEALTHY_TICKS = 20
#: marks a flood's messages, which must not be taken for the weld's
SOURCE = "flood"
_DEEP = QoSProfile(depth=2000)
_TICK_NS = round(weld.TICK_S * NANOSECONDS)


class Observer:
    """What a node sees of a weld, its score in the present trial, and its operator.

    Attributes
    ----------
    ticks : deque of (int, float)
        Stamp and time of receipt of each tick; the stamps may step with the machine's clock.
    answered : dict of int to str
        By stamp, the source of the command.
    state : SupervisorState or None
    seen : int
        Commands received since the start.
    """

    def __init__(self, node: Node) -> None:
        self.ticks: deque[tuple[int, float]] = deque(maxlen=100_000)
        self.answered: dict[int, str] = {}
        self.state: SupervisorState | None = None
        self.seen = 0
        self._drives: dict[int, Command] = {}
        self._operator_s = 0.0
        self._pending: list[Any] = []
        node.create_subscription(ShoulderDepth, "fsw/depth", self._on_depth, _DEEP)
        node.create_subscription(DriveFeedback, "fsw/drives", self._on_drives, _DEEP)
        node.create_subscription(WeldCommand, "fsw/command", self._on_command, _DEEP)
        node.create_subscription(SupervisorState, "fsw/supervisor/state", self._on_state, LATEST)
        self._acknowledge = node.create_client(OperatorRequest, "fsw/acknowledge")
        self._set_mode = node.create_client(SetMode, "fsw/set_mode")
        self.begin_trial()

    def begin_trial(self) -> None:
        """Set the score to nothing."""
        self._begun_s = time.monotonic()
        names = (
            "ticks",
            "safe_stops",
            "operator_requests",
            "command_moves",
            "acting_moves",
            "longest_gap_s",
        )
        self._score: dict[str, Any] = dict.fromkeys(names, 0)

    def end_trial(self) -> dict[str, Any]:
        """The score since :meth:`begin_trial`."""
        some = [
            stamp_ns for stamp_ns, heard_s in list(self.ticks)[:-2] if heard_s >= self._begun_s
        ]
        return {
            **self._score,
            "ticks_without_command": sum(stamp_ns not in self.answered for stamp_ns in some),
        }

    def commanded(self, now_s: float) -> bool:
        """Whether a controller's command answered each of the last ticks, all of this trial."""
        last = list(self.ticks)[-HEALTHY_TICKS - 2 : -2]  # the newest may still be under way
        return (
            len(last) == HEALTHY_TICKS
            and now_s - last[0][1] < 2 * HEALTHY_TICKS * weld.TICK_S
            and last[0][1] >= self._begun_s
            and all(self.answered.get(stamp_ns) in ("nmpc", "decentral") for stamp_ns, _ in last)
            and now_s - self.ticks[-1][1] < 0.5
        )

    def operate(self, now_s: float) -> None:
        """Once a second: what an operator does who wants to go on welding."""
        if self.state is None or now_s < self._operator_s + 1.0:
            return
        self._operator_s = now_s
        if self.state.actual_mode == "safe_stop" and self._acknowledge.service_is_ready():
            self._pending.append(self._acknowledge.call_async(OperatorRequest.Request()))
            self._score["operator_requests"] += 1
        if (
            self.state.actual_mode in ("safe_stop", "hold", "manual")
            and self._set_mode.service_is_ready()
        ):
            self._pending.append(self._set_mode.call_async(SetMode.Request(mode="auto")))
        self._pending = [future for future in self._pending if not future.done()][-20:]

    def _on_depth(self, message: ShoulderDepth) -> None:
        if message.header.frame_id == SOURCE:
            return
        stamp_ns, now_s = convert.stamp_ns(message.header.stamp), time.monotonic()
        before_ns, before_s = self.ticks[-1] if self.ticks else (0, now_s)
        if stamp_ns == before_ns:
            return
        # by the receipt and by the stamps: a flood holds up the receipt here, a step of the clock
        # moves the stamps
        gap_s = min(now_s - before_s, abs(stamp_ns - before_ns) / NANOSECONDS)
        self._score["longest_gap_s"] = max(self._score["longest_gap_s"], round(gap_s, 2))
        self.ticks.append((stamp_ns, now_s))
        self._score["ticks"] += 1

    def _on_drives(self, message: DriveFeedback) -> None:
        stamp_ns = convert.stamp_ns(message.header.stamp)
        acting = convert.command(message)
        before_ns, before = self._drives.popitem() if self._drives else (0, acting)
        if abs(stamp_ns - before_ns - _TICK_NS) < _TICK_NS // 2:
            self._score["acting_moves"] = max(
                self._score["acting_moves"], moves_between(acting, before)
            )
        self._drives = {stamp_ns: acting}

    def _on_command(self, message: WeldCommand) -> None:
        if message.source == SOURCE:
            return
        self.seen += 1
        stamp_ns = convert.stamp_ns(message.header.stamp)
        self.answered[stamp_ns] = message.source
        acting = self._drives.get(stamp_ns)
        if acting is not None:
            self._score["command_moves"] = max(
                self._score["command_moves"], moves_between(convert.command(message), acting)
            )

    def _on_state(self, message: SupervisorState) -> None:
        if message.actual_mode == "safe_stop" and (
            self.state is None or self.state.actual_mode != "safe_stop"
        ):
            self._score["safe_stops"] += 1
        self.state = message
