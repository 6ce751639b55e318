"""Coloured noise and a thermocouple that lags.

What they do to controllers that know of neither.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from controller_comparison.processes import RANDOM_SENSING, REST, SENSING
from controller_comparison.study import CONTROLLERS, LATENCY, VARIATIONS, entrants, random_plants
from fsw.console import ProgressBar
from fsw_tuning.margins import Loops
from fsw_tuning.standard_cases import CASES
from fsw_tuning.standard_runs import JUDGED, Figures, Job, on_all_cores, run_all

#: Of the noise, over which a mean is taken: coloured noise has fewer independent samples in a
#: weld.
_SEEDS = (1, 2)
LAGS = ("white, no lag", "lag 1 s", "lag 3 s")
_ERRORS = ("iae_depth_mm_s", "iae_temperature_c_s")
Entrants = Mapping[str, tuple[str, Mapping[str, float]]]


def study(slower: float, plants: int) -> dict[str, Any]:
    """All parts; the NMPC at matched margin is slowed by this factor."""
    compared = entrants(CONTROLLERS, slower)
    return {
        "runs": runs(compared),
        "margins": margins(compared),
        "random": random_plants(plants, RANDOM_SENSING),
    }


def runs(compared: Entrants) -> dict[str, dict[str, Figures]]:
    """Means over seeds of every controller with every kind of sensors, and a tick of latency.

    Judged figures of merit, mean absolute errors [µm, m°C] and movement [kN/s, rpm/s] at rest, and
    in how many welds an output oscillates for good.
    """
    jobs = {
        (kind, name, case, seed): Job(
            label, case, True, {**LATENCY, **plant, "seed": seed}, parameters
        )
        for kind, plant in SENSING.items()
        for name, (label, parameters) in compared.items()
        for case in (*CASES, REST)
        for seed in _SEEDS
    }
    with ProgressBar("noise and lag of the sensors") as bar:
        results = run_all(list(jobs.values()), bar)
    return {
        kind: {
            name: _means(
                {
                    case: [results[jobs[kind, name, case, seed]] for seed in _SEEDS]
                    for case in (*CASES, REST)
                }
            )
            for name in compared
        }
        for kind in SENSING
    }


def _means(by_case: Mapping[str, Sequence[Figures]]) -> Figures:
    def mean(case: str, key: str) -> float:
        return float(np.mean([run[key] for run in by_case[case]]))

    rest = {key: mean(REST, key) / mean(REST, "duration_s") for key in VARIATIONS}
    rest |= {f"rest {key}": 1e3 * mean(REST, key) / mean(REST, "duration_s") for key in _ERRORS}
    swings = sum(run["swings"] for case in CASES for run in by_case[case])
    return {key: mean(*key.split()) for key in JUDGED} | rest | {"swings": swings}


def margins(compared: Entrants) -> dict[str, dict[str, dict[str, float]]]:
    """Gain and delay margin of the temperature, by lag of the probe and controller.

    Without ``nmpc:paper``, which would take minutes.
    """
    judged = {name: of for name, of in compared.items() if name != "nmpc:paper"}
    tasks = [
        (label, parameters, SENSING[lag]) for lag in LAGS for label, parameters in judged.values()
    ]
    results = iter(list(on_all_cores(_margins, tasks)))
    return {lag: {name: next(results) for name in judged} for lag in LAGS}


def _margins(task: tuple[str, Mapping[str, float], Mapping[str, float]]) -> dict[str, float]:
    label, parameters, plant = task
    return Loops(label, parameters, plant=plant).temperature()
