"""``fsw.py param``: parameters of the nodes that run. `params_ros` carries it out."""

from __future__ import annotations

import argparse
from typing import Any

from fsw.operate import add_graph_options

_VERBS = {
    "list": "all parameters of a node with their values and meaning",
    "get": "value of a parameter",
    "set": "change a parameter; the node may refuse, with a reason",
}


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    text = "parameters of a running node: list, get, set"
    parser = commands.add_parser("param", help=text, description=f"param: {text}.")
    verbs = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for verb, words in _VERBS.items():
        one = verbs.add_parser(verb, help=words, description=f"{verb}: {words}.")
        one.add_argument("node", metavar="NODE", help="name, e.g. fsw_nmpc; 'status' lists the nodes")
        if verb != "list":
            one.add_argument("name", metavar="NAME", help="of the parameter")
        if verb == "set":
            one.add_argument("value", metavar="VALUE", help="new value, as YAML")
        add_graph_options(one)
        one.set_defaults(run=_run, verb=verb)


def _run(arguments: argparse.Namespace) -> int:
    from fsw import params_ros  # the other commands do without rclpy

    return params_ros.run(arguments)
