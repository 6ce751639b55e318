"""``fsw.py fault``: a fault of a sensor of the emulated plant."""

from __future__ import annotations

import argparse
from typing import Any

from fsw.errors import CommandError
from fsw.operate import CLEAR, add_graph_command
from fsw.options import add_number
from fsw_control import units
from fsw_plant.event_schema import (
    DURATION_S,
    FAULT_DELAY_S,
    FAULT_KINDS,
    FAULT_MAGNITUDE,
    WITH_MAGNITUDE,
    fault,
    magnitude_unit,
)


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    magnitudes = ", ".join(f"{name} {allowed}" for name, (_, allowed) in FAULT_MAGNITUDE.items())
    magnitudes += f" (drift: per s), delay {FAULT_DELAY_S}"
    parser = add_graph_command(
        commands, "fault", f"make a sensor of the emulated plant fail; magnitudes: {magnitudes}", _run
    )
    parser.add_argument("sensor", choices=tuple(FAULT_MAGNITUDE))
    parser.add_argument("kind", choices=(*FAULT_KINDS, CLEAR), help="clear (or none) ends the sensor's fault")
    parser.add_argument("magnitude", type=float, nargs="?", help="of spike, bias, drift, delay")
    add_number(parser, "--duration", "S", DURATION_S, "[s]; without: until cleared", 0.0)


def _run(arguments: argparse.Namespace) -> int:
    from fsw.operator_node import ask  # the other commands do without rclpy
    from fsw_msgs.srv import SetFault

    kind = "none" if arguments.kind == CLEAR else arguments.kind
    if (kind in WITH_MAGNITUDE) != (arguments.magnitude is not None):
        needs = "needs a" if kind in WITH_MAGNITUDE else "takes no"
        raise CommandError(f"fault: {arguments.kind} {needs} magnitude")
    wanted = fault(arguments.sensor, kind, arguments.magnitude or 0.0, arguments.duration)
    request = SetFault.Request(
        sensor=wanted.target,
        kind=wanted.kind,
        magnitude=units.to_si(wanted.amount, magnitude_unit(arguments.sensor, kind)),
        duration=wanted.duration_s,
    )
    return ask(arguments, SetFault, "fsw/plant/set_fault", request)
