"""``fsw.py fault``: a fault of a sensor of the emulated plant."""

from __future__ import annotations

import argparse
from typing import Any

from fsw.errors import CommandError
from fsw.operate import CLEAR, add_graph_command, add_number
from fsw_control import units
from fsw_scenario import ranges


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    magnitudes = ", ".join(f"{name} {allowed}" for name, (_, allowed) in ranges.FAULT_MAGNITUDE.items())
    magnitudes += f" (drift: per s), delay {ranges.FAULT_DELAY_S}"
    fault = add_graph_command(
        commands, "fault", f"make a sensor of the emulated plant fail; magnitudes: {magnitudes}", _run
    )
    fault.add_argument("sensor", choices=tuple(ranges.FAULT_MAGNITUDE))
    fault.add_argument("kind", choices=(*ranges.FAULT_KINDS, CLEAR), help="clear (or none) ends the sensor's fault")
    fault.add_argument("magnitude", type=float, nargs="?", help="of spike, bias, drift, delay")
    add_number(fault, "--duration", "S", ranges.DURATION_S, "[s]; without: until cleared", 0.0)


def _run(arguments: argparse.Namespace) -> int:
    from fsw.operator_node import ask  # the other commands do without rclpy
    from fsw_msgs.srv import SetFault

    magnitude = 0.0 if arguments.magnitude is None else arguments.magnitude
    if arguments.kind not in ranges.WITH_MAGNITUDE and arguments.magnitude is not None:
        raise CommandError(f"fault: {arguments.kind} takes no magnitude")
    if arguments.kind in ranges.WITH_MAGNITUDE:
        allowed = ranges.FAULT_DELAY_S if arguments.kind == "delay" else ranges.FAULT_MAGNITUDE[arguments.sensor][1]
        if arguments.magnitude is None:
            raise CommandError(f"fault: {arguments.kind} needs a magnitude, {allowed}")
        complaint = allowed.complaint(magnitude)
        if complaint:
            raise CommandError(f"fault: magnitude {complaint}")
        if arguments.sensor == "depth" and arguments.kind != "delay":
            magnitude = units.m_from_mm(magnitude)
    request = SetFault.Request(
        sensor=arguments.sensor,
        kind="none" if arguments.kind == CLEAR else arguments.kind,
        magnitude=magnitude,
        duration=arguments.duration,
    )
    return ask(arguments, SetFault, "/fsw/plant/set_fault", request)
