"""A ROS domain of a test's own, and nodes that are spun until something holds."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import wraps
from typing import Any

import pytest
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from fsw_control.free_domain import free_domain
from fsw_control.light_node_ros import ends_in_time
from fsw_test_support.waiting import PATIENCE_S


@pytest.fixture
def domain_id(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A ROS domain that no other test on this machine uses now.

    Set for this process and those that it starts.

    Nodes of this process leave it in time, or the process ends: the middleware may spin for ever.
    """
    destroy_node = Node.destroy_node

    @wraps(destroy_node)
    def destroy_in_time(node: Node) -> None:
        with ends_in_time():
            destroy_node(node)

    with free_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        monkeypatch.setattr(Node, "destroy_node", destroy_in_time)
        yield domain


class Spinner:
    """Spins the nodes of one executor until something holds.

    Parameters
    ----------
    context : Context, optional
        Default: the global one.
    """

    def __init__(self, context: Context | None = None) -> None:
        self.executor = SingleThreadedExecutor(context=context)

    def spin(self) -> None:
        """Run what is ready."""
        self.executor.spin_once(timeout_sec=0.02)

    def seen(self) -> str:
        """What a test that has waited in vain should show."""
        return ""

    def until(
        self,
        condition: Callable[[], Any],
        what: str = "the condition",
        timeout_s: float = PATIENCE_S,
    ) -> None:
        """Spin until a condition holds; AssertionError when it takes too long."""
        end_s = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < end_s, (
                f"waited {timeout_s:g} s in vain for {what}; {self.seen()}"
            )
            self.spin()

    def call(self, client: Any, request: Any) -> Any:
        """The answer of a service."""
        self.until(client.service_is_ready, f"the service {client.srv_name}")
        future = client.call_async(request)
        self.until(future.done, f"an answer of {client.srv_name}")
        return future.result()
