"""``fsw.py lifecycle``: states of the managed nodes. `lifecycle_ros` carries it out."""

from __future__ import annotations

import argparse
from typing import Any

from fsw.operate import add_graph_options

_VERBS = {
    "list": "the managed nodes, or the transitions that a node has now",
    "get": "state of a node",
    "set": "a transition of a node: configure, activate, deactivate, cleanup or shutdown",
}


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    text = "managed nodes (plant, gateway, recorder): list, get, set"
    parser = commands.add_parser("lifecycle", help=text, description=f"lifecycle: {text}.")
    verbs = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for verb, words in _VERBS.items():
        one = verbs.add_parser(verb, help=words, description=f"{verb}: {words}.")
        options = {"nargs": "?", "default": ""} if verb == "list" else {}
        one.add_argument("node", metavar="NODE", help="name, e.g. fsw_recorder", **options)
        if verb == "set":
            one.add_argument("transition", metavar="TRANSITION", help="label, e.g. activate")
        add_graph_options(one)
        one.set_defaults(run=_run, verb=verb)


def _run(arguments: argparse.Namespace) -> int:
    from fsw import lifecycle_ros  # the other commands do without rclpy

    return lifecycle_ros.run(arguments)
