"""``fsw.py bag export``, ``kpi``, ``plot``: signals, figures of merit, figures of welds."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from math import isfinite
from pathlib import Path

from fsw.bags import bag_argument, print_notes, read_weld, welds_of
from fsw.command import FORCE, FORMAT, PICTURES, command, file, option, switch
from fsw.console import check_new, write_json
from fsw.errors import CommandError
from fsw_analysis import kpi, kpi_table, phase_kpi
from fsw_analysis.changes import cut_to_scenario, missing_at_end_s
from fsw_analysis.weld_signals import WeldSignals, export_weld
from fsw_control.schema.models import InputError
from fsw_scenario.scenario_file import parse


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


#: which are no folder, whatever --out takes
_OTHER_PICTURES = (".jpg", ".jpeg", ".gif", ".bmp", ".tif", ".tiff", ".webp", ".eps", ".ps")


@command(
    "bag plot",
    "the paper's figures of a weld; several bags are overlaid",
    bag_argument(nargs="+"),
    file(
        "--out",
        f"folder for the figures (default: here), or one file ({', '.join(PICTURES)}): "
        "the overview, or the figure that --figures gives",
        "DIR",
        default=Path("."),
    ),
    option(
        "--figures",
        type=int,
        nargs="*",
        choices=range(4, 10),
        help="figures 4 to 9 (default: the scenario's)",
    ),
    FORMAT,
    FORCE,
)
def plot(arguments: argparse.Namespace) -> int:
    from fsw_analysis.figures import Run, draw, page  # matplotlib takes a second to import

    folder, numbers, ending = arguments.out, arguments.figures, arguments.format
    suffix = "" if folder.is_dir() else folder.suffix.lower()
    if suffix in _OTHER_PICTURES:
        raise CommandError(f"--out {folder}: the name of a figure ends in {', '.join(PICTURES)}")
    if suffix in PICTURES and suffix != f".{ending or suffix[1:]}":
        raise CommandError(f"--out {folder} contradicts --format {ending}")
    welds = welds_of(arguments.bag)
    runs = [Run(label, signals) for label, signals in welds.items()]
    if suffix in PICTURES:
        if len(numbers or ()) > 1:
            raise CommandError(f"--out {folder}: one figure fits into a file; give a folder")
        check_new([folder], arguments.force)
        folder.parent.mkdir(parents=True, exist_ok=True)
        page(runs, numbers[0] if numbers else None, path=folder)
        print(folder)
        return 0
    text = next(iter(welds.values())).attachments.get("scenario.yaml")
    if numbers is None and text:
        try:
            numbers = parse(text.decode("utf-8", "replace"), "scenario.yaml of the bag").figures
        except InputError as error:
            print_notes([str(error)])
    names = (*(f"fig{number}" for number in numbers or ()), "overview")
    ending = ending or "png"
    check_new([folder / f"{name}.{ending}" for name in names], arguments.force)
    folder.mkdir(parents=True, exist_ok=True)
    print("\n".join(map(str, draw(runs, numbers or (), folder, ending=ending))))
    return 0
