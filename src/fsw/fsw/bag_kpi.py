"""``fsw.py bag kpi``: figures of merit of welds."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import Any

from fsw.bags import add_bag_command, welds_of
from fsw.options import add_file, add_force
from fsw.outputs import check_new, write_json
from fsw_analysis import kpi, kpi_table, phase_kpi


def add_command(commands: Any) -> None:
    """Add the command to the subcommands of ``bag``."""
    text = "figures of merit of a weld, and of each phase of a whole weld; several bags are shown side by side"
    figures_of_merit = add_bag_command(commands, "kpi", _run, text, several=True)
    add_file(figures_of_merit, "--json", "also write them, and those of each event")
    add_force(figures_of_merit)


def _run(arguments: argparse.Namespace) -> int:
    check_new([arguments.json], arguments.force)
    welds = welds_of(arguments.bag)
    results = [kpi.compute(signals, label) for label, signals in welds.items()]
    print(kpi_table.markdown(results), end="")
    phases = [
        phase_kpi.compute(signals, label, phase_kpi.recorded_spans(signals)) if signals.phases else []
        for label, signals in welds.items()
    ]
    if any(phases):
        print("\n" + phase_kpi.markdown([run for run in phases if run]), end="")
    rows = zip(results, phases, strict=True)
    write_json(arguments.json, [result | {"phases": [asdict(one) for one in run]} for result, run in rows])
    return 0
