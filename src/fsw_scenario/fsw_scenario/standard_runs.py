"""Runs of one controller on one case, many at a time, and the figures that they are judged by."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from fsw_analysis.kpi import compute
from fsw_analysis.kpi_table import ROWS
from fsw_analysis.weld_signals import TruthSignals, WeldSignals
from fsw_control.contract import Controller
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make, name_of
from fsw_scenario.standard_cases import scenario

#: Figures of merit that are compared, by their key in ``fsw_analysis.kpi``, with their titles.
KPIS = {
    key: f"{meaning} [{unit}]".replace("deg", "°").replace("^2", "²").replace("[um]", "[µm]")
    for key, (meaning, unit, _) in ROWS.items()
    if key.startswith(("iae", "ise", "peak", "total_variation"))
}
VARIATIONS = tuple(key for key in KPIS if key.startswith("total_variation"))
#: An output still swings when, over the last `_LAST` ticks, it moves by more than this.
_SWINGS_MM, _SWINGS_C, _LAST = 0.01, 1.0, 150
#: The four figures that other processes are judged by: case and KPI, and what they mean.
JUDGED = {
    "tracking iae_depth_mm_s": "set-points, depth",
    "tracking iae_temperature_c_s": "set-points, temperature",
    "disturbances iae_depth_mm_s": "disturbances, depth",
    "disturbances iae_temperature_c_s": "disturbances, temperature",
}

Figures = dict[str, Any]


@dataclass(frozen=True)
class Job:
    """One controller (with its variant, e.g. ``nmpc:paper``) on one case, with parameters of plant and controller."""

    controller: str
    case: str
    noise: bool = False
    plant: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def __hash__(self) -> int:
        return hash((self.controller, self.case, self.noise, *self.plant.items(), *self.parameters.items()))

    def __str__(self) -> str:
        return f"{self.controller}, {self.case}{', noise' if self.noise else ''}"


@cache
def _controller(label: str, *parameters: tuple[str, Any]) -> Controller:
    return make(label, dict(parameters))


def loop_of(job: Job) -> ClosedLoop:
    """Controller and plant of a job, ready to run."""
    name = name_of(job.controller)
    made = scenario(job.case, {"noise": job.noise, **job.plant}, name)
    return ClosedLoop(made, {name: _controller(job.controller, *job.parameters.items())})


def weld(job: Job) -> WeldSignals:
    """Run a job and return all signals."""
    return loop_of(job).run()


def figures(job: Job) -> Figures:
    """Run a job and return its figures of merit, with the swing that remains at the end."""
    signals = weld(job)
    found = compute(signals, job.controller)
    truth = _truth(signals)
    depth = (truth.depth_mm - signals.reference_depth_mm)[-_LAST:]
    temperature = (truth.temperature_c - signals.reference_temperature_c)[-_LAST:]
    found["swings"] = bool(np.ptp(depth) > _SWINGS_MM or np.ptp(temperature) > _SWINGS_C)
    return found


def _truth(signals: WeldSignals) -> TruthSignals:
    assert signals.truth is not None  # a simulation has it
    return signals.truth


def _figures_or_error(job: Job) -> Figures:
    try:
        return figures(job)
    except ValueError as error:
        return {"error": str(error)}


def run_all(jobs: Sequence[Job], progress: Callable[[str], None]) -> dict[Job, Figures]:
    """Run jobs on all cores; a plant that cannot be run gives ``{"error": text}``."""
    results = {}
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        worth_it = len(jobs) >= 8
        work = pool.map(_figures_or_error, jobs, chunksize=4) if worth_it else map(_figures_or_error, jobs)
        for job, found in zip(jobs, work, strict=True):
            progress(str(job))
            results[job] = found
    return results


def judged(runs: Mapping[str, Figures]) -> Figures:
    """The judged figures of a controller's runs, their total variations, and whether something still swings."""
    for run in runs.values():
        if "error" in run:
            return {"error": run["error"]}
    keys = ("iae_depth_mm_s", "iae_temperature_c_s", *VARIATIONS)
    found: Figures = {f"{case} {key}": run[key] for case, run in runs.items() for key in keys}
    return found | {"swings": any(run["swings"] for run in runs.values())}


def failed(runs: Mapping[str, Figures]) -> str | None:
    """Why a process could not be run with every controller, or None."""
    return next((run["error"] for run in runs.values() if "error" in run), None)
