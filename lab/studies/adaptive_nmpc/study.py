"""The parts of the study: each gives plain data, ready for JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import fsw
from controller_comparison.processes import REST, random_factors
from controller_comparison.study import KPIS, VARIATIONS, margins
from fsw.console import ProgressBar
from fsw_analysis.weld_signals import WeldSignals
from fsw_campaign import definition
from fsw_control.contract import Command
from fsw_control.weld import TICK_NS
from fsw_model import STEP_S
from fsw_model import nominal as nominal_parameters
from fsw_tuning.standard_cases import CASES, CONSERVATIVE, DEFAULT, SMITH, TIGHT
from fsw_tuning.standard_runs import Figures, Job, failed, loop_of, on_all_cores, run_all, weld

ADAPTIVE = "nmpc:adaptive"
#: The same tuning with the gain and dead time of the model, and without its test for heat.
FIXED = "nmpc:adaptive, not adapting"
RIVALS = (CONSERVATIVE, TIGHT)
COLUMNS = (*RIVALS, SMITH, DEFAULT, FIXED, ADAPTIVE)
#: Random plants of other seeds than this served to choose the preset's values.
SEED = 31415
#: Many parameters at once, and limits on both outputs.
CAMPAIGN = "model_uncertainty"
#: Process on which the greater depth and the temperature need nearly all of the speed.
WEAK = {"factors.sliding_friction": 0.85, "factors.sticking_stress_pa": 0.85}
#: Plants and seeds of the sensor noise from which the noise of the figures is estimated.
NOISY_PLANTS, NOISE_SEEDS = 20, (1, 2, 3, 4)
#: Dead times beyond the model's, factors on the gain and on the copper's lag: every combination.
LATER_S, GAINS, LAGS = (-1.0, 0.0, 1.0, 2.0, 3.0, 4.0), (0.5, 1.0, 2.0), (0.5, 1.0, 2.0)
#: Last ticks of the set-points' case, after the last step of the temperature, in which what still
#: swings is seen.
_LATE_TICKS = 250
_HERE = Path(__file__).parent
#: Set-points go down by 0.2 mm here.
SATURATED = str(_HERE / "saturated.yaml")
#: Unannounced disturbances of the depth without a jump: a ramp and a sine.
RAMP, SINE, NOTHING = (str(_HERE / f"{name}.yaml") for name in ("ramp", "sine", "nothing"))
#: Depth by which the tool itself jumps, and when; the torque feels it.
FELT_MM, FELT_S = 0.1, 10.0
#: What the figure compares where the speed is at its bound.
PRIORITIES = {
    TIGHT: (TIGHT, {}),
    DEFAULT: (DEFAULT, {}),
    **{
        f"{ADAPTIVE}, priority {name}": (ADAPTIVE, {"priority": name})
        for name in ("depth", "balance", "temperature")
    },
}


@contextmanager
def controllers() -> Iterator[dict[str, tuple[str, dict[str, Any]]]]:
    """Label and parameters of every column; a tuning file of one of them exists as long as the context."""
    with TemporaryDirectory() as scratch:
        file = Path(scratch) / "not_adapting.yaml"
        file.write_text(
            "estimator: {thermal_gain_walk: 0.0, delay_walk_s: 0.0, heat_sigmas: 0.0}\n",
            encoding="utf-8",
        )
        yield {name: (name, {}) for name in COLUMNS} | {
            FIXED: (ADAPTIVE, {"tuning_file": str(file)})
        }


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
        results = run_all(list(jobs.values()), bar)
    return {
        f"{i}": {
            column: figures({case: results[jobs[i, column, case]] for case in CASES})
            for column in COLUMNS
        }
        for i in plants
    }


def figures(runs: Mapping[str, Figures]) -> Figures:
    """The figures of merit of a controller's cases, and whether an output oscillates; or the error of one case."""
    for run in runs.values():
        if "error" in run:
            return {"error": run["error"]}
    merits = {
        f"{case} {key}": run[key]
        for case, run in runs.items()
        for key in KPIS
        if run.get(key) is not None
    }
    return merits | {"swings": any(run["swings"] for run in runs.values())}


def noise() -> list[list[Figures]]:
    """All figures of merit without adaptation, by plant and by seed of the sensor noise."""
    plants = random_factors(NOISY_PLANTS, seed=SEED)
    with controllers() as made, ProgressBar("noise of the figures") as bar:
        label, parameters = made[FIXED]
        jobs = {
            (i, seed, case): Job(label, case, True, {**plant, "seed": seed}, parameters)
            for i, plant in enumerate(plants)
            for seed in NOISE_SEEDS
            for case in CASES
        }
        results = run_all(list(jobs.values()), bar)
    return [
        [figures({case: results[jobs[i, seed, case]] for case in CASES}) for seed in NOISE_SEEDS]
        for i in range(NOISY_PLANTS)
    ]


def inside_limits(folder: Path) -> list[int]:
    """Number of welds of `CAMPAIGN` with the preset inside all limits, and of all welds.

    Those that are in the folder already are kept.
    """
    content = json.loads(definition.load(CAMPAIGN).text) | {"controllers": [ADAPTIVE]}
    with TemporaryDirectory() as scratch:
        file = Path(scratch) / f"{CAMPAIGN}.yaml"
        file.write_text(json.dumps(content), encoding="utf-8")
        with ProgressBar(CAMPAIGN) as bar:
            welds = fsw.campaign(
                file,
                folder,
                resume=folder.exists(),
                progress=lambda done: bar(done / content["welds"]),
            )
    return [sum(welds.column("inside").to_pylist()), welds.num_rows]


