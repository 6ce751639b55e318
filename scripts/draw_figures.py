#!/usr/bin/env python3
"""Draws figures of the documentation, from recorded numbers or short simulations.

usage: draw_figures.py [NAME ...]

Without a name: all, some minutes. Figures that need a study's long run are drawn by its command.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from _bootstrap import WORKSPACE, ensure

if __name__ == "__main__":
    ensure(extras=("history", "canister", "science"))

sys.path.append(str(WORKSPACE / "benchmarks"))

import concept_figures
import depth
import history
import solvers
from canister import figures as canisters
from realistic import report as realistic

from controller_comparison import command, figures
from fsw_analysis import phase_kpi
from fsw_analysis.figures import draw_whole_weld
from fsw_campaign.figures import ratios
from fsw_quality import monitor_figure
from fsw_quality.monitor import Monitor
from fsw_quality.monitor_run import watch
from fsw_scenario.scenario_file import load
from fsw_scenario.weld_programme import spans

RESULTS, FIGURES = WORKSPACE / "docs" / "results", WORKSPACE / "docs" / "figures"
DRIFT = WORKSPACE / "examples" / "drifting_thermocouple.yaml"


def _recorded(name: str) -> Any:
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))


def comparison() -> None:
    """``sweep``, ``fronts`` and ``sensors``, from a run's numbers (not committed)."""
    if not (RESULTS / "comparison.json").exists():
        print("comparison: scripts/compare_controllers.py --publish writes its numbers first")
        return
    command.draw(_recorded("comparison"), RESULTS)


def rival_solvers() -> None:
    """``solvers``, from the numbers of its page."""
    recorded = _recorded("solvers_tables")["tables"]
    tables = {title: [solvers.Row(**row) for row in rows] for title, rows in recorded.items()}
    solvers.draw(tables, RESULTS / "solvers.png")


def depth_sensors() -> None:
    """``depth``, from the numbers of its page."""
    depth.draw(_recorded("depth_tables")["accuracy"], RESULTS / "depth.png")


def realistic_welds() -> None:
    """``realistic``, from the numbers of its page."""
    realistic.draw(_recorded("realistic_tables"), RESULTS / "realistic.png")


def canister() -> None:
    """``canister``, from the numbers of its page."""
    canisters.draw(_recorded("canister_tables"), RESULTS / "canister.png")


def campaign() -> None:
    """``campaign_ratios``, from the numbers of its page."""
    recorded = _recorded("campaign_tables")
    first = recorded["figures of merit"][0][1]
    (RESULTS / "campaign_ratios.png").write_bytes(ratios(recorded["ratios"], first))


def corridors() -> None:
    """``corridors_fig6``: four welds."""
    figures.corridors(RESULTS)


def reference_tracking() -> None:
    """README's figure: two welds."""
    figures.set_point_steps(FIGURES / "reference_tracking.png")


def canister_weld() -> None:
    """Two whole welds."""
    runs = [concept_figures.weld("canister_weld", label) for label in ("decentral", "nmpc")]
    scenario = load("canister_weld")
    phases = phase_kpi.recorded_spans(runs[0].signals) or spans(
        scenario.phases, float(runs[0].signals.time_s[-1])
    )
    draw_whole_weld(runs, phases, "Whole weld (canister_weld)", FIGURES / "canister_weld.png")


def monitor() -> None:
    """A weld with a thermocouple that drifts."""
    watched = watch(Monitor("paper"), concept_figures.weld(DRIFT, "decentral").signals)
    monitor_figure.draw(watched, f"Monitor: {DRIFT.name}", FIGURES / "monitor.png")


def control_charts() -> None:
    """``history``: sixty short welds."""
    with tempfile.TemporaryDirectory() as folder:
        welds = [
            history.emulated(history.CONTROLLERS[0], Path(folder), seed) for seed in range(1, 61)
        ]
    history.draw(welds, history.FIGURE)


def known_heat() -> None:
    """``nmpc_known_heat``: the first minutes of five welds on canisters that conduct heat."""
    concept_figures.known_heat(FIGURES / "nmpc_known_heat.png")


def concepts() -> None:
    """``nmpc_plan``, ``nmpc_estimates`` and ``pi_tunings``: five welds."""
    concept_figures.nmpc_plan(FIGURES / "nmpc_plan.png")
    concept_figures.nmpc_estimates(FIGURES / "nmpc_estimates.png")
    concept_figures.pi_tunings(FIGURES / "pi_tunings.png")


DRAWN: tuple[Callable[[], None], ...] = (
    comparison,
    rival_solvers,
    depth_sensors,
    realistic_welds,
    canister,
    campaign,
    corridors,
    reference_tracking,
    canister_weld,
    monitor,
    control_charts,
    known_heat,
    concepts,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw; returns the exit code."""
    known = {function.__name__: function for function in DRAWN}
    cli = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    cli.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(known)}")
    parsed = cli.parse_args(arguments)
    if unknown := set(parsed.names) - set(known):
        cli.error(f"no figure {', '.join(sorted(unknown))}")
    for name in parsed.names or known:
        began = time.process_time()
        known[name]()
        print(f"{name:<20} {time.process_time() - began:6.1f} s CPU", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
