"""The command of the study.

Writes pages, what they show (comparison_tables.json), figures and all numbers (comparison.json,
not committed) into the folder given by --out, or into docs/results with --publish.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

from controller_comparison import figures, report, sensing, study
from controller_comparison.optimum import bounds
from controller_comparison.processes import SWEEP
from fsw_analysis.report import numbers as in_lines
from fsw_tuning.standard_runs import draw_sweep

WORKSPACE = Path(__file__).resolve().parents[3]


def compare(plants: int) -> dict[str, Any]:
    """All parts but other models."""
    data = {"nominal": study.nominal(), "sweep": study.sweep(SWEEP), "bounds": bounds()}
    data |= {
        "margins": study.margins(),
        "aggressiveness": study.aggressiveness(),
        "wins": study.wins(),
    }
    data |= {
        "matched": study.matched(),
        "below_noise": study.below_noise(),
        "corridors": study.corridors(),
    }
    data["random"] = study.random_plants(plants)
    data["sensing"] = sensing.study(data["matched"]["slower"], max(1, plants // 5))
    return data


def draw(data: dict[str, Any], folder: Path) -> None:
    """Draw the figures that the numbers of a run are enough for."""
    draw_sweep(data["sweep"], folder / "sweep.png")
    if "bounds" in data:
        figures.fronts(data["bounds"], data["nominal"], folder / "fronts.png")
        figures.sensors(data["sensing"]["runs"], folder / "sensors.png")


def main() -> int:
    """Run the script; returns the exit code."""
    parser = argparse.ArgumentParser(
        description="Compare the NMPC with the decentralized controller, "
        "the paper's tuning and what is possible."
    )
    parser.add_argument("--quick", action="store_true", help="a small part, in less than a minute")
    parser.add_argument(
        "--out", type=Path, default=Path("out/comparison"), help="folder for the results"
    )
    parser.add_argument("--plants", type=int, default=500, help="random plants (default 500)")
    parser.add_argument(
        "--models", type=int, default=0, metavar="N", help="also N other models, some minutes each"
    )
    parser.add_argument(
        "--publish", action="store_true", help="into docs/results, and README's figure"
    )
    parser.add_argument(
        "--page",
        action="store_true",
        help="only the pages again, and their figures where the numbers of a run are there",
    )
    arguments = parser.parse_args()
    if arguments.publish and arguments.quick:
        parser.error("--publish needs the whole comparison, without --quick")
    out: Path = WORKSPACE / "docs" / "results" if arguments.publish else arguments.out
    out.mkdir(parents=True, exist_ok=True)
    numbers, shown_file = out / "comparison.json", out / "comparison_tables.json"
    began = time.monotonic()
    if not arguments.page:
        numbers.write_text(in_lines(measure(out, arguments)), encoding="utf-8")
    models = out / "other_models.json"
    if arguments.models > 0 and not arguments.page:
        models.write_text(in_lines(study.other_models(arguments.models)), encoding="utf-8")
    if numbers.exists():
        data = json.loads(numbers.read_text(encoding="utf-8"))
        draw(data, out)
        shown_file.write_text(in_lines(report.tables(data)), encoding="utf-8")
    if not shown_file.exists():
        parser.error(f"{out} has no numbers of a run; run it without --page first")
    shown = json.loads(shown_file.read_text(encoding="utf-8"))
    if models.exists() and not arguments.quick:
        shown["other_models"] = json.loads(models.read_text(encoding="utf-8"))
    for name, text in report.pages(shown).items():
        (out / name).write_text(text, encoding="utf-8")
    print(f"{out}: {time.monotonic() - began:.0f} s")
    return 0


def measure(out: Path, arguments: argparse.Namespace) -> dict[str, Any]:
    """Run the parts asked for, and draw the figures of welds; returns all numbers."""
    if arguments.quick:
        plants = {name: SWEEP[name] for name in ("nominal", "dead time 3.8 s")}
        data = {"nominal": study.nominal(), "sweep": study.sweep(plants)}
    else:
        data = compare(arguments.plants)
    figures.corridors(out)
    if arguments.publish:
        figures.set_point_steps(WORKSPACE / "docs" / "figures" / "reference_tracking.png")
    return data
