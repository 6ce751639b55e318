"""The command of the study.

Writes a page with tables (README.md), all numbers (comparison.json) and figures into the folder given by --out.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

from clairvoyant_bounds.bounds import bounds
from controller_comparison import figures, other_models, report, study
from controller_comparison.processes import SWEEP
from fsw_scenario.standard_cases import DECENTRALIZED
from fsw_scenario.sweep_figure import draw_sweep

WORKSPACE = Path(__file__).resolve().parents[2]


def publish(table: list[str]) -> None:
    """Put the table between its marks in the README, and draw the README's figure."""
    readme = WORKSPACE / "README.md"
    before, _, rest = readme.read_text(encoding="utf-8").partition("<!-- results -->\n")
    _, end, after = rest.partition("<!-- results: end -->")
    readme.write_text("\n".join([f"{before}<!-- results -->", *table[:-1], f"{end}{after}"]), encoding="utf-8")
    figures.set_point_steps(WORKSPACE / "docs" / "figures" / "reference_tracking.png")


def main() -> int:
    """Run the script; returns the exit code."""
    parser = argparse.ArgumentParser(
        description="Compare the NMPC with the decentralized controller, the paper's tuning and what is possible."
    )
    parser.add_argument("--quick", action="store_true", help="a small part, in less than a minute")
    parser.add_argument("--out", type=Path, default=Path("out/comparison"), help="folder for the results")
    parser.add_argument("--plants", type=int, default=500, help="random plants (default 500)")
    parser.add_argument("--models", type=int, default=0, metavar="N", help="also N other models, some minutes each")
    parser.add_argument("--publish", action="store_true", help="into docs/results, and README's table and figure")
    arguments = parser.parse_args()
    if arguments.publish and arguments.quick:
        parser.error("--publish needs the whole comparison, without --quick")
    if arguments.publish:
        arguments.out = WORKSPACE / "docs" / "results"
    if arguments.plants < 1:
        parser.error(f"--plants is {arguments.plants}: must be at least 1")
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    began, shown_s = time.monotonic(), -1.0

    def progress(what: str) -> None:
        nonlocal shown_s
        elapsed_s = time.monotonic() - began
        if elapsed_s - shown_s > 1.0:
            shown_s = elapsed_s
            print(f"[{elapsed_s:5.0f} s] {what}", file=sys.stderr, flush=True)

    plants = {name: SWEEP[name] for name in ("nominal", "dead time 3.8 s")} if arguments.quick else SWEEP
    data = {"nominal": study.nominal(progress), "sweep": study.sweep(progress, plants)}
    figures.papers(out)
    figures.corridors(out)
    draw_sweep(data["sweep"], out / "sweep.png")
    if not arguments.quick:
        data["bounds"] = bounds(progress)
        figures.fronts(data["bounds"], data["nominal"], out / "fronts.png")
        data["margins"] = study.margins(progress)
        data["aggressiveness"] = study.aggressiveness(progress)
        data["wins"] = study.wins(progress)
        data["random"] = study.random_plants(progress, arguments.plants)
        figures.random_plants(data["random"], out / "random_plants.png")
        if arguments.publish:
            publish(report.summary(data["nominal"], data["bounds"]))
    models = out / "other_models.json"
    if arguments.models > 0:
        models.write_text(json.dumps(other_models.study(progress, arguments.models), indent=1) + "\n", encoding="utf-8")
    if models.exists() and not arguments.quick:
        data["other_models"] = json.loads(models.read_text(encoding="utf-8"))
    (out / "README.md").write_text(report.page(data), encoding="utf-8")
    if "random" in data:  # the figure and the page show no more of them
        data["random"] = study.ratios(data["random"], DECENTRALIZED)
    (out / "comparison.json").write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    print(f"{out / 'README.md'}: {time.monotonic() - began:.0f} s")
    return 0
