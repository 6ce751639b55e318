"""``fsw.py bag compare``: welds side by side."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from fsw.bags import add_bag_command, draw_figures, print_kpis, welds_of
from fsw.errors import CommandError
from fsw.outputs import add_force, check_new


def add_command(commands: Any) -> None:
    """Add the command to the subcommands of ``bag``."""
    text = "figures of merit of two or more welds side by side"
    compare = add_bag_command(commands, "compare", _run, text, several=True)
    compare.add_argument("--json", type=Path, metavar="FILE", help="also write them as JSON")
    compare.add_argument("--out", type=Path, help="also plot the welds overlaid, into this folder")
    add_force(compare)


def _run(arguments: argparse.Namespace) -> int:
    if len(arguments.bag) < 2:
        raise CommandError("bag compare: give at least two bags")
    check_new([arguments.json], arguments.force)
    welds = welds_of(arguments.bag)
    print_kpis(welds, arguments.json)
    if arguments.out is not None:
        draw_figures(welds, arguments.out, arguments.force)
    return 0
