"""``fsw.py weld``: hold, resume or abort a programme."""

from __future__ import annotations

import argparse
from typing import Any

from fsw.operate import add_graph_command


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    weld = add_graph_command(
        commands, "weld", "hold, resume or abort the programme of a whole weld; abort requests a safe stop", _run
    )
    weld.add_argument("action", choices=("hold", "resume", "abort"))


def _run(arguments: argparse.Namespace) -> int:
    from std_srvs.srv import Trigger

    from fsw.operator_node import ask  # the other commands do without rclpy

    return ask(arguments, Trigger, f"fsw/weld/{arguments.action}")
