"""``fsw.py lifecycle``: states of the managed nodes. `lifecycle_ros` carries it out."""

from __future__ import annotations

import argparse
from typing import Any

from fsw.operate import add_verbs

_VERBS = {
    "list": "the managed nodes, or the transitions that a node has now",
    "get": "state of a node",
    "set": "a transition of a node: configure, activate, deactivate, cleanup or shutdown",
}


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    text = "managed nodes (plant, gateway, recorder): list, get, set"
    parsers = add_verbs(commands, "lifecycle", text, _VERBS, _run)
    for verb, one in parsers.items():
        options: dict[str, Any] = {"nargs": "?", "default": ""} if verb == "list" else {}
        one.add_argument("node", metavar="NODE", help="name, e.g. fsw_recorder", **options)
    parsers["set"].add_argument("transition", metavar="TRANSITION", help="label, e.g. activate")


def _run(arguments: argparse.Namespace) -> int:
    from fsw import lifecycle_ros  # the other commands do without rclpy

    return lifecycle_ros.run(arguments)
