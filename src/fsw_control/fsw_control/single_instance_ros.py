"""Ensures that the plant is alone on its domain before it starts."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from fsw_control.reports_ros import INSTANCE
from fsw_msgs.msg import ShoulderDepth

#: summary and values of a plant's diagnostics during the search
SEARCHING = "looking for another plant"
STARTING = {"starting": "yes"}
#: A running plant reports once a second; a publisher silent for longer is a remnant of a killed
#: process.
LIVENESS_S = 2.5
PREFIX = "fsw_plant/"
_ANNOUNCE_S = 0.05


class AnotherPlantError(RuntimeError):
    """Another plant publishes the same topics."""


class SingleInstanceGuard:
    """Detects another plant, or a replayed bag, that publishes the same topics.

    Plants identify each other by a value of their diagnostics, which holds the topic and a number
    of their own. Create the node's publisher of fsw/depth first, so that plants that start
    together see each other.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._topic = node.resolve_topic_name("fsw/depth")
        self.instance = f"{PREFIX}{uuid.uuid4().hex}@{self._topic}"
        self._heard = ""

    def check(self, discovery_s: float, announce: Callable[[], None]) -> None:
        """Search for ``discovery_s`` and listen to any publishers; return if there is no plant.

        ``announce`` publishes this plant's diagnostics, so that another one that starts at the
        same time detects it.

        Raises
        ------
        AnotherPlantError
            If another plant was detected.
        """
        node = self._node
        # A callback cannot spin the node that it belongs to: then another node listens.
        own = node.executor is not None
        listener = _listener(node) if own else node
        executor = SingleThreadedExecutor(context=node.context) if own else None
        create, topic = listener.create_subscription, node.resolve_topic_name("/diagnostics")
        subscriptions = [
            create(DiagnosticArray, topic, self._on_diagnostics, 10),
            create(ShoulderDepth, self._topic, self._on_depth, 10),
        ]
        try:
            begin = announce_s = time.monotonic()
            wait_s = discovery_s
            while not self._heard and time.monotonic() < begin + wait_s:
                rclpy.spin_once(listener, executor=executor, timeout_sec=0.05)
                # its own message ends the spin, so not at every turn
                if time.monotonic() >= announce_s:
                    announce_s += _ANNOUNCE_S
                    announce()
                wait_s = max(discovery_s, LIVENESS_S) if self._others() else discovery_s
        finally:
            for subscription in subscriptions:
                listener.destroy_subscription(subscription)
            if own:
                listener.destroy_node()
        if self._heard:
            where = f"{self._topic} of domain {node.context.get_domain_id()}"
            remedy = "end it first, or set another ROS_DOMAIN_ID or namespace"
            raise AnotherPlantError(f"{self._heard} on {where}: {remedy}")
        if self._others():
            text = "a publisher that sends nothing, probably of a killed process; ignored"
            node.get_logger().warning(f"{self._topic} has {text}")

    def _others(self) -> bool:
        return self._node.count_publishers(self._topic) > 1

    def _on_depth(self, message: ShoulderDepth) -> None:
        self._heard = self._heard or "depth is measured already"

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            other = values.get(INSTANCE, "")
            is_here = other.startswith(PREFIX) and other.endswith(f"@{self._topic}")
            if other == self.instance or not is_here:
                continue
            # Of two that start together, the one with the lower number stays.
            if not values.items() >= STARTING.items() or other < self.instance:
                self._heard = "a plant runs already"


def _listener(node: Node) -> Node:
    """A hidden node beside another one, without name remapping."""
    return rclpy.create_node(
        f"_{node.get_name()}_guard",
        context=node.context,
        namespace=node.get_namespace(),
        use_global_arguments=False,
        start_parameter_services=False,
        enable_rosout=False,
    )
