"""``fsw.py campaign``: many welds with random parameters, and the report on them."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from fsw.command import (
    FORCE,
    FORMAT_BESIDE,
    REQUIRE_SIGNED_PROCEDURE,
    TRUSTED,
    command,
    file,
    option,
    switch,
    trusted_keys,
)
from fsw.console import ProgressBar, check_new, default_folder
from fsw.errors import CommandError, program
from fsw_control.schema.extensions import Extra

_REPORT = "report"
#: arguments of only one of both forms
_ONLY_RUN, _ONLY_REPORT = (
    ("welds", "workers", "scheduler", "resume", "trusted", "require_signed"),
    ("folder", "limits", "format", "force"),
)


@command(
    "campaign",
    "run many welds with random parameters on Dask; report on them",
    option(
        "file", metavar="FILE", help="YAML file or name of a shipped campaign; or the word report"
    ),
    option(
        "folder", metavar="DIR", nargs="?", type=Path, help="after report: folder of a campaign"
    ),
    file(
        "--out",
        "folder for the welds (default out/<date>_<campaign>); of a report the file, "
        ".html with its figures in it or .md with figures beside it (default DIR/report.html)",
        "OUT",
    ),
    switch("--resume", "run the welds that are still missing in the folder"),
    option(
        "--welds", type=int, metavar="N", help="welds of each controller, instead of the file's"
    ),
    option(
        "--workers",
        type=int,
        metavar="N",
        help="processes on this machine (default: one per core)",
    ),
    option(
        "--scheduler",
        metavar="ADDRESS",
        help="Dask scheduler, e.g. tcp://host:8786, instead of processes started here",
    ),
    TRUSTED,
    REQUIRE_SIGNED_PROCEDURE,
    file("--limits", "after report: limits on figures of merit (YAML) instead of its own"),
    FORMAT_BESIDE,
    FORCE,
    description="Run the welds of a campaign file on Dask, into a folder with one Parquet "
    "dataset; or, with 'report', write a report on the welds in such a folder.",
    usage="%(prog)s [-h] FILE [--out DIR] [--resume] [--welds N] [--workers N] [--scheduler "
    "ADDRESS]\n       [--trusted FILE] [--require-signed]\n"
    "       %(prog)s report DIR [--out FILE] [--limits FILE] [--format FORMAT] [--force]",
    needs=Extra("fsw-lab", "campaign", ("distributed", "pyarrow")),
)
def campaign(arguments: argparse.Namespace) -> int:
    report = arguments.file == _REPORT
    wrong = [name for name in (_ONLY_RUN if report else _ONLY_REPORT) if getattr(arguments, name)]
    if report and (wrong or arguments.folder is None):
        raise CommandError(
            "campaign report: give the folder of a campaign, and no options other than --out, "
            "--limits, --format and --force"
        )
    if wrong:
        raise CommandError(
            f"campaign: {', '.join(wrong)}: only for 'campaign report'; "
            "a campaign takes its limits from its file and its folder from --out, "
            "and never replaces files"
        )
    return _report(arguments) if report else _weld(arguments)


def _weld(arguments: argparse.Namespace) -> int:
    from fsw_campaign import dataset, definition, engine

    if arguments.resume and arguments.out is None:
        raise CommandError("campaign: --resume needs --out with the folder of the campaign")
    if arguments.workers is not None and (arguments.workers < 1 or arguments.scheduler):
        raise CommandError(
            "campaign: --workers must be at least 1 and cannot be combined with "
            "--scheduler, which has its own"
        )
    trusted = trusted_keys(arguments) or None
    campaign = definition.load(arguments.file, arguments.welds, trusted, arguments.require_signed)
    folder = arguments.out or default_folder(campaign.name)
    with dataset.Dataset(folder, campaign, arguments.resume) as written:
        total, there = campaign.welds * len(campaign.entrants), len(written.done)
        try:
            if there < total:
                with (
                    ProgressBar(f"{campaign.name}, {total - there} welds", total - there) as bar,
                    engine.connect(arguments.scheduler, arguments.workers) as client,
                ):
                    engine.run(written, client, bar)
        except KeyboardInterrupt:
            state = f"{len(written.done)} of {total} welds are in {folder}"
            print(f"interrupted; {state}; continue with --resume", file=sys.stderr)
            return 130
    print(
        f"in {folder}: {total} welds, {total - there} of them new; "
        f"next: {program()} campaign report {folder}"
    )
    return 0


def _report(arguments: argparse.Namespace) -> int:
    from fsw_campaign import report

    target = arguments.out or arguments.folder / "report.html"
    beside = report.figure_files(target, arguments.format)
    check_new([target, *beside.values()], arguments.force)
    print(report.write(arguments.folder, target, arguments.limits, arguments.format))
    return 0
