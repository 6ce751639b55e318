"""Fixtures of the recorder's tests."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor

from fsw_control.free_domain import free_domain
from fsw_test_support.bags import genuine, genuine_bag, weld_bag

__all__ = ["genuine", "genuine_bag", "weld_bag"]


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Iterator[Graph]:
    """A ROS graph of its own: a DDS domain that no other test uses, with one node of the test in it."""
    with free_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
        graph = Graph(domain)
        try:
            yield graph
        finally:
            graph.close()


class Graph:
    """The test's own node, spun until something holds, and programs in other processes."""

    def __init__(self, domain: int) -> None:
        self.context = rclpy.Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        self.node = rclpy.create_node("test_node", context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._programs: list[subprocess.Popen[str]] = []

    def start(self, module: str, *arguments: str, **options: Any) -> subprocess.Popen[str]:
        """Start ``python -m module``; its output is one text."""
        program = subprocess.Popen(
            [sys.executable, "-m", module, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            **options,
        )
        self._programs.append(program)
        return program

    def until(self, condition: Callable[[], Any], timeout_s: float = 30.0) -> None:
        """Spin until the condition holds; fail the test when it does not in time."""
        end = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > end:
                pytest.fail(f"did not happen within {timeout_s} s")
            self._executor.spin_once(timeout_sec=0.01)

    def call(self, kind: Any, name: str, **fields: Any) -> Any:
        """Call a service and return its response."""
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready)
        future = client.call_async(kind.Request(**fields))
        self.until(future.done)
        self.node.destroy_client(client)
        return future.result()

    def end(self, program: subprocess.Popen[str], signal_number: int | None = None) -> tuple[int, str]:
        """Send a signal and wait; returns exit code and output."""
        if signal_number is not None:
            program.send_signal(signal_number)
        output, _ = program.communicate(timeout=30.0)
        return program.returncode, output

    def close(self) -> None:
        """End everything."""
        for program in self._programs:
            if program.poll() is None:
                program.kill()
                program.communicate()
        self.node.destroy_node()
        self._executor.shutdown()
        rclpy.shutdown(context=self.context)
