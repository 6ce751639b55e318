"""Commands that talk to the running graph: their arguments. `operator_node` carries them out."""

from __future__ import annotations

import argparse
from typing import Any

from fsw_control.contract import BUILT_IN_SOURCES
from fsw_scenario import ranges
from fsw_scenario.ranges import Range

#: what ends a disturbance or a fault; ``none`` in scenarios and services
CLEAR = "clear"
_MODES = ("auto", *BUILT_IN_SOURCES)


def add_commands(commands: Any) -> None:
    """Add the commands to the parser's subcommands."""
    _add(commands, "status", "what runs, which controller is applied, what is measured and commanded")

    reference = _add(commands, "reference", "new set-points; one left out stays")
    _number(reference, "--depth", "MM", ranges.REFERENCE_DEPTH_MM, str(ranges.REFERENCE_DEPTH_MM))
    reference.add_argument(
        "--ramp", action="store_true", help="from those in force at the permitted rates; else a step"
    )
    _number(reference, "--temperature", "C", ranges.REFERENCE_TEMPERATURE_C, str(ranges.REFERENCE_TEMPERATURE_C))

    amplitudes = ", ".join(f"{name} {allowed}" for name, (_, allowed) in ranges.DISTURBANCE_AMPLITUDE.items())
    disturb = _add(commands, "disturb", f"disturb the emulated plant; amplitudes: {amplitudes}")
    disturb.add_argument("channel", choices=tuple(ranges.DISTURBANCE_AMPLITUDE))
    shapes = (*ranges.DISTURBANCE_SHAPES, CLEAR)
    disturb.add_argument("shape", choices=shapes, help="clear (or none) ends what disturbs the channel")
    disturb.add_argument("amplitude", type=float, nargs="?", help="in mm, degC, kN, rpm or N m; not of clear")
    _number(disturb, "--duration", "S", ranges.DURATION_S, "rise time of a ramp, length of a pulse or a sine [s]")
    _number(disturb, "--period", "S", ranges.DURATION_S, "of a sine [s]")

    magnitudes = ", ".join(f"{name} {allowed}" for name, (_, allowed) in ranges.FAULT_MAGNITUDE.items())
    magnitudes += f" (drift: per s), delay {ranges.FAULT_DELAY_S}"
    fault = _add(commands, "fault", f"make a sensor of the emulated plant fail; magnitudes: {magnitudes}")
    fault.add_argument("sensor", choices=tuple(ranges.FAULT_MAGNITUDE))
    fault.add_argument("kind", choices=(*ranges.FAULT_KINDS, CLEAR), help="clear (or none) ends the sensor's fault")
    fault.add_argument("magnitude", type=float, nargs="?", help="of spike, bias, drift, delay")
    _number(fault, "--duration", "S", ranges.DURATION_S, "[s]; without: until cleared", 0.0)

    switch = _add(commands, "switch", "apply another controller")
    switch.add_argument("controller", help="its name, e.g. decentral; see 'controllers'")
    switch.add_argument("--strict", action="store_true", help="refuse unless it is ready now")
    _number(switch, "--wait", "S", Range(0.0, 600.0, "s"), "longest wait until it is ready, 0 to 600 s", 5.0)

    _add(commands, "controllers", "the controllers in the graph and their health")

    mode = _add(
        commands, "mode", "source of commands: a controller (auto), you (manual), the last one (hold), safe stop"
    )
    mode.add_argument("mode", choices=_MODES)
    _number(mode, "--force", "KN", ranges.COMMAND_FORCE_KN, f"manual: {ranges.COMMAND_FORCE_KN}")
    _number(mode, "--speed", "RPM", ranges.COMMAND_SPEED_RPM, f"manual: {ranges.COMMAND_SPEED_RPM}")

    _add(commands, "acknowledge", "acknowledge a safe stop whose causes are gone, so that another mode may follow")

    weld = _add(commands, "weld", "hold, resume or abort the programme of a whole weld; abort leads to the safe stop")
    weld.add_argument("action", choices=("hold", "resume", "abort"))


def _add(commands: Any, name: str, text: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(name, help=text, description=f"{name}: {text}.")
    add_timeout(parser)
    parser.set_defaults(run=_run, command=name)
    return parser


def add_timeout(parser: argparse.ArgumentParser) -> None:
    """Add the option of all commands that talk to the graph."""
    wait = "longest wait for the graph to answer, 0.1 to 600 s (default 5)"
    _number(parser, "--timeout", "S", Range(0.1, 600.0, "s"), wait, 5.0)


def _run(arguments: argparse.Namespace) -> int:
    from fsw import operator_node  # the other commands do without rclpy

    return int(getattr(operator_node, arguments.command)(arguments))


def _number(
    parser: argparse.ArgumentParser, flag: str, metavar: str, allowed: Range, text: str, default: float | None = None
) -> None:
    """Add an option that takes a number in a range; the error names the range."""

    def number(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is not a number ({allowed})") from None
        complaint = allowed.complaint(value)
        if complaint:
            raise argparse.ArgumentTypeError(complaint)
        return value

    parser.add_argument(flag, metavar=metavar, type=number, default=default, help=text)
