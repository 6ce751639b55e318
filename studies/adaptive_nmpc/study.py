"""The parts of the study: each gives plain data, ready for JSON."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from controller_comparison.processes import REST, random_factors
from controller_comparison.study import KPIS, VARIATIONS
from fsw.progress import ProgressBar
from fsw_analysis.weld_signals import WeldSignals
from fsw_scenario.standard_cases import CASES, CONSERVATIVE, DEFAULT, SMITH, TIGHT
from fsw_scenario.standard_runs import Figures, Job, failed, run_all, weld

ADAPTIVE = "nmpc:adaptive"
#: The same tuning with the model's gain and dead time of the power.
FIXED = "nmpc:adaptive, not adapting"
RIVALS = (CONSERVATIVE, TIGHT)
COLUMNS = (*RIVALS, SMITH, DEFAULT, FIXED, ADAPTIVE)
#: Random plants of other seeds than this served to choose the preset's values.
SEED = 31415
#: Process on which the greater depth and the temperature need nearly all of the speed.
WEAK = {"model.sliding_friction": 0.85, "model.sticking_stress_pa": 0.85}
#: Set-points go down by 0.2 mm here.
SATURATED = str(Path(__file__).parent / "saturated.yaml")
#: What the figure compares where the speed is at its bound.
PRIORITIES = {
    TIGHT: (TIGHT, {}),
    DEFAULT: (DEFAULT, {}),
    **{f"{ADAPTIVE}, priority {name}": (ADAPTIVE, {"priority": name}) for name in ("depth", "balance", "temperature")},
}


@contextmanager
def controllers() -> Iterator[dict[str, tuple[str, dict[str, Any]]]]:
    """Label and parameters of every column; a tuning file of one of them exists as long as the context."""
    with TemporaryDirectory() as scratch:
        file = Path(scratch) / "not_adapting.yaml"
        file.write_text("estimator: {thermal_gain_walk: 0.0, delay_walk_s: 0.0}\n", encoding="utf-8")
        yield {name: (name, {}) for name in COLUMNS} | {FIXED: (ADAPTIVE, {"tuning_file": str(file)})}


def random_plants(first: int, count: int) -> dict[str, dict[str, Figures]]:
    """All figures of merit of every column on random plants from ``first`` up to ``count``, with noise."""
    plants = dict(enumerate(random_factors(count, seed=SEED)[first:], start=first))
    with controllers() as made, ProgressBar(f"random plants {first + 1} to {count}") as bar:
        jobs = {
            (i, column, case): Job(label, case, True, plant, parameters)
            for i, plant in plants.items()
            for column, (label, parameters) in made.items()
            for case in CASES
        }
        found = run_all(list(jobs.values()), bar)
    return {
        f"{i}": {column: figures({case: found[jobs[i, column, case]] for case in CASES}) for column in COLUMNS}
        for i in plants
    }


def figures(runs: Mapping[str, Figures]) -> Figures:
    """The figures of merit of a controller's cases, and whether an output oscillates; or the error of one case."""
    for run in runs.values():
        if "error" in run:
            return {"error": run["error"]}
    found = {f"{case} {key}": run[key] for case, run in runs.items() for key in KPIS if run.get(key) is not None}
    return found | {"swings": any(run["swings"] for run in runs.values())}


def nominal() -> dict[str, dict[str, Any]]:
    """Default and adaptive on the model's own process: events without noise; with noise, at rest."""
    both = (DEFAULT, ADAPTIVE)
    jobs = {(label, case): Job(label, case) for label in both for case in CASES}
    jobs |= {(label, REST): Job(label, REST, True) for label in both}
    found = run_all(list(jobs.values()))
    data: dict[str, dict[str, Any]] = {}
    for label in both:
        events: dict[str, Any] = {}
        for case, names in CASES.items():
            events |= dict(zip(names, found[jobs[label, case]]["events"], strict=True))
        rest = found[jobs[label, REST]]
        data[label] = {"events": events, "rest": {key: rest[key] / rest["duration_s"] for key in VARIATIONS}}
    return data


def saturated_welds() -> dict[str, WeldSignals]:
    """The step of the depth where the speed is at its bound, without noise, by controller and priority."""
    return {
        name: weld(Job(label, SATURATED, plant=WEAK, parameters=values)) for name, (label, values) in PRIORITIES.items()
    }


def saturated(welds: Mapping[str, WeldSignals]) -> dict[str, dict[str, float]]:
    """IAE and largest error of both outputs in such a weld."""
    data = {}
    for name, signals in welds.items():
        truth = signals.truth
        assert truth is not None  # a simulation has it
        depth = np.abs(truth.depth_mm - signals.reference_depth_mm)
        temperature = np.abs(truth.temperature_c - signals.reference_temperature_c)
        data[name] = {
            "iae_depth_mm_s": 0.1 * float(depth.sum()),
            "iae_temperature_c_s": 0.1 * float(temperature.sum()),
            "peak_temperature_error_c": float(temperature.max()),
        }
    return data


def ran(data: Mapping[str, Mapping[str, Figures]]) -> list[Mapping[str, Figures]]:
    """The plants that could be run with every controller."""
    return [runs for runs in data.values() if not failed(runs)]
