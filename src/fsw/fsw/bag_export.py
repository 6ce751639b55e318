"""``fsw.py bag export``: the signals of a weld as a table."""

from __future__ import annotations

import argparse
from pathlib import Path

from fsw.bags import bag_argument, print_notes, read_weld
from fsw.command import FORCE, command, option, switch
from fsw.outputs import check_new
from fsw_analysis.changes import cut_to_scenario
from fsw_analysis.export import export_weld


@command(
    "bag export",
    "write the aligned signals of a weld as a table, one row per tick, in the paper's units",
    bag_argument(),
    option("output", type=Path, nargs="?", help="CSV file to write (default: <bag>.csv)"),
    switch("--all", "also the ticks after the end of the attached scenario"),
    FORCE,
)
def export(arguments: argparse.Namespace) -> int:
    source: Path = arguments.bag
    target = arguments.output or source.absolute().parent / f"{source.absolute().name}.csv"
    check_new([target], arguments.force)
    signals = read_weld(source)
    if not arguments.all:
        whole, signals = signals.n_ticks, cut_to_scenario(signals)
        if signals.n_ticks < whole:
            print_notes(
                [
                    f"{whole - signals.n_ticks} ticks after the end of the scenario are omitted; "
                    "--all includes them"
                ]
            )
    print(f"{export_weld(signals, target)} rows written to {target}")
    return 0
