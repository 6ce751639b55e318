"""Command of the study: validation of the plant, linear and nonlinear copper, the page."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from canister import report
from canister.validation import properties, validation
from fsw.console import ProgressBar
from fsw_control.schema.models import InputError

#: of the whole weld
_WHOLE_MINUTES = 45.0
_PARTS = {"validation.json": "validate", "properties.json": "properties"}
_RESULTS = Path(__file__).resolve().parents[3] / "docs" / "results"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    parser = argparse.ArgumentParser(
        description="Validate the plant that conducts heat, and write the page of results."
    )
    parser.add_argument("part", choices=["validate", "properties", "page"], help="what to do")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/canister"),
        help="folder of the results (default %(default)s)",
    )
    parser.add_argument(
        "--minutes",
        type=float,
        default=_WHOLE_MINUTES,
        help="properties: of welding (default %(default)g)",
    )
    coarse = "validate: elements of 12 mm and 64 modes for the comparison with all finite elements"
    parser.add_argument("--coarse", action="store_true", help=coarse)
    parser.add_argument("--publish", action="store_true", help="write the page into docs/results")
    _run(parser.parse_args(arguments))
    return 0


def _run(parsed: argparse.Namespace) -> None:
    parsed.out.mkdir(parents=True, exist_ok=True)
    numbers, copper = parsed.out / "validation.json", parsed.out / "properties.json"
    if parsed.part == "validate":
        with ProgressBar("validation") as bar:
            numbers.write_text(
                json.dumps(validation(bar, parsed.coarse), indent=1) + "\n", encoding="utf-8"
            )
    elif parsed.part == "properties":
        with ProgressBar("k(T), c(T)") as bar:
            results = properties(parsed.minutes, bar)
        copper.write_text(json.dumps(results) + "\n", encoding="utf-8")
    else:
        content = report.content_of(_made(numbers), _made(copper))
        print(report.write(content, _RESULTS if parsed.publish else parsed.out))


def _made(file: Path) -> Any:
    """Numbers that an earlier part of the study has written."""
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise InputError(
            f"{file}: not there or damaged; run the part {_PARTS[file.name]} first"
        ) from None
