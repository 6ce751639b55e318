"""``fsw.py bag plot``: figures of welds."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from fsw.bags import add_bag_command, draw_figures, welds_of
from fsw.options import add_force


def add_command(commands: Any) -> None:
    """Add the command to the subcommands of ``bag``."""
    text = "the paper's figures of a weld; several bags are overlaid"
    plot = add_bag_command(commands, "plot", _run, text, several=True)
    plot.add_argument("--out", type=Path, default=Path("."), help="folder for the PNG files (default: here)")
    plot.add_argument(
        "--figures", type=int, nargs="*", choices=range(4, 10), help="figures 4 to 9 (default: the scenario's)"
    )
    add_force(plot)


def _run(arguments: argparse.Namespace) -> int:
    draw_figures(welds_of(arguments.bag), arguments.out, arguments.force, arguments.figures)
    return 0
