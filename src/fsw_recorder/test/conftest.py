"""Fixtures of the recorder's tests."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest
import rclpy

from fsw_test_support.bags import genuine, genuine_bag, weld_bag
from fsw_test_support.ros_graph import Spinner, domain_id
from fsw_test_support.waiting import PATIENCE_S

__all__ = ["domain_id", "genuine", "genuine_bag", "weld_bag"]


@pytest.fixture
def graph(domain_id: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Graph]:
    """A ROS graph of its own.

    A DDS domain that no other test uses, with one node of the test in it.
    """
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    graph = Graph(domain_id)
    yield graph
    graph.close()


class Graph(Spinner):
    """The test's own node, spun until something holds, and programs in other processes."""

    def __init__(self, domain: int) -> None:
        self.context = rclpy.Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        self.node = rclpy.create_node("test_node", context=self.context)
        super().__init__(self.context)
        self.executor.add_node(self.node)
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

    def ask(self, kind: Any, name: str, **fields: Any) -> Any:
        """Call a service by its name and return its response."""
        client = self.node.create_client(kind, name)
        response = self.call(client, kind.Request(**fields))
        self.node.destroy_client(client)
        return response

    def end(
        self, program: subprocess.Popen[str], signal_number: int | None = None
    ) -> tuple[int, str]:
        """Send a signal and wait; returns exit code and output."""
        if signal_number is not None:
            program.send_signal(signal_number)
        output, _ = program.communicate(timeout=PATIENCE_S)
        return program.returncode, output

    def close(self) -> None:
        """End everything."""
        for program in self._programs:
            if program.poll() is None:
                program.kill()
                program.communicate()
        self.node.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)
