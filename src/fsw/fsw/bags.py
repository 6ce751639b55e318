"""Shared by the commands on recorded welds: reading, figures of merit, figures."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from fsw.errors import CommandError
from fsw.outputs import check_new, write_json
from fsw.progress import ProgressBar
from fsw_analysis import kpi, kpi_table, phase_kpi
from fsw_analysis.bag_labels import labels
from fsw_analysis.changes import cut_to_scenario
from fsw_analysis.messages import WeldMessages
from fsw_analysis.signals import load_weld
from fsw_analysis.weld_signals import WeldSignals
from fsw_scenario.scenario_file import parse
from fsw_schema.models import InputError

#: what a command takes that also reads damaged bags
DAMAGED_TOO = "bag folder or file (MCAP, sqlite3; intact, truncated or damaged)"
#: how a controller is named
NAME_OR_CLASS = "NAME, or MODULE:CLASS or FILE.py:CLASS of your own controller"


def add_bag_command(
    commands: Any,
    name: str,
    run: Any,
    text: str,
    bag: str = "bag of a weld",
    description: str = "",
    several: bool = False,
) -> argparse.ArgumentParser:
    """Add a command on one or several bags."""
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=text, description=description or f"{name}: {text}."
    )
    parser.add_argument("bag", type=Path, help=bag, nargs="+" if several else None)
    parser.set_defaults(run=run)
    return parser


def print_notes(notes: Iterable[str]) -> None:
    """Report problems of a bag on stderr, separate from the result."""
    for note in notes:
        print(f"note: {note}", file=sys.stderr)


def read_weld(bag: Path) -> WeldSignals:
    """Signals of a bag; its problems are reported on stderr."""
    with ProgressBar(f"reading {bag}") as bar:
        signals = load_weld(bag, bar)
    print_notes(signals.problems)
    return signals


def read_messages(bag: Path) -> WeldMessages:
    """Messages of the weld in a bag; problems of the bag are reported on stderr."""
    with ProgressBar(f"reading {bag}") as bar:
        messages = WeldMessages(bag, bar)
    print_notes(messages.problems)
    return messages


def welds_of(bags: list[Path]) -> dict[str, WeldSignals]:
    """Welds by the labels that distinguish them, each cut to the length of its scenario."""
    return {label: cut_to_scenario(read_weld(bag)) for label, bag in zip(labels(bags), bags, strict=True)}


def print_kpis(welds: dict[str, WeldSignals], file: Path | None) -> None:
    """Print figures of merit, with those of the phases, and write them as JSON where a file is given."""
    results = [kpi.compute(signals, label) for label, signals in welds.items()]
    print(kpi_table.markdown(results), end="")
    phases = [
        phase_kpi.compute(signals, label, phase_kpi.recorded_spans(signals)) if signals.phases else []
        for label, signals in welds.items()
    ]
    if any(phases):
        print("\n" + phase_kpi.markdown([run for run in phases if run]), end="")
    write_json(
        file, [result | {"phases": [asdict(one) for one in run]} for result, run in zip(results, phases, strict=True)]
    )


def draw_figures(
    welds: dict[str, WeldSignals], folder: Path, force: bool, numbers: Sequence[int] | None = None
) -> None:
    """Draw figures of the paper, by default those that the first weld's scenario names."""
    from fsw_analysis.figures import Run, draw  # matplotlib takes a second to import

    text = next(iter(welds.values())).attachments.get("scenario.yaml")
    if numbers is None and text:
        try:
            numbers = parse(text.decode("utf-8", "replace"), "scenario.yaml of the bag").figures
        except InputError as error:
            print_notes([str(error)])
    check_new([folder / f"{name}.png" for name in (*(f"fig{one}" for one in numbers or ()), "overview")], force)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        paths = draw([Run(label, signals) for label, signals in welds.items()], numbers or (), folder)
    except OSError as error:
        raise CommandError(f"cannot write figures into {folder}: {error.strerror}") from None
    print("\n".join(map(str, paths)))
