"""``fsw.py bag export``: the signals of a weld as a table."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from fsw.bags import add_bag_command, print_notes, read_weld
from fsw.options import add_force
from fsw.outputs import check_new
from fsw_analysis.changes import cut_to_scenario
from fsw_analysis.export import export_weld


def add_command(commands: Any) -> None:
    """Add the command to the subcommands of ``bag``."""
    text = "write the aligned signals of a weld as a table, one row per tick, in the paper's units"
    export = add_bag_command(commands, "export", _run, text)
    export.add_argument("output", type=Path, nargs="?", help="CSV file to write (default: <bag>.csv)")
    export.add_argument("--all", action="store_true", help="also the ticks after the end of the attached scenario")
    add_force(export)


def _run(arguments: argparse.Namespace) -> int:
    source: Path = arguments.bag
    target = arguments.output or source.absolute().parent / f"{source.absolute().name}.csv"
    check_new([target], arguments.force)
    signals = read_weld(source)
    if not arguments.all:
        whole, signals = signals.n_ticks, cut_to_scenario(signals)
        if signals.n_ticks < whole:
            print_notes(
                [f"{whole - signals.n_ticks} ticks after the end of the scenario are omitted; --all includes them"]
            )
    print(f"{export_weld(signals, target)} rows written to {target}")
    return 0
