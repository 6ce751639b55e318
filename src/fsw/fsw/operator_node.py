"""A short-lived node that watches topics and calls services."""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import rclpy
from rcl_interfaces.msg import Log
from rclpy.exceptions import InvalidNamespaceException
from rclpy.executors import ExternalShutdownException
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from rclpy.qos import QoSProfile

from fsw.errors import CommandError
from fsw_control import messages_ros as convert
from fsw_control.contract import Reference
from fsw_control.light_node_ros import ends_in_time, join
from fsw_control.references import ReferenceQueue
from fsw_control.references_ros import reference_queue, subscribe_references
from fsw_control.sensors import REQUIRED, SENSORS
from fsw_control.topics_ros import LATCHED, STREAM
from fsw_msgs.msg import ShoulderDepth

#: requirement of the services, by the second part of their names
_SERVERS = {
    "plant": "the plant running",
    "weld": "a weld under way",
    "run_weld": "the scenario player running",
}
#: largest difference between the clocks of two computers (chosen)
_CLOCKS_S = 0.5


@contextlib.contextmanager
def _interrupts_after() -> Iterator[None]:
    """Raise KeyboardInterrupt for a Ctrl-C only when the middleware is left.

    Raised within, its C++ code takes it for a message that cannot be converted.
    """
    own = signal.default_int_handler
    in_main_thread = threading.current_thread() is threading.main_thread()
    if not in_main_thread or signal.getsignal(signal.SIGINT) is not own:
        yield
        return
    came: list[int] = []
    signal.signal(signal.SIGINT, lambda number, frame: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, own)
    if came:
        raise KeyboardInterrupt


class Operator:
    """Calls services and watches topics, each with a time limit."""

    def __init__(self, node: Node, timeout_s: float) -> None:
        self.node = node
        self.timeout_s = timeout_s

    def wait_until(self, condition: Callable[[], object], timeout_s: float | None = None) -> bool:
        """Spin until a condition holds; False on time-out."""
        end = time.monotonic() + (self.timeout_s if timeout_s is None else timeout_s)
        while True:
            try:
                if condition():
                    return True
                if time.monotonic() > end:
                    return False
                with _interrupts_after():
                    rclpy.spin_once(self.node, timeout_sec=0.05)
            except Exception as error:
                if rclpy.ok() and not isinstance(error, ExternalShutdownException):
                    raise
                # SIGTERM has shut ROS down, which raises various exceptions
                raise KeyboardInterrupt from None

    def answer(self, future: Any, name: str, extra_s: float = 0.0) -> Any:
        """Result of a future; CommandError if ``name`` does not answer in time."""
        timeout_s = self.timeout_s + extra_s
        if not self.wait_until(future.done, timeout_s):
            raise CommandError(
                f"{name} did not answer within {timeout_s:g} s; "
                "if it is running, give a longer --timeout"
            )
        return future.result()

    def call(self, service: Any, name: str, request: Any, extra_s: float = 0.0) -> Any:
        """Call a service; CommandError if no node offers it or answers in time."""
        client = self.node.create_client(service, name)
        if not self.wait_until(client.service_is_ready):
            server = _SERVERS.get(name.split("/")[1], "the supervisor running")
            full = self.node.resolve_service_name(name)
            raise CommandError(f"no node offers {full} on {domain_text()}: is {server} there?")
        return self.answer(client.call_async(request), name, extra_s)

    def node_names(self) -> set[str]:
        """Names of the nodes in the namespace."""
        own = self.node.get_namespace()
        return {
            name
            for name, namespace in self.node.get_node_names_and_namespaces()
            if namespace == own
        }

    def watch(self, kind: Any, topic: str, profile: QoSProfile = STREAM) -> list[Any]:
        """A list that collects the messages of a topic while this object spins."""
        received: list[Any] = []
        self.node.create_subscription(kind, topic, received.append, profile)
        return received

    def watch_sensors(self, names: Iterable[str] = REQUIRED) -> dict[str, list[Any]]:
        """Lists of sensor messages by name, like :meth:`watch`."""
        return {
            name: self.watch(convert.message_type(name), SENSORS[name].topic) for name in names
        }

    def watch_set_points(self) -> ReferenceQueue:
        """Collect set-points, as sent and as stated by the supervisor, while this object spins."""
        queue = reference_queue(self.node)
        subscribe_references(self.node, queue)
        return queue

    def set_points_in_force(
        self, set_points: ReferenceQueue, depths: list[ShoulderDepth]
    ) -> Reference | None:
        """The set-points in force at the last measurement, or else now; None if there are none."""
        if depths:
            return set_points.at(convert.stamp_ns(depths[-1].header.stamp))
        return set_points.at(self.node.get_clock().now().nanoseconds)


class ErrorLines:
    """Errors logged by a node of the namespace from now on.

    For a node on another computer, by both computers' clocks. Lines logged before the subscription
    was matched are sent again, so none is missed.
    """

    def __init__(self, node: Operator, name: str) -> None:
        self._node = node
        self._logger = f"{node.node.get_namespace()}/{name}".replace("/", ".").strip(".")
        self._logs = node.watch(Log, "/rosout", LATCHED)
        self._since_s = time.time() - _CLOCKS_S

    def _lines(self) -> list[str]:
        new = (
            log for log in self._logs if log.stamp.sec + 1e-9 * log.stamp.nanosec >= self._since_s
        )
        return [
            log.msg
            for log in new
            if log.name == self._logger and log.level >= LoggingSeverity.ERROR
        ]

    def last(self) -> str:
        """The newest line, which may follow an answer; empty if none arrives in time."""
        self._node.wait_until(self._lines)
        return next(reversed(self._lines()), "")


def domain_text() -> str:
    """The ROS domain as a text."""
    return f"ROS domain {os.environ.get('ROS_DOMAIN_ID') or '0'}"


def graph_text(node: Operator) -> str:
    """ROS domain and namespace as a text."""
    return f"{domain_text()}, namespace {node.node.get_namespace()}"


@contextlib.contextmanager
def operator(arguments: argparse.Namespace) -> Iterator[Operator]:
    """Join the graph of ``--namespace`` as ``fsw_operator`` while the context lasts."""
    try:
        # Ctrl-C must leave the graph reachable: an interrupted command aborts what it has begun
        join([])
    except RuntimeError as error:  # the environment is wrong, e.g. ROS_DOMAIN_ID
        raise CommandError(str(error)) from None
    try:
        node = rclpy.create_node("fsw_operator", namespace=arguments.namespace)
    except InvalidNamespaceException as error:
        rclpy.try_shutdown()
        raise CommandError(f"--namespace: {' '.join(str(error).split())}") from None
    try:
        yield Operator(node, arguments.timeout)
    finally:
        with ends_in_time():
            node.destroy_node()
            rclpy.try_shutdown()


def ask(
    arguments: argparse.Namespace,
    service: Any,
    name: str,
    request: Any = None,
    extra_s: float = 0.0,
) -> int:
    """Call a service whose response is success and a message."""
    with operator(arguments) as node:
        response = node.call(service, name, request or service.Request(), extra_s)
    if not response.ok:
        raise CommandError(response.message)
    print(response.message)
    return 0