def _late(job: Job) -> dict[str, float]:
    """Largest error of the temperature, its range at the end, and its IAE."""
    truth, reference = (signals := weld(job)).truth, signals.reference_temperature_c
    assert truth is not None  # a simulation has it
    error = truth.temperature_c - reference
    return {
        "peak_c": float(np.abs(error).max()),
        "moves_c": float(np.ptp(error[-_LATE_TICKS:])),
        "iae_c_s": STEP_S * float(np.abs(error).sum()),
    }


def late() -> list[dict[str, Any]]:
    """Set-points, with noise, on a grid of dead time, gain and lag; with and without adaptation."""
    dead_s = nominal_parameters().dead_time_s
    grid = list(product(LATER_S, GAINS, LAGS))
    with controllers() as made, ProgressBar("dead times") as bar:
        jobs = []
        for later_s, gain, lag in grid:
            plant = {"factors.dead_time_s": 1.0 + later_s / dead_s}
            plant |= {"factors.thermal_gain_c_per_kw": gain, "factors.copper_lag_s": lag}
            jobs += [
                Job(made[c][0], "tracking", True, plant, made[c][1]) for c in (FIXED, ADAPTIVE)
            ]
        found = []
        for figures_of_one in on_all_cores(_late, jobs, chunksize=4):
            found.append(figures_of_one)
            bar(len(found) / len(jobs))
    return [
        {"later_s": later_s, "gain": gain, "lag": lag, FIXED: fixed, ADAPTIVE: adaptive}
        for (later_s, gain, lag), fixed, adaptive in zip(
            grid, found[::2], found[1::2], strict=True
        )
    ]


def nominal() -> dict[str, dict[str, Any]]:
    """Default and adaptive on the model's own process: events without noise; with noise, at rest."""
    both = (DEFAULT, ADAPTIVE)
    jobs = {(label, case): Job(label, case) for label in both for case in CASES}
    jobs |= {(label, REST): Job(label, REST, True) for label in both}
    results = run_all(list(jobs.values()))
    data: dict[str, dict[str, Any]] = {}
    for label in both:
        events: dict[str, Any] = {}
        for case, names in CASES.items():
            events |= dict(zip(names, results[jobs[label, case]]["events"], strict=True))
        rest = results[jobs[label, REST]]
        data[label] = {
            "events": events,
            "rest": {key: rest[key] / rest["duration_s"] for key in VARIATIONS},
        }
    return data


def saturated_welds() -> dict[str, WeldSignals]:
    """The step of the depth where the speed is at its bound, without noise, by controller and priority."""
    return {
        name: weld(Job(label, SATURATED, plant=WEAK, parameters=values))
        for name, (label, values) in PRIORITIES.items()
    }


def saturated(welds: Mapping[str, WeldSignals]) -> dict[str, dict[str, float]]:
    """IAE and largest error of both outputs in such a weld."""
    return {name: errors(signals) for name, signals in welds.items()}


def errors(signals: WeldSignals) -> dict[str, float]:
    """IAE and largest error of both outputs, against the noise-free truth."""
    truth = signals.truth
    assert truth is not None  # a simulation has it
    depth = np.abs(truth.depth_mm - signals.reference_depth_mm)
    temperature = np.abs(truth.temperature_c - signals.reference_temperature_c)
    return {
        "iae_depth_mm_s": STEP_S * float(depth.sum()),
        "iae_temperature_c_s": STEP_S * float(temperature.sum()),
        "peak_temperature_error_c": float(temperature.max()),
    }


class Struck:
    """A plant whose tool jumps deeper at a tick; all else is the plant's."""

    def __init__(self, plant: Any, by_mm: float, at_s: float) -> None:
        self._plant, self._by_mm, self._tick = plant, by_mm, round(at_s / STEP_S)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plant, name)

    def apply(self, command: Command, stamp_ns: int, source: str) -> None:
        """As of the plant; the jump is at the command to the tick."""
        if stamp_ns == self._tick * TICK_NS:
            self._plant.core.memory.x[0] += self._by_mm  # creep, a part of the depth
        self._plant.apply(command, stamp_ns, source)


def drifts() -> dict[str, dict[str, list[float]]]:
    """Ramp and sine of the depth: IAE [mm s]; real jumps: peak of the temperature [degC]. Without and with noise."""
    columns = (*RIVALS, DEFAULT, ADAPTIVE)
    data: dict[str, dict[str, list[float]]] = {}
    with controllers() as made:
        for column in columns:
            label, values = made[column]
            measured = data[column] = {}
            for name, case in (("ramp", RAMP), ("sine", SINE)):
                runs = [
                    errors(loop_of(Job(label, case, noise, parameters=values)).run())
                    for noise in (False, True)
                ]
                measured[name] = [run["iae_depth_mm_s"] for run in runs]
            for name, by_mm in (("deeper", FELT_MM), ("shallower", -FELT_MM)):
                measured[name] = []
                for noise in (False, True):
                    loop = loop_of(Job(label, NOTHING, noise, parameters=values))
                    loop.plant = Struck(loop.plant, by_mm, FELT_S)  # type: ignore[assignment]
                    measured[name].append(errors(loop.run())["peak_temperature_error_c"])
            rest = run_all([Job(label, REST, True, parameters=values)])
            measured["rest"] = [
                run_at_rest[VARIATIONS[0]] / run_at_rest["duration_s"]
                for run_at_rest in rest.values()
            ]
    return data


def robustness() -> dict[str, dict[str, float]]:
    """Gain and delay margins, as in the comparison."""
    return margins((TIGHT, SMITH, DEFAULT, ADAPTIVE))


def ran(data: Mapping[str, Mapping[str, Figures]]) -> list[Mapping[str, Figures]]:
    """The plants that could be run with every controller."""
    return [runs for runs in data.values() if not failed(runs)]
