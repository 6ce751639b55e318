"""Command of the study: welds on random canisters, validation of the plant, both pages."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from canister import report, verdict
from canister.properties import properties
from canister.validation import validation
from fsw.console import ProgressBar
from fsw_control.schema.models import InputError

#: of the whole weld
_WHOLE_MINUTES = 45.0
_PARTS = {"validation.json": "validate", "properties.json": "properties"}
_RESULTS = Path(__file__).resolve().parents[3] / "docs" / "results"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    parser = argparse.ArgumentParser(
        description="Weld random canisters, and write the page of results."
    )
    parser.add_argument(
        "part", choices=["weld", "validate", "properties", "page"], help="what to do"
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/canister"),
        help="folder of the results (default %(default)s)",
    )
    parser.add_argument(
        "--welds", type=int, default=1000, help="canisters to weld (default %(default)s)"
    )
    parser.add_argument(
        "--share",
        default="0/1",
        metavar="I/N",
        help="every Nth from the Ith on, to share them out",
    )
    parser.add_argument(
        "--controller",
        action="append",
        default=[],
        help="with these only (default: all of the campaign)",
    )
    parser.add_argument(
        "--minutes",
        type=float,
        default=1e6,
        help="weld: begin no more welds after so long; properties: of welding (45)",
    )
    coarse = "validate: elements of 12 mm and 64 modes for the comparison with all finite elements"
    parser.add_argument("--coarse", action="store_true", help=coarse)
    parser.add_argument("--publish", action="store_true", help="write the page into docs/results")
    _run(parser.parse_args(arguments))
    return 0


def _run(parsed: argparse.Namespace) -> None:
    parsed.out.mkdir(parents=True, exist_ok=True)
    numbers, copper = parsed.out / "validation.json", parsed.out / "properties.json"
    if parsed.part == "weld":
        first, every = map(int, parsed.share.split("/"))
        welds = range(first, parsed.welds, every)
        verdict.run(parsed.out / f"welds_{first}.jsonl", welds, parsed.minutes, parsed.controller)
    elif parsed.part == "validate":
        with ProgressBar("validation") as bar:
            numbers.write_text(
                json.dumps(validation(bar, parsed.coarse), indent=1) + "\n", encoding="utf-8"
            )
    elif parsed.part == "properties":
        with ProgressBar("k(T), c(T)") as bar:
            results = properties(min(parsed.minutes, _WHOLE_MINUTES), bar)
        copper.write_text(json.dumps(results) + "\n", encoding="utf-8")
    else:
        rows = verdict.read(sorted(parsed.out.glob("*.jsonl")))
        plant = numbers.exists() or not rows  # the verdict may be written without it
        data = {"verdict": report.summary(rows)}
        data |= (
            {"validation": _made(numbers), "properties": _made(copper)}
            if plant
            else {"validation": {}}
        )
        for path in report.write(data, _RESULTS if parsed.publish else parsed.out):
            print(path)


def _made(file: Path) -> Any:
    """Numbers that an earlier part of the study has written."""
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise InputError(
            f"{file}: not there or damaged; run the part {_PARTS[file.name]} first"
        ) from None
