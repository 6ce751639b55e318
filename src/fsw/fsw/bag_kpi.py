"""``fsw.py bag kpi``: figures of merit of welds."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from fsw.bags import add_bag_command, print_kpis, welds_of
from fsw.options import add_force
from fsw.outputs import check_new


def add_command(commands: Any) -> None:
    """Add the command to the subcommands of ``bag``."""
    text = "figures of merit of a weld, and of each phase of a whole weld; several bags are shown side by side"
    figures_of_merit = add_bag_command(commands, "kpi", _run, text, several=True)
    figures_of_merit.add_argument("--json", type=Path, metavar="FILE", help="also write them, and those of each event")
    add_force(figures_of_merit)


def _run(arguments: argparse.Namespace) -> int:
    check_new([arguments.json], arguments.force)
    print_kpis(welds_of(arguments.bag), arguments.json)
    return 0
