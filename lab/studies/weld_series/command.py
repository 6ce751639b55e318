"""Welds the series, and reports which of the planted changes its history found."""

from __future__ import annotations

import argparse
import os
import sys
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import yaml

from fsw_control.schema.models import InputError
from fsw_plant import PlantConfig
from fsw_plant.process import prepare
from fsw_quality import history, history_report
from fsw_quality.history_report import Kind, Remark
from fsw_recorder.errors import BagError
from fsw_scenario.scenario_file import parse
from fsw_tuning.standard_runs import on_all_cores
from weld_series.series import (
    BEGIN_DEG,
    SPECIAL,
    WHOLE_DEG,
    judged,
    scenario_text,
    series_procedure,
)

#: which of the history's remarks shows each planted thing: what is special about the weld, kind,
#: and what it is about
PLANTED = {
    "the tool wears": (None, Kind.CHART, "torque_nm"),
    "a thermocouple drifts": ("thermocouple", Kind.ALARM, "thermocouple"),
    "a swap of controllers": ("swap", Kind.SWAP, ""),
    "an operator's error": ("operator", Kind.OPERATOR, ""),
}

#: welds after which the wear stands out
_SHOWS_WEAR = 30


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the series; the exit code is 0 if the history found everything."""
    parser = argparse.ArgumentParser(
        prog="weld_series.py",
        description="Weld a series of canisters: bags, records, history. "
        "An interrupted series is continued.",
    )
    parser.add_argument("--welds", type=int, default=60, help="number of canisters (default 60)")
    parser.add_argument(
        "--workers",
        type=int,
        default=os.cpu_count(),
        help="processes (default: one per core)",
    )
    parser.add_argument("--out", type=Path, default=Path("out") / "weld_series", help="folder")
    text = (
        f"length of the joint line in deg (default {WHOLE_DEG - BEGIN_DEG:g}: whole welds, 45 min)"
    )
    parser.add_argument(
        "--joint-line", type=float, default=WHOLE_DEG - BEGIN_DEG, help=text, metavar="DEG"
    )
    chosen = parser.parse_args(arguments)
    folder: Path = chosen.out
    try:
        end_deg = _end_deg(folder, chosen.joint_line)
        rows = _weld(folder, chosen.welds, chosen.workers, end_deg)
        table = history.load(folder / "history")
        remarks = history_report.write(table, folder / "report.html", "Series of canisters")
    except (InputError, BagError, OSError) as error:
        print(f"weld_series: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nweld_series: interrupted; the same command continues", file=sys.stderr)
        return 130
    print(f"verdicts: {dict(Counter(row['verdict'] for row in rows))}")
    for tool in history_report.tools(table):
        print(f"tool {tool.tool}, {tool.welds} welds: {tool.words}")
    missed = _tell(remarks, table["weld"].to_pylist(), chosen.welds)
    print(
        f"written: {', '.join(str(folder / name) for name in ('report.html', 'history', 'welds'))}"
    )
    return 1 if missed else 0


def _end_deg(folder: Path, joint_line_deg: float) -> float:
    """Where the joint line ends; the procedure of a series that was begun is kept."""
    if not 10.0 <= joint_line_deg <= WHOLE_DEG - BEGIN_DEG:
        raise InputError(
            f"--joint-line {joint_line_deg:g}: give 10 to {WHOLE_DEG - BEGIN_DEG:g} deg"
        )
    folder.mkdir(parents=True, exist_ok=True)
    end_deg, note = BEGIN_DEG + joint_line_deg, folder / "procedure.yaml"
    text = yaml.safe_dump(series_procedure(end_deg).model_dump(mode="json", exclude_none=True))
    if not note.exists():
        if any(folder.iterdir()):
            raise InputError(
                f"{folder} is not empty, and no series was begun in it; choose another --out"
            )
        note.write_text(text, encoding="utf-8")
    if note.read_text(encoding="utf-8") != text:
        raise InputError(
            f"{folder}: was begun with another procedure or joint line; choose another --out"
        )
    return end_deg


def _weld(folder: Path, welds: int, workers: int, end_deg: float) -> list[history.Row]:
    """Weld what is missing, and add each to the history in its order."""
    there = (
        history.load(folder / "history")["weld"].to_pylist()
        if (folder / "history").is_dir()
        else []
    )
    print("heat conduction in the canister (once; half a minute) ...", file=sys.stderr, flush=True)
    prepare(PlantConfig.from_values(parse(scenario_text(1, end_deg), "series").plant))
    rows = []
    made = partial(judged, folder=folder, end_deg=end_deg)
    for row in on_all_cores(made, range(1, welds + 1), workers=workers):
        rows.append(row)
        if row["weld"] not in there:
            history.add(folder / "history", [row])
        print(f"\r{len(rows)} of {welds} welds", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return rows


def _tell(remarks: Sequence[Remark], names: Sequence[str], welds: int) -> int:
    """Print which planted changes the history found; returns the number of missed ones."""
    missed = 0
    if welds < _SHOWS_WEAR:
        print(f"the tool wears: {_SHOWS_WEAR} welds are needed to detect it")
    for what, (special, kind, subject) in PLANTED.items():
        number = next((weld for weld, planted in SPECIAL.items() if planted == special), None)
        if (number or _SHOWS_WEAR) > welds:
            continue
        name = None if number is None else f"C{number:03d}"
        shown = [
            f"{names[remark.at]}: {remark.text}"
            for remark in remarks
            if remark.kind is kind
            and subject in remark.subject
            and name in (None, names[remark.at])
        ]
        missed += not shown
        print(f"{what}: {shown[0] if shown else 'NOT FOUND'}")
    return missed


if __name__ == "__main__":
    sys.exit(main())
