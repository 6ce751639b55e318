"""``fsw.py controllers``: the controllers in the graph."""

from __future__ import annotations

import argparse
from typing import Any

from fsw.console import print_table
from fsw.operate import add_graph_command, health


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    add_graph_command(commands, "controllers", "the controllers in the graph and their health", _run)


def _run(arguments: argparse.Namespace) -> int:
    from fsw.operator_node import operator  # the other commands do without rclpy
    from fsw_msgs.srv import ListControllers

    with operator(arguments.timeout, arguments.namespace) as node:
        response = node.call(ListControllers, "fsw/list_controllers", ListControllers.Request())
    print(f"mode {response.mode}, active {response.active or 'none'}")
    header = ("controller", "state", "latency, mean [ms]", "largest [ms]", "missed", "late", "rejected")
    rows = [
        (
            *(one.name, health(one), f"{one.latency_mean * 1e3:.2f}", f"{one.latency_max * 1e3:.2f}"),
            *(str(one.missed), str(one.late), str(one.rejected)),
        )
        for one in response.controllers
    ]
    print_table(rows, header, words=2)
    return 0
