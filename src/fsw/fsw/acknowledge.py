"""``fsw.py acknowledge``: a safe stop whose causes are gone."""

from __future__ import annotations

import argparse
from typing import Any

from fsw.operate import add_graph_command


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    add_graph_command(
        commands, "acknowledge", "acknowledge a safe stop whose causes are gone, to permit another mode", _run
    )


def _run(arguments: argparse.Namespace) -> int:
    from std_srvs.srv import Trigger

    from fsw.operator_node import ask  # the other commands do without rclpy

    return ask(arguments, Trigger, "fsw/acknowledge")
