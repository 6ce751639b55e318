"""``fsw.py history``.

A row for each weld, control charts over them, and what changed between two.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from math import isfinite
from pathlib import Path

from fsw.bags import DAMAGED_TOO, read_weld
from fsw.command import FORCE, FORMAT_BESIDE, command, file, group, option
from fsw.console import ProgressBar, check_new, print_table
from fsw.errors import CommandError
from fsw_analysis.procedure import Identity
from fsw_analysis.report import labels
from fsw_control.schema.extensions import Extra
from fsw_control.schema.models import json_content_of, read_text, validate
from fsw_quality.monitor import Monitor
from fsw_quality.monitor_run import process_of, watch
from fsw_quality.record import files_of
from fsw_quality.record_content import data_files
from fsw_recorder.bag_metadata import METADATA_NAME
from fsw_recorder.bag_reader import BagReader

_EXTRA = Extra("fsw-quality", "history", ("pyarrow",))

HISTORY = group(
    "history",
    "history of welds: add one, report on all, show what changed between two",
    "History of welds: add one, report on all, show what changed between two.",
)


def _judgement(file: Path, files: Sequence[str], bag: Path) -> tuple[str, Identity | None]:
    """Verdict of a record, and the procedure by which it was made."""
    try:
        record = json_content_of(read_text(file, "record"), str(file))
        verdict = str(record["verdict"])
        procedure = (
            validate(Identity, record["procedure"], str(file)) if "procedure" in record else None
        )
        judged = {file["sha256"] for file in record["files"] if file["name"] != METADATA_NAME}
    except (ValueError, KeyError, TypeError):
        raise CommandError(
            f"{file}: not the record of a weld; fsw.py record writes record.json"
        ) from None
    if judged and not judged & set(files):
        raise CommandError(f"{file}: is the record of another weld; none of its files is in {bag}")
    return verdict, procedure


@command(
    "history add",
    "add recorded welds",
    option("folder", type=Path, metavar="DIR", help="folder of the history, made if need be"),
    option("bag", type=Path, nargs="+", help=DAMAGED_TOO),
    option(
        "--record",
        type=Path,
        help="record.json of the weld, for its verdict and procedure; with one bag",
    ),
    description="Run the monitor over bags and add a row for each to the history in a folder.",
    needs=_EXTRA,
)
def add(arguments: argparse.Namespace) -> int:
    from fsw_quality import history  # of the extra

    if arguments.record and len(arguments.bag) > 1:
        raise CommandError("history add: --record is of one weld; give one bag")
    welds = []
    for label, bag in zip(labels(arguments.bag), arguments.bag, strict=True):
        with BagReader(bag) as reader:
            identity = dict(reader.metadata.custom_data)
        files = data_files(files_of(bag))
        judgement = _judgement(arguments.record, files, bag) if arguments.record else ("", None)
        welds.append((identity.get("canister") or label, files, bag, identity, judgement))
    # what is refused is refused before the monitor, which is slow
    history.check_new(arguments.folder, [(name, files) for name, files, *_ in welds])
    rows = []
    for name, files, bag, identity, (verdict, procedure) in welds:
        signals = read_weld(bag)
        with ProgressBar(f"monitor {name}") as bar:
            watched = watch(Monitor(process_of(signals)), signals, bar)
        rows.append(history.row(name, signals, watched, identity, verdict, files, procedure))
    count = history.add(arguments.folder, rows)
    print(f"{arguments.folder}: {count} welds; new: {', '.join(row['weld'] for row in rows)}")
    return 0


@command(
    "history report",
    "report with control charts and the tools' lives",
    option("folder", type=Path, metavar="DIR"),
    file("--out", "HTML file (default DIR/report.html)"),
    FORMAT_BESIDE,
    FORCE,
    description="Write an HTML report on a history: findings, control charts, tool lives.",
    needs=_EXTRA,
)
def report(arguments: argparse.Namespace) -> int:
    from fsw_quality import history, history_report  # of the extra

    target = arguments.out or arguments.folder / "report.html"
    ending = arguments.format
    beside = target.with_name(f"{target.stem}_charts.{ending}") if ending else None
    check_new([target, beside], arguments.force)
    table = history.load(arguments.folder)
    remarks = history_report.write(table, target, "History of welds", beside)
    names = table["weld"].to_pylist()
    for remark in remarks[-20:]:
        print(f"{names[remark.at]}: {remark.text}")
    for tool in history_report.tools(table):
        print(f"tool {tool.tool}, {tool.welds} welds: {tool.words}")
    print(f"written: {target}")
    return 0


@command(
    "history diff",
    "what changed between two welds",
    option("folder", type=Path, metavar="DIR"),
    option("first", metavar="A", help="name of a weld in the history"),
    option("second", metavar="B"),
    description="Show what changed between two welds of a history.",
    needs=_EXTRA,
)
def diff(arguments: argparse.Namespace) -> int:
    from fsw_quality import history  # of the extra

    changes = history.difference(history.load(arguments.folder), arguments.first, arguments.second)
    if not changes:
        print(
            "nothing: the same texts, and no number differs by more than three standard deviations"
        )
        return 0
    rows = [
        (what, before, after, f"{size:+.1f}" if isfinite(size) else "")
        for what, before, after, size in changes
    ]
    print_table(rows, ("what", arguments.first, arguments.second, "σ"))
    return 0
