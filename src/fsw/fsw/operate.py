"""Shared by the commands for the running graph, without rclpy; `operator_node` does the communication."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from fsw_schema.ranges import Range

#: what ends a disturbance or a fault; ``none`` in scenarios and services
CLEAR = "clear"


def add_graph_command(
    commands: Any, name: str, text: str, run: Callable[[argparse.Namespace], int]
) -> argparse.ArgumentParser:
    """Add a command that talks to the running graph."""
    parser: argparse.ArgumentParser = commands.add_parser(name, help=text, description=f"{name}: {text}.")
    add_timeout(parser)
    parser.set_defaults(run=run)
    return parser


def add_timeout(parser: argparse.ArgumentParser) -> None:
    """Add the option of all commands that talk to the graph."""
    wait = "maximum time to wait for an answer, 0.1 to 600 s (default 5)"
    add_number(parser, "--timeout", "S", Range(0.1, 600.0, "s"), wait, 5.0)


def add_number(
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


def health(controller: Any) -> str:
    """Whether a controller can be selected, in words."""
    if controller.reason:
        return f"cannot be selected: {controller.reason}"
    return "ready" if controller.warm else "not ready yet"
