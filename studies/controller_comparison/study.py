"""The parts of the comparison: each gives plain data, ready for JSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from controller_comparison.processes import FIXED, SWEEP, VALIDATION_CASES, random_factors
from controller_comparison.stability import is_stable
from fsw_model import STEP_S
from fsw_model import nominal as model_nominal
from fsw_scenario.standard_cases import CONTROLLERS, DECENTRALIZED, DEFAULT, TIGHT
from fsw_scenario.standard_events import CASES
from fsw_scenario.standard_runs import JUDGED, KPIS, VARIATIONS, Figures, Job, failed, judged, run_all

Progress = Callable[[str], None]
#: Those compared on other processes than the nominal one.
FINALISTS = (*DECENTRALIZED, DEFAULT)
#: A KPI is lost when it is worse than the best rival's by more than this share.
TOLERANCE = 0.005
_AGGRESSIVENESS = (1.0, 0.7, 0.5, 0.35)
_LARGEST_GAIN, _LARGEST_DELAY_TICKS = 8.0, 72  # the model takes dead times up to 10 s


def nominal(progress: Progress) -> dict[str, Any]:
    """All controllers on the events that they were tuned on: without noise, with noise, and at rest."""
    jobs = [Job(label, case, noise) for label in CONTROLLERS for noise in (False, True) for case in CASES]
    jobs += [Job(label, "rest", True) for label in CONTROLLERS]
    results = run_all(jobs, progress)
    data: dict[str, Any] = {}
    for label in CONTROLLERS:
        rest = results[Job(label, "rest", True)]
        data[label] = {"rest": {key: rest[key] / rest["duration_s"] for key in VARIATIONS}}
        for kind, noise in (("clean", False), ("noisy", True)):
            found = {case: results[Job(label, case, noise)] for case in CASES}
            data[label][kind] = {"events": _per_event(found)}
            for case, run in found.items():
                data[label][kind][case] = {key: run[key] for key in KPIS if run.get(key) is not None}
    return data


def _per_event(found: Mapping[str, Figures]) -> dict[str, dict[str, float]]:
    keys = ("iae_depth_mm_s", "iae_temperature_c_s", "peak_depth_error_mm", "peak_temperature_error_c")
    return {
        name: {key: float(event[key]) for key in keys}
        for case, names in CASES.items()
        for name, event in zip(names, found[case]["events"], strict=True)
    }


def sweep(progress: Progress, processes: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    """PI tunings and default NMPC on processes that differ from the model, with noise."""
    jobs = [Job(label, case, True, plant) for plant in processes.values() for label in FINALISTS for case in CASES]
    results = run_all(jobs, progress)
    return {
        name: {label: judged({case: results[Job(label, case, True, plant)] for case in CASES}) for label in FINALISTS}
        for name, plant in processes.items()
    }


def ratios(data: Mapping[str, Mapping[str, Figures]], rivals: Sequence[str]) -> dict[str, list[float]]:
    """Per judged figure: the default NMPC's over the best rival's, for every process that could be run."""
    ran = [runs for runs in data.values() if not failed(runs)]
    return {key: [runs[DEFAULT][key] / min(runs[rival][key] for rival in rivals) for runs in ran] for key in JUDGED}


def random_plants(progress: Progress, count: int) -> dict[str, Any]:
    """The sweep on random processes."""
    return sweep(progress, {f"{i}": plant for i, plant in enumerate(random_factors(count))})


def margins(progress: Progress) -> dict[str, dict[str, float]]:
    """Gain and delay margin of each loop, found by simulation of small steps with the other loop closed."""
    data: dict[str, dict[str, float]] = {}
    for label in FINALISTS:
        progress(f"margins, {label}")
        data[label] = _margins(label)
    return data


def _margins(label: str) -> dict[str, float]:
    dead_time_s = model_nominal().dead_time_s

    def with_dead_time(ticks: int) -> bool:
        return is_stable(label, {"model.dead_time_s": (dead_time_s + STEP_S * ticks) / dead_time_s})

    return {
        "depth_gain": _largest_gain(lambda gain: is_stable(label, {"model.depth_gain_mm_per_kn_s": gain})),
        "temperature_gain": _largest_gain(lambda gain: is_stable(label, {"model.thermal_gain_c_per_kw": gain})),
        "depth_delay_s": STEP_S * _latest(lambda ticks: is_stable(label, {}, force_ticks=ticks)),
        "temperature_delay_s": STEP_S * _latest(with_dead_time),
    }


def aggressiveness(progress: Progress) -> dict[str, dict[str, float]]:
    """What the NMPC's knob of the temperature trades: gain margin against errors, without noise."""
    data: dict[str, dict[str, float]] = {}
    for value in _AGGRESSIVENESS:
        progress(f"temperature_aggressiveness {value:g}")
        data[f"{value:g}"] = _with_knob({"temperature_aggressiveness": value}, progress)
    return data


def _with_knob(knob: Mapping[str, float], progress: Progress) -> dict[str, float]:
    jobs = {case: Job(DEFAULT, case, parameters=knob) for case in CASES}
    results = run_all(list(jobs.values()), progress)
    errors = {case: results[job]["iae_temperature_c_s"] for case, job in jobs.items()}
    margin = _largest_gain(lambda gain: is_stable(DEFAULT, {"model.thermal_gain_c_per_kw": gain}, parameters=knob))
    return errors | {"temperature_gain": margin}


def _largest_gain(stable: Callable[[float], bool]) -> float:
    """Largest factor on a gain at which the loop is stable, to 2 %; inf beyond 8."""
    if stable(_LARGEST_GAIN):
        return math.inf
    low, high = 1.0, _LARGEST_GAIN
    while high > 1.02 * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def _latest(stable: Callable[[int], bool]) -> int:
    """Largest number of ticks at which ``stable`` holds."""
    low, high = 0, 1
    while stable(high):
        if high == _LARGEST_DELAY_TICKS:
            return high
        low, high = high, min(2 * high, _LARGEST_DELAY_TICKS)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def wins(progress: Progress) -> dict[str, Any]:
    """KPIs of the default NMPC at or below both PI tunings' (total variation: the tight one's), everywhere."""
    processes = {name: SWEEP[name] for name in ("nominal", *FIXED)}
    kept = [
        (name, case, noise) for name in processes for case in (*CASES, *VALIDATION_CASES) for noise in (False, True)
    ]
    results = run_all(
        [Job(label, case, noise, processes[name]) for name, case, noise in kept for label in FINALISTS], progress
    )
    data: dict[str, Any] = {"tuning": [0, 0], "validation": [0, 0], "losses": []}
    for name, case, noise in kept:
        runs = {label: results[Job(label, case, noise, processes[name])] for label in FINALISTS}
        if failed(runs):
            continue
        part = "tuning" if case in CASES else "validation"
        for key, title in KPIS.items():
            own = runs[DEFAULT].get(key)
            if own is None:
                continue
            best = min(runs[rival][key] for rival in ((TIGHT,) if key in VARIATIONS else DECENTRALIZED))
            data[part][1] += 1
            if own <= (1.0 + TOLERANCE) * best:
                data[part][0] += 1
            else:
                data["losses"].append([name, case, noise, title, own / best if best > 0.0 else math.inf])
    return data


def quantiles(values: Sequence[float]) -> dict[str, float]:
    """Median, 95 % quantile, largest value, and the share at or below 1."""
    array = np.array(values)
    return {
        "median": float(np.median(array)),
        "p95": float(np.quantile(array, 0.95)),
        "largest": float(array.max()),
        "share": float(np.mean(array <= 1.0 + TOLERANCE)),
    }
