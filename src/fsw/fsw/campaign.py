"""``fsw.py campaign``: many welds with random parameters, and the report on them."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from fsw.errors import CommandError
from fsw.outputs import add_force, check_new, default_folder
from fsw.progress import ProgressBar

_REPORT = "report"


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    parser = commands.add_parser(
        "campaign",
        usage="%(prog)s [-h] FILE [--out DIR] [--resume] [--welds N] [--workers N] [--scheduler ADDRESS]\n"
        "       %(prog)s report DIR [--out FILE] [--limits FILE] [--force]",
        help="run many welds with random parameters on Dask; report on them",
        description="Run the welds of a campaign file on Dask, into a folder with one Parquet dataset; or, with "
        "'report', write a report on the welds in such a folder.",
    )
    parser.add_argument("file", metavar="FILE", help="YAML file or name of a shipped campaign; or the word report")
    parser.add_argument("folder", metavar="DIR", nargs="?", type=Path, help="after report: folder of a campaign")
    parser.add_argument(
        "--out",
        type=Path,
        help="folder for the welds (default out/<date>_<campaign>); of a report the file, .html with its figures in it "
        "or .md with figures beside it (default DIR/report.html)",
    )
    parser.add_argument("--resume", action="store_true", help="go on with the welds that are missing in the folder")
    parser.add_argument("--welds", type=int, metavar="N", help="welds of each controller, instead of the file's")
    parser.add_argument("--workers", type=int, metavar="N", help="processes on this machine (default: one per core)")
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="Dask scheduler, e.g. tcp://host:8786, instead of processes started here"
    )
    parser.add_argument(
        "--limits", type=Path, metavar="FILE", help="after report: limits on figures of merit (YAML) instead of its own"
    )
    add_force(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Carry the command out; returns the exit code."""
    try:
        import distributed  # noqa: F401
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise CommandError(f"campaign: {error}; install the packages in requirements/campaign.lock") from None
    if arguments.file == _REPORT:
        return _report(arguments)
    if arguments.limits is not None:
        raise CommandError("campaign: --limits is for a report; the limits of a campaign are in its file")
    if arguments.folder is not None:
        raise CommandError(f"campaign: {arguments.folder} is one argument too many; the folder is given by --out")
    if arguments.force:
        raise CommandError("campaign: --force is for a report; a folder with welds is never replaced")
    if arguments.resume and arguments.out is None:
        raise CommandError("campaign: --resume needs --out, the folder to go on with")
    if arguments.workers is not None and (arguments.workers < 1 or arguments.scheduler):
        raise CommandError("campaign: --workers must be at least 1, and is not for a --scheduler, which has its own")
    from fsw_campaign import dataset, definition, engine

    campaign = definition.load(arguments.file, arguments.welds)
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
            print(f"interrupted; {state}; go on with --resume", file=sys.stderr)
            return 130
    print(f"in {folder}: {total} welds, {total - there} of them new; next: fsw.py campaign report {folder}")
    return 0


def _report(arguments: argparse.Namespace) -> int:
    wrong = [name for name in ("welds", "workers", "scheduler", "resume") if getattr(arguments, name)]
    if arguments.folder is None or wrong:
        raise CommandError(
            "campaign report: needs the folder of a campaign, and takes no options but --out, --limits and --force"
        )
    from fsw_campaign import report

    target = arguments.out or arguments.folder / "report.html"
    check_new([target], arguments.force)
    print(report.write(arguments.folder, target, arguments.limits))
    return 0
