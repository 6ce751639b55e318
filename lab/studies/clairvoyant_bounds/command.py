"""The command of the study: the clairvoyant optimum of each standard event."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from clairvoyant_bounds.bounds import bounds
from fsw.console import print_table
from fsw_tuning.standard_cases import EVENTS


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    parser = argparse.ArgumentParser(
        description="Compute the smallest errors that a controller could have that knows all events."
    )
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help="also write them, with the fronts, as JSON"
    )
    parsed = parser.parse_args(arguments)
    found = bounds()
    rows = []
    for name, bound in found.items():
        figures = [f"{figure:.4g}" for figure in (bound["alone"], *bound["joint"])]
        rows.append([name, EVENTS[name].size, *figures, "" if bound["solved"] else "not solved"])
    print_table(rows, ("event", "size", "least IAE", "both: mm s", "degC s", ""), words=1)
    if parsed.json is not None:
        parsed.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return 0
