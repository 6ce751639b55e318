"""The parts of the comparison: each gives plain data, ready for JSON."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from controller_comparison.processes import FIXED, REST, SMALL_STEPS, SWEEP, VALIDATION_CASES, random_factors
from fsw.progress import ProgressBar
from fsw_analysis.kpi_table import ROWS
from fsw_control.contract import Command
from fsw_model import STEP_S
from fsw_model import nominal as model_nominal
from fsw_scenario import standard_runs
from fsw_scenario.standard_cases import CASES, CONSERVATIVE, DEFAULT, SMITH, TIGHT
from fsw_scenario.standard_runs import JUDGED, Figures, Job, failed, loop_of

DECENTRALIZED = (CONSERVATIVE, TIGHT)
CONTROLLERS = (*DECENTRALIZED, SMITH, "nmpc:paper", DEFAULT)
#: Those compared on other processes than the nominal one.
FINALISTS = (*DECENTRALIZED, SMITH, DEFAULT)
#: Figures of merit that are compared, by their key in ``fsw_analysis.kpi``, with their titles.
KPIS = {
    key: f"{meaning} [{unit}]".replace("deg", "°").replace("^2", "²").replace("[um]", "[µm]")
    for key, (meaning, unit, _) in ROWS.items()
    if key.startswith(("iae", "ise", "peak", "total_variation"))
}
VARIATIONS = tuple(key for key in KPIS if key.startswith("total_variation"))
#: A figure of merit is lost when it is worse than the best rival's by more than this share.
TOLERANCE = 0.005
_AGGRESSIVENESS = (1.0, 0.7, 0.5, 0.35)
_LARGEST_GAIN, _LARGEST_DELAY_TICKS = 8.0, 72  # the model takes dead times up to 10 s


def _run_all(title: str, jobs: Sequence[Job]) -> dict[Job, Figures]:
    with ProgressBar(title) as bar:
        return standard_runs.run_all(jobs, bar)


def nominal() -> dict[str, Any]:
    """All controllers on the events that they were tuned on: without noise, with noise, and at rest."""
    jobs = [Job(label, case, noise) for label in CONTROLLERS for noise in (False, True) for case in CASES]
    jobs += [Job(label, REST, True) for label in CONTROLLERS]
    results = _run_all("nominal process", jobs)
    data: dict[str, Any] = {}
    for label in CONTROLLERS:
        rest = results[Job(label, REST, True)]
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


def sweep(processes: Mapping[str, Mapping[str, float | str]]) -> dict[str, Any]:
    """PI tunings and default NMPC on processes that differ from the model, with noise."""
    with ProgressBar(f"{len(processes)} processes") as bar:
        return standard_runs.sweep({label: {} for label in FINALISTS}, processes, bar)


def random_plants(count: int) -> dict[str, Any]:
    """The sweep on random processes: ratios to the better PI and to smith, and on how many an output oscillates."""
    data = sweep({f"{i}": plant for i, plant in enumerate(random_factors(count))})
    swings = {label: sum(bool(runs[label].get("swings")) for runs in data.values()) for label in FINALISTS}
    return {"plants": count, "ratios": ratios(data), "smith": ratios(data, (SMITH,)), "swings": swings}


def ratios(data: Mapping[str, Mapping[str, Figures]], rivals: Sequence[str] = DECENTRALIZED) -> dict[str, list[float]]:
    """Per judged figure: the default NMPC's over the best rival's, for every process that could be run."""
    ran = [runs for runs in data.values() if not failed(runs)]
    return {key: [runs[DEFAULT][key] / min(runs[rival][key] for rival in rivals) for runs in ran] for key in JUDGED}


class _LateForce:
    """A plant whose drive gets its commands of the force some ticks late; all else is the plant's."""

    def __init__(self, plant: Any, ticks: int) -> None:
        self._plant = plant
        self._under_way = deque([plant.applied.force_kn] * ticks)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plant, name)

    def apply(self, command: Command, stamp_ns: int, source: str) -> None:
        self._under_way.append(command.force_kn)
        self._plant.apply(Command(self._under_way.popleft(), command.speed_rpm), stamp_ns, source)


def is_stable(
    controller: str, plant: Mapping[str, float | str], force_ticks: int = 0, parameters: Mapping[str, Any] | None = None
) -> bool:
    """Whether small steps of both set-points die out, without noise, with the force so many ticks late.

    What swings by ten times the step and more does not die out, even if the bounds of the drives make it smaller.
    """
    loop = loop_of(Job(controller, SMALL_STEPS, plant=plant, parameters=parameters or {}))
    loop.plant = _LateForce(loop.plant, force_ticks)  # type: ignore[assignment]
    truth = loop.run().truth
    assert truth is not None  # a simulation has it
    for value, floor, most in ((truth.depth_mm, 1e-4, 0.1), (truth.temperature_c, 1e-2, 5.0)):
        earlier, later = np.ptp(value[-1200:-600]), np.ptp(value[-600:])
        if later > min(max(0.9 * earlier, floor), most):
            return False
    return True


def margins(labels: Sequence[str] = FINALISTS) -> dict[str, dict[str, float]]:
    """Gain and delay margin of each loop, found by simulation of small steps with the other loop closed."""
    return dict(zip(labels, standard_runs.on_all_cores(_margins, labels), strict=True))


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


def aggressiveness() -> dict[str, dict[str, float]]:
    """What the NMPC's knob of the temperature trades: gain margin against errors, without noise."""
    return {f"{value:g}": _with_knob({"temperature_aggressiveness": value}) for value in _AGGRESSIVENESS}


def _with_knob(knob: Mapping[str, float]) -> dict[str, float]:
    errors = {case: standard_runs.figures(Job(DEFAULT, case, parameters=knob))["iae_temperature_c_s"] for case in CASES}
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


def wins() -> dict[str, Any]:
    """Figures of the default NMPC at or below both PI tunings' (total variation: the tight one's), everywhere."""
    processes = {name: SWEEP[name] for name in ("nominal", *FIXED)}
    welds = [
        (name, case, noise) for name in processes for case in (*CASES, *VALIDATION_CASES) for noise in (False, True)
    ]
    jobs = [Job(label, case, noise, processes[name]) for name, case, noise in welds for label in FINALISTS]
    results = _run_all(f"events on {len(processes)} processes", jobs)
    data: dict[str, Any] = {"tuning": [0, 0], "validation": [0, 0], "losses": []}
    for name, case, noise in welds:
        runs = {label: results[Job(label, case, noise, processes[name])] for label in FINALISTS}
        count = data["tuning" if case in CASES else "validation"]
        for key, title in {} if failed(runs) else KPIS.items():
            own = runs[DEFAULT].get(key)
            if own is None:
                continue
            best = min(runs[pi][key] for pi in ((TIGHT,) if key in VARIATIONS else DECENTRALIZED))
            count[1] += 1
            if own <= (1.0 + TOLERANCE) * best:
                count[0] += 1
            else:
                data["losses"].append([name, Path(case).stem, noise, title, own / best if best > 0.0 else math.inf])
    return data
