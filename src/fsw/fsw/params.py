"""``fsw.py param``: parameters of the nodes that run. `params_ros` carries it out."""

from __future__ import annotations

import argparse
from typing import Any

from fsw.operate import add_verbs

_VERBS = {
    "list": "all parameters of a node with their values and meaning",
    "get": "value of a parameter",
    "set": "change a parameter; the node may refuse, with a reason",
}


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    parsers = add_verbs(commands, "param", "parameters of a running node: list, get, set", _VERBS, _run)
    for verb, one in parsers.items():
        one.add_argument("node", metavar="NODE", help="name, e.g. fsw_nmpc; 'status' lists the nodes")
        if verb != "list":
            one.add_argument("name", metavar="NAME", help="of the parameter")
    parsers["set"].add_argument("value", metavar="VALUE", help="new value, as YAML")


def _run(arguments: argparse.Namespace) -> int:
    from fsw import params_ros  # the other commands do without rclpy

    return params_ros.run(arguments)
