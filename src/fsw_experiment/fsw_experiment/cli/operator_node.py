"""The operator's short visit to the graph."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from fsw_experiment.cli.errors import CommandError

STREAM = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
#: as deep as a scenario's set-points are sent ahead
LATCHED = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Operator:
    """Calls services and watches topics, each with a time limit.

    Parameters
    ----------
    node : Node
    timeout_s : float
        For every wait.
    """

    def __init__(self, node: Node, timeout_s: float) -> None:
        self.node = node
        self.timeout_s = timeout_s

    def wait_until(self, condition: Callable[[], bool], timeout_s: float | None = None) -> bool:
        """Spin until a condition holds; False when it takes too long."""
        end = time.monotonic() + (self.timeout_s if timeout_s is None else timeout_s)
        while not condition():
            if time.monotonic() > end:
                return False
            rclpy.spin_once(self.node, timeout_sec=0.05)
        return True

    def call(self, service: Any, name: str, request: Any, who: str, extra_s: float = 0.0) -> Any:
        """Call a service.

        Raises
        ------
        CommandError
            When nobody offers it or nobody answers in time.
        """
        client = self.node.create_client(service, name)
        if not self.wait_until(client.service_is_ready):
            raise CommandError(f"nobody offers {name} on {_domain()}: is the {who} running there?")
        future = client.call_async(request)
        if not self.wait_until(future.done, self.timeout_s + extra_s):
            raise CommandError(f"{name} did not answer within {self.timeout_s + extra_s:g} s: is the {who} stuck?")
        return future.result()

    def watch(self, kind: Any, topic: str, profile: QoSProfile = STREAM) -> list[Any]:
        """A list that gets every message of a topic while this object spins."""
        received: list[Any] = []
        self.node.create_subscription(kind, topic, received.append, profile)
        return received


def _domain() -> str:
    return f"ROS domain {os.environ.get('ROS_DOMAIN_ID', '0')}"


@contextlib.contextmanager
def operator(timeout_s: float) -> Iterator[Operator]:
    """Join the graph as ``fsw_operator`` for as long as the context lasts."""
    rclpy.init(args=[])
    node = rclpy.create_node("fsw_operator")
    try:
        yield Operator(node, timeout_s)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def in_force(references: Sequence[Any], now_ns: int | None) -> Any | None:
    """The reference message that holds at a time (a scenario sends its set-points ahead); None if there is none."""
    stamps = [message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec for message in references]
    begun = [message for message, stamp in zip(references, stamps, strict=True) if now_ns is None or stamp <= now_ns]
    return begun[-1] if begun else None


def nothing_there() -> CommandError:
    """The error of an empty graph."""
    return CommandError(f"no weld graph on {_domain()}: start it, or set ROS_DOMAIN_ID")
