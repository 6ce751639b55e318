"""``fsw.py mode``: the source of commands."""

from __future__ import annotations

import argparse
from math import nan
from typing import Any

from fsw.errors import CommandError
from fsw.operate import add_graph_command
from fsw.options import add_number
from fsw_control import ranges, units
from fsw_control.contract import OPERATOR_MODES


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    mode = add_graph_command(
        commands,
        "mode",
        "source of commands: a controller (auto), your values (manual), the last command (hold), safe stop",
        _run,
    )
    mode.add_argument("mode", choices=OPERATOR_MODES)
    add_number(mode, "--force", "KN", ranges.COMMAND_FORCE_KN, f"manual: {ranges.COMMAND_FORCE_KN}")
    add_number(mode, "--speed", "RPM", ranges.COMMAND_SPEED_RPM, f"manual: {ranges.COMMAND_SPEED_RPM}")


def _run(arguments: argparse.Namespace) -> int:
    from fsw.operator_node import ask  # the other commands do without rclpy
    from fsw_msgs.srv import SetMode

    manual, given = arguments.mode == "manual", (arguments.force, arguments.speed)
    if manual and None in given:
        raise CommandError("mode manual needs --force and --speed")
    if not manual and given != (None, None):
        raise CommandError("--force and --speed are for mode manual only")
    request = SetMode.Request(
        mode=arguments.mode,
        axial_force=units.n_from_kn(arguments.force) if manual else nan,
        spindle_speed=units.rad_s_from_rpm(arguments.speed) if manual else nan,
    )
    return ask(arguments, SetMode, "fsw/set_mode", request)
