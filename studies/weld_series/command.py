"""Welds the series, and tells what its history found of what was planted."""

from __future__ import annotations

import argparse
import os
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from fsw_plant import PlantConfig
from fsw_plant.process import prepare
from fsw_quality import history, history_report
from fsw_scenario.scenario_file import parse
from fsw_schema.models import InputError
from weld_series.series import SPECIAL, judged, scenario_text

#: what of the history's remarks tells each planted thing: weld, words
PLANTED = {
    "the tool wears": (None, ("chart of torque at equal conditions",)),
    "a thermocouple drifts": ("thermocouple", ("thermocouple",)),
    "a swap of controllers": ("swap", ("swap(s)",)),
    "an operator's error": ("operator", ("operator acted",)),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the series; the exit code is 0 if the history found everything."""
    parser = argparse.ArgumentParser(
        prog="weld_series.py", description="Weld a series of canisters, and their history."
    )
    parser.add_argument("--welds", type=int, default=60, help="number of canisters (default 60)")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes (default: one per core)")
    parser.add_argument("--out", type=Path, default=Path("out") / "weld_series", help="folder, new or empty")
    chosen = parser.parse_args(arguments)
    folder: Path = chosen.out
    if folder.exists() and any(folder.iterdir()):
        print(f"weld_series: {folder} is not empty; choose another --out", file=sys.stderr)
        return 1
    try:
        print("heat conduction in the canister (once; half a minute) ...", file=sys.stderr, flush=True)
        prepare(PlantConfig.from_values(parse(scenario_text(1), "series").plant))
        rows = []
        with ProcessPoolExecutor(max(1, chosen.workers)) as pool:
            for row in pool.map(partial(judged, folder=folder), range(1, chosen.welds + 1)):
                rows.append(row)
                print(f"\r{len(rows)} of {chosen.welds} welds", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
        history.add(folder / "history", rows)
        table = history.load(folder / "history")
        said = history_report.write(table, folder / "report.html", "Series of canisters")
    except (InputError, OSError) as error:
        print(f"weld_series: {error}", file=sys.stderr)
        return 1
    print(f"verdicts: {dict(Counter(row['verdict'] for row in rows))}")
    for one in history_report.tools(table):
        print(f"tool {one.tool}, {one.welds} welds: {one.words}")
    missed = _tell(said, chosen.welds)
    print(f"written: {folder / 'report.html'}, {folder / 'history'}, {folder / 'records'}")
    return 1 if missed else 0


def _tell(said: Sequence[tuple[str, str]], welds: int) -> int:
    """Print what the history found of what was planted; returns how much it did not."""
    missed = 0
    for what, (special, words) in PLANTED.items():
        number = next((one for one, kind in SPECIAL.items() if kind == special), None)
        if number is not None and number > welds:
            continue
        name = None if number is None else f"C{number:03d}"
        found = [
            f"{weld}: {text}" for weld, text in said if name in (None, weld) and any(word in text for word in words)
        ]
        missed += not found
        print(f"{what}: {found[0] if found else 'NOT FOUND'}")
    return missed


if __name__ == "__main__":
    sys.exit(main())
