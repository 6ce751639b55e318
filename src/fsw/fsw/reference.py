"""``fsw.py reference``: new set-points."""

from __future__ import annotations

import argparse
from math import nan
from typing import Any

from fsw.errors import CommandError
from fsw.operate import add_graph_command
from fsw.options import add_number
from fsw_control import ranges, units


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    reference = add_graph_command(commands, "reference", "new set-points; an omitted one keeps its value", _run)
    add_number(reference, "--depth", "MM", ranges.REFERENCE_DEPTH_MM, str(ranges.REFERENCE_DEPTH_MM))
    reference.add_argument(
        "--ramp", action="store_true", help="ramp from the set-points in force at the permitted rates; default: a step"
    )
    add_number(reference, "--temperature", "C", ranges.REFERENCE_TEMPERATURE_C, str(ranges.REFERENCE_TEMPERATURE_C))


def _run(arguments: argparse.Namespace) -> int:
    from fsw.operator_node import ask  # the other commands do without rclpy
    from fsw_msgs.srv import SetReference

    depth, temperature = arguments.depth, arguments.temperature
    if depth is None and temperature is None:
        raise CommandError("reference: give --depth, --temperature or both")
    request = SetReference.Request(
        depth=nan if depth is None else units.m_from_mm(depth),
        temperature=nan if temperature is None else temperature,
        ramp=arguments.ramp,
    )
    return ask(arguments, SetReference, "fsw/set_reference", request)
