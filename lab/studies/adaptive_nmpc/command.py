"""The command of the study: writes the page, its figure and all numbers (adaptive.json)."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from adaptive_nmpc import report, search, study
from fsw_analysis.report import numbers as in_lines
from fsw_campaign.software import versions

#: random plants between two writings of the numbers
_AT_ONCE = 20
_RESULTS = Path(__file__).resolve().parents[3] / "docs" / "results"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    parser = argparse.ArgumentParser(
        description="Measure the NMPC's preset adaptive, and write the page of results."
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/adaptive"), help="folder (default %(default)s)"
    )
    parser.add_argument(
        "--plants", type=int, default=100, help="random plants (default %(default)s)"
    )
    parser.add_argument(
        "--page", action="store_true", help="only the page again, from the numbers of the last run"
    )
    parser.add_argument(
        "--fresh",
        action="store_true",
        help="all random plants again; else those of the last run stay",
    )
    parser.add_argument("--publish", action="store_true", help="write the page into docs/results")
    parsed = parser.parse_args(arguments)
    folder = _RESULTS if parsed.publish else parsed.out
    parsed.out.mkdir(parents=True, exist_ok=True)
    numbers = parsed.out / "adaptive.json"
    welds = study.saturated_welds()
    data: dict[str, Any] = (
        json.loads(numbers.read_text(encoding="utf-8")) if numbers.exists() else {}
    )
    if not parsed.page:
        # rows of another version of the software do not count
        if parsed.fresh or data.get("software") != versions():
            data = {"software": versions(), "random": {}}
        parts: dict[str, Callable[[], Any]] = {
            **{
                "nominal": study.nominal,
                "saturated": lambda: study.saturated(welds),
                "drifts": study.drifts,
            },
            "inside": lambda: study.inside_limits(parsed.out / study.CAMPAIGN),
            **{
                "margins": study.robustness,
                "noise": study.noise,
                "late": study.late,
                "search": search.searched,
            },
        }
        for name, part in parts.items():
            if name not in data:
                data[name] = part()
                numbers.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
        # kept in parts, so that an interrupted run can be continued
        while (first := len(data["random"])) < parsed.plants:
            data["random"] |= study.random_plants(first, min(first + _AT_ONCE, parsed.plants))
            numbers.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    report.draw(welds, folder / "adaptive_priority.png")
    content = report.content(data)
    (folder / "adaptive_tables.json").write_text(in_lines(content), encoding="utf-8")
    (folder / "adaptive.md").write_text(report.page(content), encoding="utf-8")
    print(folder / "adaptive.md")
    return 0
