"""A search for plants on which adapting does harm: random ones, then variations of the worst."""

from __future__ import annotations

import random
from collections.abc import Iterable, Mapping, Sequence
from math import exp, log
from typing import Any

from adaptive_nmpc.study import ADAPTIVE, FIXED, controllers, errors
from controller_comparison.processes import CORRELATIONS
from fsw.console import ProgressBar
from fsw_model import nominal as nominal_parameters
from fsw_tuning.standard_cases import CASES
from fsw_tuning.standard_runs import Job, on_all_cores, weld

_DEAD_S = nominal_parameters().dead_time_s
#: What is drawn: uniformly, and factors in their logarithm.
UNIFORM = {
    "factors.dead_time_s": (1.0 - 1.0 / _DEAD_S, 1.0 + 4.0 / _DEAD_S),
    "sensors.temperature_lag_s": (0.0, 3.0),
    **dict.fromkeys(CORRELATIONS, (0.0, 5.0)),
}
FACTORS = {
    "factors.thermal_gain_c_per_kw": (0.5, 2.0),
    "factors.copper_lag_s": (0.5, 2.0),
    "factors.tool_lag_s": (0.5, 2.0),
    "factors.depth_gain_mm_per_kn_s": (0.7, 1.4),
    "factors.sliding_friction": (0.9, 1.1),
    "factors.softening_per_c": (0.5, 2.0),
}
#: Share of the plants on which the probe has no lag, and of those on which the noise is white.
_AS_IN_MODEL = 0.5
#: Random plants; then rounds, each with so many variations of so many of the worst plants, by so
#: much of the ranges.
FIRST, ROUNDS, WORST, VARIATIONS, VARIED = 60, 2, 6, 2, 0.15
#: A step is 10 degC: with a larger error than this a process is one on which the tuning itself
#: swings.
STEADY_C = 12.0
#: By this a plant is the worst.
JUDGED_BY = "iae_temperature_c_s"
SEED = 27182
Plant = dict[str, float]


def drawn(generator: random.Random) -> Plant:
    """A random plant."""
    plant = {name: generator.uniform(*span) for name, span in UNIFORM.items()}
    plant |= {
        name: exp(generator.uniform(log(low), log(high))) for name, (low, high) in FACTORS.items()
    }
    for group in ("temperature_lag_s", "correlation_s"):
        if generator.random() < _AS_IN_MODEL:
            plant |= {name: 0.0 for name in plant if name.endswith(group)}
    return plant | {"seed": generator.randrange(1, 2**31)}


def varied(plant: Plant, generator: random.Random) -> Plant:
    """A plant near another one, inside the ranges."""
    near = dict(plant)
    for name, (low, high) in UNIFORM.items():
        if plant[name]:  # what is as in the model stays so
            near[name] = min(
                max(plant[name] + generator.gauss(0.0, VARIED) * (high - low), low), high
            )
    for name, (low, high) in FACTORS.items():
        factor = exp(generator.gauss(0.0, VARIED) * log(high / low))
        near[name] = min(max(plant[name] * factor, low), high)
    return near | {"seed": generator.randrange(1, 2**31)}


def errors_of(job: Job) -> dict[str, float]:
    """Errors of both outputs in a weld."""
    return errors(weld(job))


def measured(plants: Sequence[Plant], title: str) -> list[dict[str, Any]]:
    """Errors with and without adaptation in both cases, with noise, plant by plant."""
    columns = (FIXED, ADAPTIVE)
    with controllers() as made, ProgressBar(title) as bar:
        keys = [
            (plant, case, column)
            for plant in range(len(plants))
            for case in CASES
            for column in columns
        ]
        jobs = [
            Job(made[column][0], case, True, plants[i], made[column][1])
            for i, case, column in keys
        ]
        rows: list[dict[str, Any]] = [
            {"plant": plant, **{case: {} for case in CASES}} for plant in plants
        ]
        for done, ((i, case, column), errors) in enumerate(
            zip(keys, on_all_cores(errors_of, jobs, chunksize=4), strict=True)
        ):
            rows[i][case][column] = errors
            bar((done + 1) / len(jobs))
    return rows


def is_steady(row: Mapping[str, Any]) -> bool:
    """Whether the tuning without adaptation does not swing itself."""
    return all(row[case][FIXED]["peak_temperature_error_c"] < STEADY_C for case in CASES)


def ratio(row: Mapping[str, Any], key: str, cases: Iterable[str] = CASES) -> float:
    """The largest of the cases' ratios of a figure, with over without adaptation."""
    return max(float(row[case][ADAPTIVE][key] / row[case][FIXED][key]) for case in cases)


def searched() -> list[list[dict[str, Any]]]:
    """Rounds of plants with their errors: random ones, then those near the worst of all before."""
    generator = random.Random(SEED)
    rounds = [measured([drawn(generator) for _ in range(FIRST)], "search: random plants")]
    for number in range(ROUNDS):
        known = [row for rows in rounds for row in rows if is_steady(row)]
        worst = sorted(known, key=lambda row: ratio(row, JUDGED_BY), reverse=True)[:WORST]
        near = [varied(row["plant"], generator) for row in worst for _ in range(VARIATIONS)]
        rounds.append(measured(near, f"search: near the worst, round {number + 1}"))
    return rounds
