"""``fsw node``: runs a node of the installed package; the repository has ``scripts/run_*.py``."""

from __future__ import annotations

import argparse
import sys

from fsw.command import command, option
from fsw_control.schema.extensions import extensions, loaded


@command(
    "node",
    "run one node; what follows its name goes to the node, e.g. --help or --ros-args",
    option("node", choices=list(extensions("fsw.nodes")), metavar="NODE", help="which node"),
    option("words", nargs=argparse.REMAINDER, metavar="...", help="arguments of the node"),
)
def node(arguments: argparse.Namespace) -> int:
    sys.argv = [f"fsw node {arguments.node}", *arguments.words]  # nodes read their arguments there
    code: int = loaded("fsw.nodes", arguments.node)()
    return code
