"""Shared by the commands on recorded welds."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from fsw.progress import ProgressBar
from fsw_analysis.bag_labels import labels
from fsw_analysis.changes import cut_to_scenario
from fsw_analysis.messages import WeldMessages
from fsw_analysis.signals import load_weld
from fsw_analysis.weld_signals import WeldSignals

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
    optional: bool = False,
) -> argparse.ArgumentParser:
    """Add a command on one or several bags, with ``optional`` also on none."""
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=text, description=description or f"{name}: {text}."
    )
    parser.add_argument("bag", type=Path, help=bag, nargs="*" if optional else "+" if several else None)
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
