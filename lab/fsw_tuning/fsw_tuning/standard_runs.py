"""Runs of controllers on standard cases and other processes, in parallel; evaluation."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cache
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fsw_analysis.kpi import compute
from fsw_analysis.weld_signals import WeldSignals
from fsw_control.contract import Controller
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make, name_of
from fsw_tuning.standard_cases import CASES, CONSERVATIVE, scenario

#: An output moves if it does by more than this over the last `_LAST` ticks; after `_SETTLE_S`
#: more, it oscillates.
_SWINGS_MM, _SWINGS_C, _LAST = 0.01, 1.0, 150
_SETTLE_S = 60.0
#: The four figures of merit by which processes are compared: case and figure, and what it means.
JUDGED = {
    "tracking iae_depth_mm_s": "set-points, depth",
    "tracking iae_temperature_c_s": "set-points, temperature",
    "disturbances iae_depth_mm_s": "disturbances, depth",
    "disturbances iae_temperature_c_s": "disturbances, temperature",
}

Figures = dict[str, Any]
T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True)
class Job:
    """One controller, e.g. ``nmpc:paper``, on one case, with parameters of both."""

    controller: str
    case: str
    noise: bool = False
    plant: Mapping[str, float | str] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def __hash__(self) -> int:
        return hash(
            (self.controller, self.case, self.noise, *self.plant.items(), *self.parameters.items())
        )


@cache
def _controller(label: str, *parameters: tuple[str, Any]) -> Controller:
    return make(label, dict(parameters))


def loop_of(job: Job) -> ClosedLoop:
    """Controller and plant of a job, ready to run."""
    name = name_of(job.controller)
    made = scenario(job.case, {"noise": job.noise, **job.plant}, name)
    return ClosedLoop(made, {name: _controller(job.controller, *job.parameters.items())})


def weld(job: Job) -> WeldSignals:
    """Run a job and return all signals."""
    return loop_of(job).run()


def figures(job: Job) -> Figures:
    """Run a job and return its figures of merit, and whether an output oscillates for good.

    What still moves at the end may only be settling or following the noise: then the same weld is
    run without noise and continued by a minute without events.
    """
    signals = weld(job)
    swings = _moves(signals)
    if swings:
        loop = loop_of(replace(job, noise=False))
        loop.scenario = loop.scenario.model_copy(
            update={"duration_s": loop.scenario.duration_s + _SETTLE_S}
        )
        swings = _moves(loop.run())
    return compute(signals, job.controller) | {"swings": swings}


def _moves(signals: WeldSignals) -> bool:
    """Whether an output moves at the end."""
    truth = signals.truth
    assert truth is not None  # a simulation has it
    depth = (truth.depth_mm - signals.reference_depth_mm)[-_LAST:]
    temperature = (truth.temperature_c - signals.reference_temperature_c)[-_LAST:]
    return bool(np.ptp(depth) > _SWINGS_MM or np.ptp(temperature) > _SWINGS_C)


def _figures_or_error(job: Job) -> Figures:
    try:
        return figures(job)
    except ValueError as error:
        return {"error": str(error)}


def on_all_cores(
    function: Callable[[T], R], jobs: Sequence[T], chunksize: int = 1, workers: int | None = None
) -> Iterator[R]:
    """Results of a function for all jobs, in their order, by one process per processor or so many.

    They are spawned, because forked ones would share DDS and locks. Ctrl-C reaches the caller
    alone; when it takes no more results, the processes are ended.
    """
    pool = ProcessPoolExecutor(workers or os.cpu_count(), mp_context=get_context("spawn"))
    handler = signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # inherited by the processes, which ``map`` starts
    try:
        others = active_children()
        results = pool.map(function, jobs, chunksize=chunksize)
        processes = [child for child in active_children() if child not in others]
    finally:
        signal.signal(signal.SIGINT, handler)
    try:
        yield from results
    except BaseException:
        for process in processes:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def run_all(
    jobs: Sequence[Job], progress: Callable[[float], None] | None = None
) -> dict[Job, Figures]:
    """Run jobs on all cores; a plant that cannot be run gives ``{"error": text}``.

    ``progress`` gets the share done.
    """
    results = {}
    # a few jobs take less time than the start of processes
    work = (
        map(_figures_or_error, jobs)
        if len(jobs) < 8
        else on_all_cores(_figures_or_error, jobs, chunksize=4)
    )
    for job, result in zip(jobs, work, strict=True):
        results[job] = result
        if progress is not None:
            progress(len(results) / len(jobs))
    return results


def judged(runs: Mapping[str, Figures]) -> Figures:
    """The judged figures of a controller's runs by case, and whether an output oscillates.

    Or the error of one.
    """
    for run in runs.values():
        if "error" in run:
            return {"error": run["error"]}
    values = {key: runs[key.split()[0]][key.split()[1]] for key in JUDGED}
    return values | {"swings": any(run["swings"] for run in runs.values())}


def failed(runs: Mapping[str, Figures]) -> str | None:
    """Why a process could not be run with every controller, or None."""
    return next((run["error"] for run in runs.values() if "error" in run), None)


def sweep(
    controllers: Mapping[str, Mapping[str, Any]],
    processes: Mapping[str, Mapping[str, float | str]],
    progress: Callable[[float], None] | None = None,
) -> dict[str, dict[str, Figures]]:
    """Judged figures of controllers, by label with their parameters, on processes.

    Sensor noise on.
    """
    jobs = {
        (process, label, case): Job(label, case, True, plant, parameters)
        for process, plant in processes.items()
        for label, parameters in controllers.items()
        for case in CASES
    }
    results = run_all(list(jobs.values()), progress)
    return {
        process: {
            label: judged({case: results[jobs[process, label, case]] for case in CASES})
            for label in controllers
        }
        for process in processes
    }


_BETTER: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 8.0}
_WORSE = _BETTER | {"fontweight": "bold"}
#: logarithm of a ratio whose colour is too dark for black text
_DARK = 1.0


def draw_sweep(data: Mapping[str, Any], path: Path) -> None:
    """Draw the IAE of all other controllers over that of the conservative PI, per process.

    Bold: larger.
    """
    from fsw_analysis.figure_style import sheet  # takes a second to import

    plants = [name for name, runs in data.items() if not failed(runs)]
    others = [label for label in next(iter(data.values())) if label != CONSERVATIVE]
    with sheet(11.0, 0.32 * len(plants) + 2.2, path) as canvas:
        axes = canvas.subplots(1, len(others), sharey=True)
        for axis, label in zip(axes, others, strict=True):
            table = np.array(
                [
                    [data[p][label][key] / data[p][CONSERVATIVE][key] for key in JUDGED]
                    for p in plants
                ]
            )
            axis.grid(visible=False)
            image = axis.imshow(np.log2(table), cmap="RdBu_r", vmin=-1.5, vmax=1.5, aspect="auto")
            for (row, column), value in np.ndenumerate(table):
                style = _WORSE if round(value, 2) > 1.0 else _BETTER
                shade = "white" if abs(np.log2(value)) > _DARK else "black"
                axis.text(column, row, f"{value:.2f}", color=shade, **style)
            axis.set_title(f"{label}: IAE\nover {CONSERVATIVE}", fontsize=9.0)
            axis.set_xticks(
                range(len(JUDGED)), JUDGED.values(), rotation=30.0, ha="right", fontsize=8.0
            )
            axis.set_yticks(range(len(plants)), plants)
        bar = canvas.colorbar(image, ax=axes, ticks=[-1, 0, 1], shrink=0.6)
        bar.ax.set_yticklabels(["half", "equal", "double"])
        bar.ax.set_title("bold:\nlarger", fontsize=8.0)
