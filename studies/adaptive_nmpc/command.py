"""The command of the study: writes the page, its figure and all numbers (adaptive.json)."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from adaptive_nmpc import report, study

_RESULTS = Path(__file__).resolve().parents[2] / "docs" / "results"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    parser = argparse.ArgumentParser(description="Measure the NMPC's preset adaptive, and write the page of results.")
    parser.add_argument("--out", type=Path, default=Path("out/adaptive"), help="folder (default %(default)s)")
    parser.add_argument("--plants", type=int, default=100, help="random plants (default %(default)s)")
    parser.add_argument("--page", action="store_true", help="only the page again, from the numbers of the last run")
    parser.add_argument("--publish", action="store_true", help="write the page into docs/results")
    parsed = parser.parse_args(arguments)
    folder = _RESULTS if parsed.publish else parsed.out
    parsed.out.mkdir(parents=True, exist_ok=True)
    numbers = parsed.out / "adaptive.json"
    welds = study.saturated_welds()
    if not parsed.page:
        data = {"random": study.random_plants(parsed.plants), "nominal": study.nominal()}
        data["saturated"] = study.saturated(welds)
        numbers.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    report.draw(welds, folder / "adaptive_priority.png")
    (folder / "adaptive.md").write_text(report.page(json.loads(numbers.read_text(encoding="utf-8"))), encoding="utf-8")
    print(folder / "adaptive.md")
    return 0
