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

from fsw_control import messages_ros as convert
from fsw_control.topics_ros import LATCHED, LATEST, STREAM
from fsw_experiment.cli.errors import CommandError
from fsw_msgs.msg import WeldReference


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


class SetPoints:
    """What is known of the set-points that hold.

    The supervisor tells them; without one, what is still kept of those that were sent.

    Parameters
    ----------
    visit : Operator
    """

    def __init__(self, visit: Operator) -> None:
        self._kept = visit.watch(WeldReference, "/fsw/supervisor/reference", LATEST)
        self._sent = visit.watch(WeldReference, "/fsw/reference", LATCHED)

    def __bool__(self) -> bool:
        return bool(self._kept or self._sent)

    def in_force(self, now_ns: int | None) -> WeldReference | None:
        """The message that holds at a time (a scenario sends its set-points ahead); None if there is none."""
        begun = [one for one in self._sent if now_ns is None or convert.stamp_ns(one.header.stamp) <= now_ns]
        return next(iter([*reversed(self._kept), *reversed(begun)]), None)


def nothing_there() -> CommandError:
    """The error of an empty graph."""
    return CommandError(f"no weld graph on {_domain()}: start it, or set ROS_DOMAIN_ID")
