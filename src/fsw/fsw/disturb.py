"""``fsw.py disturb``: a disturbance of the emulated plant."""

from __future__ import annotations

import argparse
from typing import Any

from fsw.errors import CommandError
from fsw.operate import CLEAR, add_graph_command, add_number
from fsw_control import units
from fsw_plant.event_schema import Place, read_disturbance
from fsw_plant.events import DisturbanceError
from fsw_scenario import ranges


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    amplitudes = ", ".join(f"{name} {allowed}" for name, (_, allowed) in ranges.DISTURBANCE_AMPLITUDE.items())
    disturb = add_graph_command(commands, "disturb", f"disturb the emulated plant; amplitudes: {amplitudes}", _run)
    disturb.add_argument("channel", choices=tuple(ranges.DISTURBANCE_AMPLITUDE))
    shapes = (*ranges.DISTURBANCE_SHAPES, CLEAR)
    disturb.add_argument("shape", choices=shapes, help="clear (or none) ends what disturbs the channel")
    disturb.add_argument("amplitude", type=float, nargs="?", help="in mm, degC, kN, rpm or N m; not of clear")
    add_number(disturb, "--duration", "S", ranges.DURATION_S, "rise time of a ramp, length of a pulse or a sine [s]")
    add_number(disturb, "--period", "S", ranges.DURATION_S, "of a sine [s]")


def _run(arguments: argparse.Namespace) -> int:
    from fsw.operator_node import ask  # the other commands do without rclpy
    from fsw_msgs.srv import SetDisturbance

    shape = "none" if arguments.shape == CLEAR else arguments.shape
    key, allowed = ranges.DISTURBANCE_AMPLITUDE[arguments.channel]
    if shape == "none" and arguments.amplitude is not None:
        raise CommandError(f"disturb: {arguments.shape} takes no amplitude")
    if shape != "none" and arguments.amplitude is None:
        raise CommandError(f"disturb: {shape} needs an amplitude, {allowed}; clear ends a disturbance")
    given = {key: arguments.amplitude, "duration_s": arguments.duration, "period_s": arguments.period}
    entry = {name: value for name, value in given.items() if value is not None}
    try:
        wanted = read_disturbance({"channel": arguments.channel, "shape": shape} | entry, Place("disturb", shape), 0.0)
    except DisturbanceError as error:
        raise CommandError(str(error)) from None
    to_wire = {"depth": units.m_from_mm, "axial_force": units.n_from_kn, "spindle_speed": units.rad_s_from_rpm}
    request = SetDisturbance.Request(
        channel=arguments.channel,
        shape=shape,
        amplitude=to_wire.get(arguments.channel, float)(wanted.amount),
        duration=wanted.duration_s,
        period=wanted.period_s,
    )
    return ask(arguments, SetDisturbance, "/fsw/plant/set_disturbance", request)
