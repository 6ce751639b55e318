"""Common parts of the commands on recorded welds."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable
from pathlib import Path

from fsw.command import Option, group, option
from fsw.console import ProgressBar
from fsw_analysis.changes import cut_to_scenario
from fsw_analysis.report import labels
from fsw_analysis.signals import load_weld
from fsw_analysis.weld_signals import WeldSignals
from fsw_recorder.bag_reader import SUFFIXES
from fsw_recorder.manifest import mapped

#: help text of a bag argument if damaged bags are accepted
DAMAGED_TOO = "bag folder or file (MCAP, sqlite3; intact, truncated or damaged)"


BAG = group("bag", "inspect recorded welds", "Inspect recorded welds.")


def bag_argument(text: str = "bag of a weld", nargs: str | None = None) -> Option:
    """The argument of all commands on one or more bags."""
    return option("bag", type=Path, help=text, nargs=nargs)


def print_notes(notes: Iterable[str]) -> None:
    """Report problems of a bag on stderr, separate from the result."""
    for note in notes:
        print(f"note: {note}", file=sys.stderr)


def data_sha256(bag: Path) -> str:
    """SHA-256 of a file, or of the data files in a bag's folder in the order of their names."""
    whole = hashlib.sha256()
    for path in sorted(bag.iterdir()) if bag.is_dir() else [bag]:
        if not bag.is_dir() or path.name.endswith(SUFFIXES):
            whole.update(mapped(path))
    return whole.hexdigest()


def read_weld(bag: Path) -> WeldSignals:
    """Signals of a bag; its problems are reported on stderr."""
    with ProgressBar(f"reading {bag}") as bar:
        signals = load_weld(bag, bar)
    print_notes(signals.problems)
    return signals


def welds_of(bags: list[Path]) -> dict[str, WeldSignals]:
    """Welds by distinguishing labels, each cut to the length of its scenario."""
    return {
        label: cut_to_scenario(read_weld(bag))
        for label, bag in zip(labels(bags), bags, strict=True)
    }
