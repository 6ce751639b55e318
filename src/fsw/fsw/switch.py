"""``fsw.py switch``: another controller."""

from __future__ import annotations

import argparse
from typing import Any

from fsw.operate import add_graph_command
from fsw.options import add_number
from fsw_schema.ranges import Range


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    switch = add_graph_command(commands, "switch", "apply another controller", _run)
    switch.add_argument("controller", help="its name, e.g. decentral; see 'controllers'")
    switch.add_argument("--strict", action="store_true", help="refuse unless it is ready")
    add_number(switch, "--wait", "S", Range(0.0, 600.0, "s"), "maximum time to wait until it is ready, 0 to 600 s", 5.0)


def _run(arguments: argparse.Namespace) -> int:
    from builtin_interfaces.msg import Duration

    from fsw.operator_node import ask  # the other commands do without rclpy
    from fsw_msgs.srv import SwitchController

    seconds = int(arguments.wait)
    request = SwitchController.Request(
        name=arguments.controller,
        strictness=SwitchController.Request.STRICT if arguments.strict else SwitchController.Request.BEST_EFFORT,
        timeout=Duration(sec=seconds, nanosec=round((arguments.wait - seconds) * 1e9)),
    )
    return ask(arguments, SwitchController, "fsw/switch_controller", request, extra_s=arguments.wait)
