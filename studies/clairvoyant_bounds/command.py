"""The command of the study: the clairvoyant optimum of each standard event."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from clairvoyant_bounds.bounds import bounds
from fsw_scenario.standard_events import EVENTS


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    parser = argparse.ArgumentParser(description="Compute the errors that no controller can go below.")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write them, with the fronts, as JSON")
    parsed = parser.parse_args(arguments)
    found = bounds(lambda text: print(text, file=sys.stderr, flush=True))
    print(f"{'event':10}{'size':>10}{'least IAE':>12}{'both: mm s':>12}{'degC s':>10}")
    for name, bound in found.items():
        depth, temperature = bound["joint"]
        row = f"{name:10}{EVENTS[name].size:>10}{bound['alone']:12.4g}{depth:12.4g}{temperature:10.4g}"
        print(row if bound["solved"] else f"{row}  not solved")
    if parsed.json is not None:
        parsed.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return 0
