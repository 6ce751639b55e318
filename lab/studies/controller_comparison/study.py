"""The parts of the comparison: each gives plain data, ready for JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml

from controller_comparison.processes import (
    BELOW_NOISE,
    FIXED,
    MODELS,
    RANDOM,
    REST,
    SWEEP,
    VALIDATION_CASES,
    random_factors,
)
from fsw.console import ProgressBar
from fsw_analysis.kpi_table import ROWS
from fsw_model import nominal as paper_model
from fsw_tuning import standard_runs
from fsw_tuning.margins import Loops, slower_for
from fsw_tuning.standard_cases import CASES, CONSERVATIVE, DEFAULT, SMITH, TIGHT
from fsw_tuning.standard_runs import JUDGED, Figures, Job, failed
from fsw_tuning.tune_decentral import NAMES, tune

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
#: Of the sensors' noise, over which a mean is taken.
_SEEDS = 5
_SMALL = {"disturbed": BELOW_NOISE, "rest": REST}
#: The NMPC with the margins of the tight PI.
MATCHED = f"{DEFAULT}, matched"
#: Of the plant: a tick between command and drives.
LATENCY = {"actuators.dead_time_ticks": 1}
#: Ways to start the corridors of ``nmpc:paper``: fields of its tuning.
CORRIDORS: dict[str, dict[str, str | float]] = {
    **{
        name: {"trajectory": name}
        for name in ("constant", "cold_start", "recentred", "recentred_ahead")
    },
    "recentred_ahead, τ 3 s": {"trajectory": "recentred_ahead", "temperature_time_s": 3.0},
}
_AGGRESSIVENESS = (1.0, 0.7, 0.5, 0.35)


def _run_all(title: str, jobs: Sequence[Job]) -> dict[Job, Figures]:
    with ProgressBar(title) as bar:
        return standard_runs.run_all(jobs, bar)


def nominal() -> dict[str, Any]:
    """All controllers on the events that they were tuned on.

    Without noise, with noise, and at rest.
    """
    jobs = [
        Job(label, case, noise)
        for label in CONTROLLERS
        for noise in (False, True)
        for case in CASES
    ]
    jobs += [Job(label, REST, True) for label in CONTROLLERS]
    results = _run_all("nominal process", jobs)
    data: dict[str, Any] = {}
    for label in CONTROLLERS:
        rest = results[Job(label, REST, True)]
        data[label] = {"rest": {key: rest[key] / rest["duration_s"] for key in VARIATIONS}}
        for kind, noise in (("clean", False), ("noisy", True)):
            by_case = {case: results[Job(label, case, noise)] for case in CASES}
            data[label][kind] = {"events": _per_event(by_case)}
            for case, run in by_case.items():
                data[label][kind][case] = {
                    key: run[key] for key in KPIS if run.get(key) is not None
                }
    return data


def _per_event(by_case: Mapping[str, Figures]) -> dict[str, dict[str, float]]:
    keys = (
        "iae_depth_mm_s",
        "iae_temperature_c_s",
        "peak_depth_error_mm",
        "peak_temperature_error_c",
    )
    return {
        name: {key: float(event[key]) for key in keys}
        for case, names in CASES.items()
        for name, event in zip(names, by_case[case]["events"], strict=True)
    }


def sweep(processes: Mapping[str, Mapping[str, float | str]]) -> dict[str, Any]:
    """PI tunings and default NMPC on processes that differ from the model, with noise."""
    with ProgressBar(f"{len(processes)} processes") as bar:
        return standard_runs.sweep({label: {} for label in FINALISTS}, processes, bar)


def random_plants(count: int, spans: Mapping[str, tuple[float, float]] = RANDOM) -> dict[str, Any]:
    """The sweep on random processes.

    Ratios to the better PI and to smith, and on how many an output oscillates.
    """
    data = sweep({f"{i}": plant for i, plant in enumerate(random_factors(count, spans))})
    swings = {
        label: sum(bool(runs[label].get("swings")) for runs in data.values())
        for label in FINALISTS
    }
    return {
        "plants": count,
        "ratios": ratios(data),
        "smith": ratios(data, (SMITH,)),
        "swings": swings,
    }


def ratios(
    data: Mapping[str, Mapping[str, Figures]], rivals: Sequence[str] = DECENTRALIZED
) -> dict[str, list[float]]:
    """Per judged figure.

    The default NMPC's over the best rival's, for every process that could be run.
    """
    ran = [runs for runs in data.values() if not failed(runs)]
    return {
        key: [runs[DEFAULT][key] / min(runs[rival][key] for rival in rivals) for runs in ran]
        for key in JUDGED
    }


def margins(labels: Sequence[str] = FINALISTS) -> dict[str, dict[str, float]]:
    """Gain and delay margin of each loop, the other closed, by simulation of small steps."""
    return dict(zip(labels, standard_runs.on_all_cores(_margins, labels), strict=True))


def _margins(label: str) -> dict[str, float]:
    return Loops(label).margins()


def matched() -> dict[str, Any]:
    """With noise and a tick of loop latency.

    The finalists, and the NMPC slowed to the margins of the tight PI.
    """
    slower = slower_for(Loops(TIGHT).margins())
    data: dict[str, Any] = {"slower": slower, "entrants": {}}
    for name, (label, parameters) in entrants(FINALISTS, slower).items():
        runs = {
            case: standard_runs.figures(Job(label, case, True, LATENCY, parameters))
            for case in CASES
        }
        moved = {key: runs["tracking"][key] for key in VARIATIONS}
        iae = {key: runs[key.split()[0]][key.split()[1]] for key in JUDGED}
        data["entrants"][name] = Loops(label, parameters).temperature() | iae | moved
    return data


def entrants(labels: Sequence[str], slower: float) -> dict[str, tuple[str, dict[str, float]]]:
    """Label and parameters of controllers by name, and of the NMPC slowed by this factor."""
    matched = {MATCHED: (DEFAULT, {"temperature_aggressiveness": 1.0 / slower})}
    return {**{label: (label, {}) for label in labels}, **matched}


def below_noise() -> dict[str, dict[str, float]]:
    """Mean absolute errors with disturbances below a noise jump, and at rest, over seeds."""
    keys = ("iae_depth_mm_s", "iae_temperature_c_s")
    jobs = {
        (label, case, seed): Job(label, case, True, {"seed": seed})
        for label in FINALISTS
        for case in (BELOW_NOISE, REST)
        for seed in range(1, _SEEDS + 1)
    }
    results = _run_all("disturbances below the noise", list(jobs.values()))

    def rate(label: str, case: str, key: str) -> float:
        runs = [results[jobs[label, case, seed]] for seed in range(1, _SEEDS + 1)]
        return float(np.mean([run[key] / run["duration_s"] for run in runs]))

    return {
        label: {
            f"{name} {key}": 1e3 * rate(label, case, key)
            for key in keys
            for name, case in _SMALL.items()
        }
        for label in FINALISTS
    }


def corridors() -> dict[str, dict[str, float]]:
    """Temperature figures with each way to start the corridors of ``nmpc:paper``, noise-free."""
    return dict(
        zip(CORRIDORS, standard_runs.on_all_cores(_corridor, list(CORRIDORS)), strict=True)
    )


def _corridor(name: str) -> dict[str, float]:
    with paper_with(CORRIDORS[name]) as parameters:
        runs = {
            case: standard_runs.figures(Job("nmpc", case, parameters=parameters)) for case in CASES
        }
        by_case = {case: float(run["iae_temperature_c_s"]) for case, run in runs.items()}
        for key in (
            "peak_temperature_in_depth_step_up_c",
            "peak_temperature_in_depth_step_down_c",
        ):
            by_case[key] = float(runs["tracking"][key])
        by_case["speed_rpm"] = float(runs["tracking"]["total_variation_speed_rpm"])
        return by_case | Loops("nmpc", parameters).temperature()


@contextmanager
def paper_with(fields: Mapping[str, str | float]) -> Iterator[dict[str, str]]:
    """Parameters of the NMPC with preset ``paper`` and other values of some tuning fields."""
    with TemporaryDirectory() as scratch:
        file = Path(scratch) / "tuning.yaml"
        file.write_text(yaml.safe_dump(dict(fields)), encoding="utf-8")
        yield {"preset": "paper", "tuning_file": str(file)}


def aggressiveness() -> dict[str, dict[str, float]]:
    """What the NMPC's knob of the temperature trades.

    Gain margin against errors, without noise.
    """
    return {
        f"{value:g}": _with_knob({"temperature_aggressiveness": value})
        for value in _AGGRESSIVENESS
    }


def _with_knob(knob: Mapping[str, float]) -> dict[str, float]:
    errors = {
        case: standard_runs.figures(Job(DEFAULT, case, parameters=knob))["iae_temperature_c_s"]
        for case in CASES
    }
    return errors | {"temperature_gain": Loops(DEFAULT, knob).gain("thermal_gain_c_per_kw")}


def wins() -> dict[str, Any]:
    """Figures of the default NMPC at or below both PI tunings' everywhere."""
    processes = {name: SWEEP[name] for name in ("nominal", *FIXED)}
    welds = [
        (name, case, noise)
        for name in processes
        for case in (*CASES, *VALIDATION_CASES)
        for noise in (False, True)
    ]
    jobs = [
        Job(label, case, noise, processes[name])
        for name, case, noise in welds
        for label in FINALISTS
    ]
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
                data["losses"].append(
                    [name, Path(case).stem, noise, title, own / best if best > 0.0 else math.inf]
                )
    return data


