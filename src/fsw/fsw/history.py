"""``fsw.py history``: a row for each weld, control charts over them, and what changed between two."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from fsw.bags import DAMAGED_TOO, read_weld
from fsw.errors import CommandError
from fsw.options import add_file, add_force
from fsw.outputs import check_new
from fsw.progress import ProgressBar
from fsw_analysis.bag_labels import labels
from fsw_quality.monitor import Monitor
from fsw_quality.monitor_run import process_of, watch
from fsw_quality.record import data_files, files_of
from fsw_recorder.bag_metadata import METADATA_NAME
from fsw_recorder.bag_reader import BagReader
from fsw_schema.models import InputError


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    text = "history of welds: add one, report on all, show what changed between two"
    history = commands.add_parser("history", help=text, description=f"{text.capitalize()}.")
    kinds = history.add_subparsers(title="commands", metavar="COMMAND", required=True)
    one = kinds.add_parser(
        "add",
        help="add recorded welds",
        description="Run the monitor over bags and add a row for each to the history in a folder.",
    )
    one.add_argument("folder", type=Path, metavar="DIR", help="folder of the history, made if need be")
    one.add_argument("bag", type=Path, nargs="+", help=DAMAGED_TOO)
    one.add_argument("--record", type=Path, help="record.json of the weld, for its verdict; with one bag")
    one.set_defaults(run=_add)
    one = kinds.add_parser(
        "report",
        help="report with control charts and the tools' lives",
        description="Write an HTML report on a history: what stands out, control charts, the tools' lives.",
    )
    one.add_argument("folder", type=Path, metavar="DIR")
    add_file(one, "--out", "HTML file (default DIR/report.html)")
    add_force(one)
    one.set_defaults(run=_report)
    one = kinds.add_parser(
        "diff", help="what changed between two welds", description="Tell what changed between two welds of a history."
    )
    one.add_argument("folder", type=Path, metavar="DIR")
    one.add_argument("first", metavar="A", help="name of a weld in the history")
    one.add_argument("second", metavar="B")
    one.set_defaults(run=_diff)


def _history() -> Any:
    try:
        from fsw_quality import history
    except ImportError as error:
        raise CommandError(f"history: {error.name or error} is missing: pip install pyarrow") from None
    return history


def _verdict(file: Path, files: Sequence[str], bag: Path) -> str:
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
        verdict = str(record["verdict"])
        judged = {one["sha256"] for one in record["files"] if one["name"] != METADATA_NAME}
    except OSError as error:
        raise CommandError(f"cannot read {file}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError):
        raise CommandError(f"{file}: not the record of a weld; fsw.py record writes record.json") from None
    if judged and not judged & set(files):
        raise CommandError(f"{file}: is the record of another weld; none of its files is in {bag}")
    return verdict


def _add(arguments: argparse.Namespace) -> int:
    history = _history()
    if arguments.record and len(arguments.bag) > 1:
        raise CommandError("history add: --record is of one weld; give one bag")
    rows = []
    for name, bag in zip(labels(arguments.bag), arguments.bag, strict=True):
        signals, files = read_weld(bag), data_files(files_of(bag))
        verdict = _verdict(arguments.record, files, bag) if arguments.record else ""
        with BagReader(bag) as reader:
            identity = dict(reader.metadata.custom_data)
        with ProgressBar(f"monitor {name}") as bar:
            watched = watch(Monitor(process_of(signals)), signals, bar)
        rows.append(history.row(identity.get("canister") or name, signals, watched, identity, verdict, files))
    welds = history.add(arguments.folder, rows)
    print(f"{arguments.folder}: {welds} welds; new: {', '.join(row['weld'] for row in rows)}")
    return 0


def _report(arguments: argparse.Namespace) -> int:
    history = _history()
    from fsw_quality import history_report

    target = arguments.out or arguments.folder / "report.html"
    check_new([target], arguments.force)
    table = history.load(arguments.folder)
    try:
        said = history_report.write(table, target, f"History {arguments.folder.name}")
    except OSError as error:
        raise CommandError(f"cannot write {target}: {error.strerror}") from None
    for weld, text in said[-20:]:
        print(f"{weld}: {text}")
    for one in history_report.tools(table):
        print(f"tool {one.tool}, {one.welds} welds: {one.words}")
    print(f"written: {target}")
    return 0


def _diff(arguments: argparse.Namespace) -> int:
    history = _history()
    try:
        found = history.difference(history.load(arguments.folder), arguments.first, arguments.second)
    except InputError as error:
        raise CommandError(str(error)) from None
    if not found:
        print("nothing: the same texts, and no number differs by more than three standard deviations")
        return 0
    table = Table("what", arguments.first, arguments.second, "σ")
    for what, before, after, size in found:
        table.add_row(what, before, after, f"{size:+.1f}" if isfinite(size) else "")
    Console().print(table)
    return 0
