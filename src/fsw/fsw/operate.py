"""Shared by the commands for the running graph, without rclpy; `operator_node` does the communication."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from typing import Any

from fsw.options import add_number
from fsw_schema.ranges import Range

#: what ends a disturbance or a fault; ``none`` in scenarios and services
CLEAR = "clear"


def add_graph_command(
    commands: Any, name: str, text: str, run: Callable[[argparse.Namespace], int]
) -> argparse.ArgumentParser:
    """Add a command that talks to the running graph."""
    parser: argparse.ArgumentParser = commands.add_parser(name, help=text, description=f"{name}: {text}.")
    add_graph_options(parser)
    parser.set_defaults(run=run)
    return parser


def add_graph_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of all commands that talk to the graph."""
    wait = "maximum time to wait for an answer, 0.1 to 600 s (default 5)"
    add_number(parser, "--timeout", "S", Range(0.1, 600.0, "s"), wait, 5.0)
    parser.add_argument("--namespace", metavar="NS", default="", help="of the weld, e.g. cell1 (default: none)")


def add_verbs(
    commands: Any, name: str, text: str, verbs: Mapping[str, str], run: Callable[[argparse.Namespace], int]
) -> dict[str, argparse.ArgumentParser]:
    """Add a command that has commands of its own (``verb``, with their help), all for the running graph."""
    parser = commands.add_parser(name, help=text, description=f"{name}: {text}.")
    added = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    parsers = {}
    for verb, words in verbs.items():
        parsers[verb] = one = added.add_parser(verb, help=words, description=f"{verb}: {words}.")
        add_graph_options(one)
        one.set_defaults(run=run, verb=verb)
    return parsers


def health(controller: Any) -> str:
    """Whether a controller can be selected, in words."""
    if controller.reason:
        return f"cannot be selected: {controller.reason}"
    return "ready" if controller.warm else "not ready yet"
