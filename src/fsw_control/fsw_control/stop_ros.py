"""A node's copy of the stop register: published for the other nodes, and merged with theirs."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from fsw_control import messages_ros as convert
from fsw_control.stop import Stop, StopRegister
from fsw_control.topics_ros import LATEST, latched
from fsw_msgs.msg import StopReport

STOP_TOPIC = "fsw/stop"
#: each holder latches one report; late joiners get the reports of all
_HOLDERS = 50
_HEARD = latched(_HOLDERS)
_REPEAT_S = 1.0


class StopHolder:
    """Publishes ``register`` at every change and every second; ``on_stop`` gets other copies.

    ``on_stop`` merges the copy and acts on it; call :meth:`look` after any other change.
    """

    def __init__(
        self, node: Node, register: StopRegister, on_stop: Callable[[Stop], object]
    ) -> None:
        self._node, self._register, self._on_stop = node, register, on_stop
        self._published: Stop | None = None
        self._publisher = node.create_publisher(StopReport, STOP_TOPIC, LATEST)
        node.create_subscription(StopReport, STOP_TOPIC, self._on_report, _HEARD)
        node.create_timer(_REPEAT_S, self._publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def look(self) -> None:
        """Publish the copy if it has changed."""
        if self._published != self._register.value:
            self._publish()

    def _publish(self) -> None:
        value = self._published = self._register.value
        if value == Stop():  # there has been no stop yet
            return
        holder = self._node.get_fully_qualified_name()
        message = StopReport(holder=holder, stop=convert.stop_message(value))
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def _on_report(self, message: StopReport) -> None:
        is_own = message.holder == self._node.get_fully_qualified_name()
        if not is_own or message.stop.epoch > self._register.value.epoch:
            self._on_stop(convert.stop(message.stop))
            self.look()
