"""``fsw.py controllers``: the controllers in the graph."""

from __future__ import annotations

import argparse
from typing import Any

from fsw.operate import add_graph_command, health


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    add_graph_command(commands, "controllers", "the controllers in the graph and their health", _run)


def _run(arguments: argparse.Namespace) -> int:
    from fsw.operator_node import operator  # the other commands do without rclpy
    from fsw_msgs.srv import ListControllers

    with operator(arguments.timeout) as visit:
        response = visit.call(ListControllers, "/fsw/list_controllers", ListControllers.Request())
    print(f"mode {response.mode}, active {response.active or 'none'}")
    for one in response.controllers:
        latency = f"latency {one.latency_mean * 1e3:.2f} ms (at most {one.latency_max * 1e3:.2f})"
        counts = f"missed {one.missed}, late {one.late}, rejected {one.rejected}"
        print(f"{one.name:<12} {health(one)}; {latency}; {counts}")
    return 0
