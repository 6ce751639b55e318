"""The NMPC's tuning by rule on other models, against tunings searched for each of them."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

from controller_comparison.processes import DEAD_TIME_S, random_factors
from fsw.console import ProgressBar
from fsw_model import nominal
from fsw_tuning.standard_cases import CASES, DEFAULT
from fsw_tuning.standard_runs import Job, figures, judged, on_all_cores
from fsw_tuning.tune_decentral import NAMES, tune

#: Factors on the paper's parameters, drawn independently and uniformly.
FACTORS = {
    "thermal_gain_c_per_kw": (0.6, 1.7),
    "depth_gain_mm_per_kn_s": (0.6, 1.7),
    "copper_lag_s": (0.5, 2.0),
    "tool_lag_s": (0.5, 2.0),
    "depth_zero_s": (0.5, 2.0),
    "depth_pole_slow_s": (0.5, 2.0),
    "dead_time_s": (1.8 / DEAD_TIME_S, 4.0 / DEAD_TIME_S),
}


def compare(factors: dict[str, float], evaluations: int) -> dict[str, Any]:
    """Tune for one model and run all three controllers on it, without noise.

    The judged figures by controller.
    """
    parameters = nominal().scaled(**factors)
    plant = {f"factors.{name}": factor for name, factor in factors.items()}
    with TemporaryDirectory() as scratch:
        file = Path(scratch) / "model.yaml"
        file.write_text(yaml.safe_dump(dict(parameters)), encoding="utf-8")
        own: dict[str, dict[str, Any]] = {
            f"decentral:{name}": dict(tune(name, parameters, evaluations)) for name in NAMES
        }
        own[DEFAULT] = {"model_file": str(file)}
        return {
            label: judged(
                {case: figures(Job(label, case, plant=plant, parameters=values)) for case in CASES}
            )
            for label, values in own.items()
        }


def study(count: int) -> dict[str, Any]:
    """`compare` on `count` models, on all cores, with 600 evaluations of each search."""
    data = {}
    drawn = random_factors(count, FACTORS)
    with ProgressBar("other models", count) as bar:
        for i, runs in enumerate(on_all_cores(partial(compare, evaluations=600), drawn), start=1):
            runs[DEFAULT]["factors"] = drawn[i - 1]
            data[f"{i}"] = runs
            bar(i)
    return data
