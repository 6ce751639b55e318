"""The parts of the comparison: each gives plain data, ready for JSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from fsw_experiment.clairvoyant import EVENTS, Clairvoyant
from fsw_experiment.comparison.cases import (
    CONSERVATIVE,
    CONTROLLERS,
    DECENTRALIZED,
    DEFAULT,
    FIXED,
    SWEEP,
    TIGHT,
    TUNING_CASES,
    VALIDATION_CASES,
    random_processes,
)
from fsw_experiment.comparison.runs import KPIS, VARIATIONS, Figures, Job, is_stable, run_all
from fsw_model import STEP_S
from fsw_model import nominal as model_nominal

Progress = Callable[[str], None]
#: The events of ``tracking`` and ``disturbances``, in their order.
EVENT_NAMES = {"tracking": ("z up", "T up", "z down", "T down"), "disturbances": ("dz", "dT")}
#: A KPI is lost when it is worse than the best rival's by more than this share.
TOLERANCE = 0.005
#: The four figures that other processes are judged by.
JUDGED = (
    ("tracking", "iae_depth_mm_s"),
    ("tracking", "iae_temperature_c_s"),
    ("disturbances", "iae_depth_mm_s"),
    ("disturbances", "iae_temperature_c_s"),
)
JUDGED_TITLES = {
    "tracking iae_depth_mm_s": "set-points, depth",
    "tracking iae_temperature_c_s": "set-points, temperature",
    "disturbances iae_depth_mm_s": "disturbances, depth",
    "disturbances iae_temperature_c_s": "disturbances, temperature",
}
#: Weight of 1 mm in °C for the joint optimum.
_JOINT = 100.0
_LARGEST_GAIN, _LARGEST_DELAY_TICKS = 8.0, 72  # the model takes dead times up to 10 s


def per_event(found: Mapping[str, Figures]) -> dict[str, dict[str, float]]:
    """Figures of each event of the cases ``tracking`` and ``disturbances``."""
    keys = ("iae_depth_mm_s", "iae_temperature_c_s", "peak_depth_error_mm", "peak_temperature_error_c")
    return {
        name: {key: float(event[key]) for key in keys}
        for case, names in EVENT_NAMES.items()
        for name, event in zip(names, found[case]["events"], strict=True)
    }


def nominal(progress: Progress) -> dict[str, Any]:
    """All controllers on the events that they were tuned on: without noise, with noise, and at rest."""
    jobs = [Job(label, case, noise) for label in CONTROLLERS for noise in (False, True) for case in EVENT_NAMES]
    jobs += [Job(label, "rest", True) for label in CONTROLLERS]
    results = dict(zip(map(str, jobs), run_all(jobs, progress), strict=True))
    data: dict[str, Any] = {}
    for label in CONTROLLERS:
        rest = results[str(Job(label, "rest", True))]
        data[label] = {"rest": {key: rest[key] / rest["duration_s"] for key in VARIATIONS}}
        for name, noise in (("clean", False), ("noisy", True)):
            found = {case: results[str(Job(label, case, noise))] for case in EVENT_NAMES}
            data[label][name] = {
                "events": per_event(found),
                **{
                    case: {key: found[case][key] for key, _ in KPIS if found[case].get(key) is not None}
                    for case in found
                },
            }
    return data


def _known(run: Figures) -> Figures:
    return {key: run[key] for key, _ in KPIS if run.get(key) is not None}


def bounds(progress: Progress) -> dict[str, Any]:
    """The clairvoyant optimum of each event: of one output alone, of both, and the front between them."""
    clairvoyant, data = Clairvoyant(), {}
    for event in EVENTS:
        progress(f"clairvoyant optimum, {event.name}")
        of_depth = event.depth_mm != 0.0 or event.shown_mm != 0.0
        alone = clairvoyant.best(event, *((1e4, 1e-3) if of_depth else (1e-3, 1.0)))
        joint = clairvoyant.best(event, _JOINT, 1.0)
        front = clairvoyant.front(event)
        solved = all(found.solved for found in (alone, joint, *front))
        data[event.name] = {
            "alone": alone.iae[0 if of_depth else 1],
            "joint": joint.iae,
            "front": [found.iae for found in front],
            "solved": solved,
        }
    return data


def sweep(progress: Progress, processes: Mapping[str, Mapping[str, float]] | None = None) -> dict[str, Any]:
    """PI tunings and default NMPC on processes that differ from the model, with noise."""
    plants = SWEEP if processes is None else processes
    labels = (*DECENTRALIZED, DEFAULT)
    jobs = [Job(label, case, True, plant) for plant in plants.values() for label in labels for case in EVENT_NAMES]
    found = iter(list(run_all(jobs, progress)))
    data: dict[str, Any] = {}
    for name in plants:
        data[name] = {}
        for label in labels:
            runs = {case: next(found) for case in EVENT_NAMES}
            error = next((run["error"] for run in runs.values() if "error" in run), None)
            if error is not None:
                data[name][label] = {"error": error}
                continue
            data[name][label] = {
                **{f"{case} {key}": runs[case][key] for case, key in JUDGED},
                **{f"{case} {key}": runs[case][key] for case in runs for key in VARIATIONS},
                "swings": any(run["swings"] for run in runs.values()),
            }
    return data


def ratios(data: Mapping[str, Mapping[str, Figures]], rivals: Sequence[str]) -> dict[str, list[float]]:
    """Per judged figure: the default NMPC's over the best rival's, for every process that could be run."""
    found: dict[str, list[float]] = {f"{case} {key}": [] for case, key in JUDGED}
    for runs in data.values():
        if any("error" in run for run in runs.values()):
            continue
        for key, values in found.items():
            values.append(runs[DEFAULT][key] / min(runs[rival][key] for rival in rivals))
    return found


def random_plants(progress: Progress, count: int) -> dict[str, Any]:
    """The sweep on random processes."""
    return sweep(progress, {f"{i}": plant for i, plant in enumerate(random_processes(count))})


def margins(progress: Progress) -> dict[str, dict[str, float]]:
    """Gain and delay margin of each loop, found by simulation of small steps with the other loop closed."""
    data: dict[str, dict[str, float]] = {}
    for label in (*DECENTRALIZED, DEFAULT):
        progress(f"margins, {label}")
        data[label] = {
            "depth_gain": _largest_gain(label, "model.depth_gain_mm_per_kn_s"),
            "temperature_gain": _largest_gain(label, "model.thermal_gain_c_per_kw"),
            "depth_delay_s": STEP_S * _latest(partial(_with_late_force, label)),
            "temperature_delay_s": STEP_S * _latest(partial(_with_dead_time, label)),
        }
    return data


def _largest_gain(label: str, parameter: str) -> float:
    """Largest factor on a gain at which the loop is stable, to 2 %; inf beyond 8."""
    if is_stable(label, {parameter: _LARGEST_GAIN}):
        return math.inf
    low, high = 1.0, _LARGEST_GAIN
    while high > 1.02 * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if is_stable(label, {parameter: middle}) else (low, middle)
    return low


def _with_late_force(label: str, ticks: int) -> bool:
    return is_stable(label, {}, force_ticks=ticks)


def _with_dead_time(label: str, ticks: int) -> bool:
    dead_time_s = model_nominal().dead_time_s
    return is_stable(label, {"model.dead_time_s": (dead_time_s + STEP_S * ticks) / dead_time_s})


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
    labels = (*DECENTRALIZED, DEFAULT)
    cases = (*TUNING_CASES, *VALIDATION_CASES)
    kept = [(name, case, noise) for name in processes for case in cases for noise in (False, True)]
    jobs = [Job(label, case, noise, processes[name]) for name, case, noise in kept for label in labels]
    found = iter(list(run_all(jobs, progress)))
    data: dict[str, Any] = {"tuning": [0, 0], "validation": [0, 0], "losses": []}
    for name, case, noise in kept:
        runs = {label: next(found) for label in labels}
        if any("error" in run for run in runs.values()):
            continue
        part = "tuning" if case in TUNING_CASES else "validation"
        for key, title in KPIS:
            if runs[DEFAULT].get(key) is None:
                continue
            rivals = (TIGHT,) if key in VARIATIONS else DECENTRALIZED
            best = min(runs[rival][key] for rival in rivals)
            data[part][1] += 1
            if runs[DEFAULT][key] <= (1.0 + TOLERANCE) * best:
                data[part][0] += 1
            else:
                ratio = runs[DEFAULT][key] / best if best > 0.0 else math.inf
                data["losses"].append([name, case, noise, title, ratio])
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


def conservative_ratios(runs: Mapping[str, Figures]) -> dict[str, float]:
    """Per judged figure: the default NMPC's over the conservative PI's, for one process."""
    return {
        f"{case} {key}": runs[DEFAULT][f"{case} {key}"] / runs[CONSERVATIVE][f"{case} {key}"] for case, key in JUDGED
    }
