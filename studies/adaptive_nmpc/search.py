"""A search for plants on which adapting does harm: random ones, then variations of the worst."""

from __future__ import annotations

import random
from collections.abc import Sequence
from math import exp, log
from typing import Any

import numpy as np

from adaptive_nmpc.study import ADAPTIVE, FIXED, controllers
from controller_comparison.processes import SENSORS
from fsw.progress import ProgressBar
from fsw_model import STEP_S
from fsw_model import nominal as nominal_parameters
from fsw_scenario.standard_cases import CASES
from fsw_scenario.standard_runs import Job, on_all_cores, weld

_DEAD_S = nominal_parameters().dead_time_s
#: What is drawn: uniformly, and factors in their logarithm.
UNIFORM = {
    "model.dead_time_s": (1.0 - 1.0 / _DEAD_S, 1.0 + 4.0 / _DEAD_S),
    "sensors.temperature_lag_s": (0.0, 3.0),
    **{f"sensors.{of}_noise_correlation_s": (0.0, 5.0) for of in SENSORS},
}
FACTORS = {
    "model.thermal_gain_c_per_kw": (0.5, 2.0),
    "model.copper_lag_s": (0.5, 2.0),
    "model.tool_lag_s": (0.5, 2.0),
    "model.depth_gain_mm_per_kn_s": (0.7, 1.4),
    "model.sliding_friction": (0.9, 1.1),
    "model.softening_per_c": (0.5, 2.0),
}
#: On how many of the plants of a round something is right: the lag of the probe and the colour of the noise are none.
_AS_IN_MODEL = 0.5
#: Rounds after the first one vary so many of the worst plants, by so much of the ranges.
WORST, VARIED = 6, 0.15
Plant = dict[str, float]


def drawn(generator: random.Random) -> Plant:
    """A random plant."""
    plant = {name: generator.uniform(*span) for name, span in UNIFORM.items()}
    plant |= {name: exp(generator.uniform(log(low), log(high))) for name, (low, high) in FACTORS.items()}
    for group in ("temperature_lag_s", "correlation_s"):
        if generator.random() < _AS_IN_MODEL:
            plant |= {name: 0.0 for name in plant if name.endswith(group)}
    return plant | {"seed": generator.randrange(1, 2**31)}


def varied(plant: Plant, generator: random.Random) -> Plant:
    """A plant near another one, inside the ranges."""
    near = dict(plant)
    for name, (low, high) in UNIFORM.items():
        near[name] = min(max(plant[name] + generator.gauss(0.0, VARIED) * (high - low), low), high)
    for name, (low, high) in FACTORS.items():
        factor = exp(generator.gauss(0.0, VARIED) * log(high / low))
        near[name] = min(max(plant[name] * factor, low), high)
    return near | {"seed": generator.randrange(1, 2**31)}


def errors(job: Job) -> dict[str, float]:
    """IAE of both outputs, and the largest error of the temperature."""
    truth, signals = (run := weld(job)).truth, run
    assert truth is not None  # a simulation has it
    depth = np.abs(truth.depth_mm - signals.reference_depth_mm)
    temperature = np.abs(truth.temperature_c - signals.reference_temperature_c)
    return {
        "iae_depth_mm_s": STEP_S * float(depth.sum()),
        "iae_temperature_c_s": STEP_S * float(temperature.sum()),
        "peak_c": float(temperature.max()),
    }


def measured(plants: Sequence[Plant], columns: Sequence[str] = (FIXED, ADAPTIVE)) -> list[dict[str, Any]]:
    """Errors of the columns in both cases, with noise, plant by plant."""
    with controllers() as made, ProgressBar("search") as bar:
        keys = [(plant, case, column) for plant in range(len(plants)) for case in CASES for column in columns]
        jobs = [Job(made[column][0], case, True, plants[i], made[column][1]) for i, case, column in keys]
        rows: list[dict[str, Any]] = [{"plant": plant, **{case: {} for case in CASES}} for plant in plants]
        for done, ((i, case, column), one) in enumerate(zip(keys, on_all_cores(errors, jobs, chunksize=4), strict=True)):
            rows[i][case][column] = one
            bar((done + 1) / len(jobs))
    return rows
