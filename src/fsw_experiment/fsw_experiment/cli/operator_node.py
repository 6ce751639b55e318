"""The operator's short visit to the graph."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile

from fsw_control.contract import Reference
from fsw_control.references import ReferenceQueue
from fsw_control.references_ros import subscribe_references
from fsw_control.topics_ros import STREAM
from fsw_experiment.cli.errors import CommandError


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
            When no node offers it or none answers in time.
        """
        client = self.node.create_client(service, name)
        if not self.wait_until(client.service_is_ready):
            raise CommandError(f"no node offers {name} on {_domain()}: is the {who} running there?")
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


class SetPoints:
    """What is known of the set-points that hold, of those that were sent and those that the supervisor keeps.

    Parameters
    ----------
    visit : Operator
    """

    def __init__(self, visit: Operator) -> None:
        self._queue = ReferenceQueue()
        self._clock = visit.node.get_clock()
        subscribe_references(visit.node, self._queue, lambda _: None)

    def __bool__(self) -> bool:
        return bool(self._queue)

    def in_force(self, now_ns: int | None) -> Reference | None:
        """Those that hold at a time of the weld, by default now; None if there are none."""
        return self._queue.at(self._clock.now().nanoseconds if now_ns is None else now_ns)


def nothing_there() -> CommandError:
    """The error of an empty graph."""
    return CommandError(f"no weld graph on {_domain()}: start it, or set ROS_DOMAIN_ID")