def on_model(factors: dict[str, float], evaluations: int) -> dict[str, Any]:
    """Tune for one model and run all three controllers on it, without noise.

    The judged figures by controller.
    """
    parameters = paper_model().scaled(**factors)
    plant = {f"factors.{name}": factor for name, factor in factors.items()}
    with TemporaryDirectory() as scratch:
        file = Path(scratch) / "model.yaml"
        file.write_text(yaml.safe_dump(dict(parameters)), encoding="utf-8")
        own: dict[str, dict[str, Any]] = {
            f"decentral:{name}": dict(tune(name, parameters, evaluations)) for name in NAMES
        }
        own[DEFAULT] = {"model_file": str(file)}
        return {
            label: standard_runs.judged(
                {
                    case: standard_runs.figures(Job(label, case, plant=plant, parameters=values))
                    for case in CASES
                }
            )
            for label, values in own.items()
        }


def other_models(count: int) -> dict[str, Any]:
    """`on_model` on `count` models, on all cores, with 600 evaluations of each search."""
    data = {}
    drawn = random_factors(count, MODELS)
    with ProgressBar("other models", count) as bar:
        for i, runs in enumerate(
            standard_runs.on_all_cores(partial(on_model, evaluations=600), drawn), start=1
        ):
            runs[DEFAULT]["factors"] = drawn[i - 1]
            data[f"{i}"] = runs
            bar(i)
    return data
