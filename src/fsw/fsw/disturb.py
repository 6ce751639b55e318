"""``fsw.py disturb``: a disturbance of the emulated plant."""

from __future__ import annotations

import argparse
from typing import Any

from fsw.errors import CommandError
from fsw.operate import CLEAR, add_graph_command
from fsw.options import add_number
from fsw_control import units
from fsw_plant.event_schema import DISTURBANCE_AMPLITUDE, DISTURBANCE_SHAPES, DURATION_S, DisturbanceEntry
from fsw_schema.models import validate


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    amplitudes = ", ".join(f"{name} {allowed}" for name, (_, allowed) in DISTURBANCE_AMPLITUDE.items())
    disturb = add_graph_command(commands, "disturb", f"disturb the emulated plant; amplitudes: {amplitudes}", _run)
    disturb.add_argument("channel", choices=tuple(DISTURBANCE_AMPLITUDE))
    shapes = (*DISTURBANCE_SHAPES, CLEAR)
    disturb.add_argument("shape", choices=shapes, help="clear (or none) ends the channel's disturbance")
    disturb.add_argument("amplitude", type=float, nargs="?", help="in mm, degC, kN, rpm or N m; not for clear")
    add_number(disturb, "--duration", "S", DURATION_S, "rise time of a ramp, length of a pulse or a sine [s]")
    add_number(disturb, "--period", "S", DURATION_S, "of a sine [s]")


def _run(arguments: argparse.Namespace) -> int:
    from fsw.operator_node import ask  # the other commands do without rclpy
    from fsw_msgs.srv import SetDisturbance

    shape = "none" if arguments.shape == CLEAR else arguments.shape
    key, allowed = DISTURBANCE_AMPLITUDE[arguments.channel]
    if shape == "none" and arguments.amplitude is not None:
        raise CommandError(f"disturb: {arguments.shape} takes no amplitude")
    if shape != "none" and arguments.amplitude is None:
        raise CommandError(f"disturb: {shape} needs an amplitude, {allowed}; clear ends a disturbance")
    entry = {"channel": arguments.channel, "shape": shape, key: arguments.amplitude}
    entry |= {"duration_s": arguments.duration, "period_s": arguments.period}
    wanted = validate(DisturbanceEntry, entry, "disturb").event(0.0)
    request = SetDisturbance.Request(
        channel=arguments.channel,
        shape=shape,
        amplitude=units.to_si(wanted.amount, allowed.unit),
        duration=wanted.duration_s,
        period=wanted.period_s,
    )
    return ask(arguments, SetDisturbance, "fsw/plant/set_disturbance", request)
