"""Command of the study: fit of the disturbances, welds of all controllers, page."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from fsw.console import ProgressBar
from fsw_control.schema.models import InputError
from realistic import report, welds
from realistic.fit import fit, trace

_RESULTS = Path(__file__).resolve().parents[3] / "docs" / "results"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    parser = argparse.ArgumentParser(
        description="Fit the disturbances of the scenario 'realistic', "
        "weld with it, write the page."
    )
    parser.add_argument("part", choices=["fit", "weld", "page"], help="what to do")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/realistic"),
        help="folder of the results (default %(default)s)",
    )
    parser.add_argument("--workers", type=int, default=2, help="processes (default %(default)s)")
    parser.add_argument(
        "--share",
        type=float,
        default=1.0,
        help="weld: share of the welds, for a trial (default all)",
    )
    parser.add_argument("--publish", action="store_true", help="page: write it into docs/results")
    chosen = parser.parse_args(arguments)
    chosen.out.mkdir(parents=True, exist_ok=True)
    fitted, rows = chosen.out / "fit.json", chosen.out / "weld.jsonl"

    if chosen.part == "fit":

        def traces(tasks: Sequence[welds.Task]) -> list[welds.Figures]:
            with ProgressBar("fit", len(tasks)) as bar:
                return list(welds.each(trace, tasks, chosen.workers, bar))

        fitted.write_text(json.dumps(fit(traces), indent=1), encoding="utf-8")
        print(fitted.read_text(encoding="utf-8"))
    elif chosen.part == "weld":
        tasks = report.tasks(chosen.share)
        with ProgressBar("weld", len(tasks)) as bar:
            welds.run(tasks, rows, chosen.workers, bar)
    else:
        if not (fitted.exists() and rows.exists()):
            raise InputError(f"{chosen.out}: run the parts fit and weld first")
        data = report.content(welds.read(rows), json.loads(fitted.read_text(encoding="utf-8")))
        for path in report.write(data, _RESULTS if chosen.publish else chosen.out):
            print(path)
    return 0
