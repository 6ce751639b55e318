"""``fsw.py bag kpi``: figures of merit of welds."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from math import isfinite

from fsw.bags import bag_argument, print_notes, welds_of
from fsw.command import FORCE, command, file
from fsw.outputs import check_new, write_json
from fsw_analysis import kpi, kpi_table, phase_kpi
from fsw_analysis.changes import missing_at_end_s
from fsw_analysis.weld_signals import WeldSignals


@command(
    "bag kpi",
    "figures of merit of a weld, and of each phase of a whole weld; "
    "several bags are shown side by side",
    bag_argument(nargs="+"),
    file("--json", "also write them, and those of each event"),
    FORCE,
)
def figures_of_merit(arguments: argparse.Namespace) -> int:
    check_new([arguments.json], arguments.force)
    welds = welds_of(arguments.bag)
    print_notes(_missing_ends(welds))
    results = [kpi.compute(signals, label) for label, signals in welds.items()]
    print(kpi_table.markdown(results), end="")
    phases = [
        phase_kpi.compute(signals, label, phase_kpi.recorded_spans(signals))
        if signals.phases
        else []
        for label, signals in welds.items()
    ]
    if any(phases):
        print("\n" + phase_kpi.markdown([run for run in phases if run]), end="")
    rows = zip(results, phases, strict=True)
    write_json(arguments.json, [result | {"phases": [*map(asdict, run)]} for result, run in rows])
    return 0


def _missing_ends(welds: Mapping[str, WeldSignals]) -> Iterator[str]:
    for label, signals in welds.items():
        if (missing_s := missing_at_end_s(signals)) != 0.0:
            lacks = (
                f"its last {missing_s:.1f} s are"
                if isfinite(missing_s)
                else "the end of its programme is"
            )
            yield f"{label}: {lacks} not on record; the last tick is at {signals.time_s[-1]:.1f} s"
