"""``fsw.py record``: the record of a weld, with its verdict."""

from __future__ import annotations

import argparse
from pathlib import Path

import fsw
from fsw.bags import DAMAGED_TOO, print_notes
from fsw.command import (
    FORCE,
    FORMAT_BESIDE,
    REQUIRE_SIGNED_PROCEDURE,
    TRUSTED,
    assigned,
    command,
    file,
    option,
    repeated,
)
from fsw.console import ProgressBar, check_new
from fsw.errors import CommandError
from fsw_analysis.report import labels
from fsw_quality import record_hook, report
from fsw_quality.record_content import Record
from fsw_recorder import after_recording
from fsw_scenario.procedure import check_signed, load, shipped


@command(
    "record",
    "write the weld record (verdict, rules, exceedances, figures)",
    option("bag", type=Path, nargs="+", help=DAMAGED_TOO),
    option("--procedure", required=True, help=f"YAML file, or one of {', '.join(shipped())}"),
    file("--out", "folder for the records", "DIR", required=True),
    file(
        "--compare",
        "folder with earlier records: compare with the procedure's last accepted welds",
        "DIR",
    ),
    repeated(
        "--data",
        "KEY=VALUE",
        "data known only after the weld, e.g. ndt, nonconformance, disposition: keys of weld_data",
    ),
    TRUSTED,
    REQUIRE_SIGNED_PROCEDURE,
    FORMAT_BESIDE,
    FORCE,
    description="Judge recorded welds by a procedure; write record.html and record.json (with the "
    "extra pdf record.pdf), a folder per bag. The exit code ignores the verdict.",
)
def record(arguments: argparse.Namespace) -> int:
    load(arguments.procedure)  # its mistakes are reported before anything else
    check_signed(arguments.procedure, arguments.trusted, arguments.require_signed)
    ending = arguments.format
    bags = dict(zip(labels(arguments.bag), arguments.bag, strict=True))
    if len({bag.resolve() for bag in arguments.bag}) < len(arguments.bag):
        raise CommandError("record: one of the bags is given twice")
    if arguments.data and len(bags) > 1:
        raise CommandError("record: --data needs exactly one bag")
    afterwards = assigned("record: --data", arguments.data, "KEY=VALUE")
    for bag in arguments.bag:
        after_recording.wait(bag, lambda text: print_notes([text]))
    several = len(bags) > 1
    folders = {
        name: arguments.out / name.replace("/", "_").replace(" ", "_")
        if several
        else arguments.out
        for name in bags
    }
    if len(set(folders.values())) < len(folders):
        raise CommandError(
            "record: two of the bags would be written into one folder; give them one by one"
        )
    check_new(
        [
            folder / name
            for folder in folders.values()
            for name in (report.JSON, report.PAGE, report.PDF, *report.figure_names(ending))
        ],
        arguments.force,
    )
    for name, bag in bags.items():
        notes: list[str] = []
        with ProgressBar(f"reading {bag}") as bar:
            weld_record = fsw.record(
                bag,
                arguments.procedure,
                folders[name],
                compare_with=arguments.compare,
                afterwards=afterwards,
                figures=ending,
                progress=bar,
                note=notes.append,
            )
        print_notes(notes)
        print_notes(fact.words for fact in weld_record.cannot_say)
        print(
            f"{name}: {weld_record.verdict.upper()} ({weld_record.deciding.name}: "
            f"{weld_record.deciding.words}: {weld_record.deciding.figure})"
        )
        print_notes(_unusual(weld_record))
        files = [*report.files(), *report.figure_names(ending)]
        written = [path for path in (folders[name] / file for file in files) if path.exists()]
        print(f"written: {', '.join(map(str, written))}")
    if not report.can_write_pdf():
        print_notes([f"no PDF: {record_hook.PDF.absence}"])
    return 0


def _unusual(record: Record) -> list[str]:
    """Figures far from those of the accepted welds, in words."""
    comparison = record.comparison
    if comparison is None:
        return []
    of = f"{len(comparison.welds)} accepted welds"
    return [
        f"{row.phase}: {row.name}: {row.value:.4g}, in {of} {row.low:.4g} to {row.high:.4g}"
        for row in comparison.far
    ]
