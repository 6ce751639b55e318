"""Runs of one controller on one case, many at a time."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from fsw_analysis.kpi import compute
from fsw_analysis.weld_signals import WeldSignals
from fsw_control.contract import Command, Controller
from fsw_experiment.closed_loop import ClosedLoop
from fsw_experiment.comparison.cases import scenario
from fsw_experiment.controllers import make

#: Key in ``fsw_analysis.kpi``, and its title.
KPIS = (
    ("iae_depth_mm_s", "IAE depth [mm s]"),
    ("iae_temperature_c_s", "IAE temperature [°C s]"),
    ("ise_depth_mm2_s", "ISE depth [mm² s]"),
    ("ise_temperature_c2_s", "ISE temperature [°C² s]"),
    ("peak_temperature_in_depth_step_up_c", "peak T, depth step up [°C]"),
    ("peak_temperature_in_depth_step_down_c", "peak T, depth step down [°C]"),
    ("peak_depth_in_temperature_step_mm", "peak z, temperature step [µm]"),
    ("peak_temperature_after_depth_disturbance_c", "peak T, depth disturbance [°C]"),
    ("peak_depth_after_temperature_disturbance_mm", "peak z, temperature disturbance [µm]"),
    ("total_variation_force_kn", "total variation force [kN]"),
    ("total_variation_speed_rpm", "total variation speed [rpm]"),
)
VARIATIONS = ("total_variation_force_kn", "total_variation_speed_rpm")
#: An output still swings when, over the last `_LAST` ticks, it moves by more than this.
_SWINGS_MM, _SWINGS_C, _LAST = 0.01, 1.0, 150

Figures = dict[str, Any]


@dataclass(frozen=True)
class Job:
    """One controller on one case.

    Attributes
    ----------
    controller : str
        Name and variant, e.g. ``nmpc:paper``.
    case : str
    noise : bool
    plant : mapping of str to float
        Parameters of the plant that differ from its defaults.
    """

    controller: str
    case: str
    noise: bool = False
    plant: Mapping[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.controller}, {self.case}{', noise' if self.noise else ''}"


@cache
def _controller(label: str) -> Controller:
    return make(label)


def weld(job: Job) -> WeldSignals:
    """Run a job and return all signals."""
    name = job.controller.partition(":")[0]
    made = scenario(job.case, {"noise": job.noise, **job.plant}, name)
    return ClosedLoop(made, {name: _controller(job.controller)}).run()


def figures(job: Job) -> Figures:
    """Run a job and return its figures of merit, with the swing that remains at the end."""
    signals = weld(job)
    found = compute(signals, job.controller)
    truth = signals.truth
    assert truth is not None  # a simulation has it
    depth, temperature = (
        (truth.depth_mm - signals.reference_depth_mm)[-_LAST:],
        (truth.temperature_c - signals.reference_temperature_c)[-_LAST:],
    )
    found["swings"] = bool(np.ptp(depth) > _SWINGS_MM or np.ptp(temperature) > _SWINGS_C)
    return found


def figures_or_error(job: Job) -> Figures:
    """As `figures`; a plant that cannot be run gives ``{"error": text}``."""
    try:
        return figures(job)
    except ValueError as error:
        return {"error": str(error)}


def run_all(
    jobs: Sequence[Job], progress: Callable[[str], None], work: Callable[[Job], Figures] = figures_or_error
) -> Iterator[Figures]:
    """Run jobs on all cores; results come in their order."""
    if len(jobs) < 8:  # not worth starting processes
        for job in jobs:
            progress(str(job))
            yield work(job)
        return
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for job, found in zip(jobs, pool.map(work, jobs, chunksize=4), strict=True):
            progress(str(job))
            yield found


class LateDrives:
    """A plant whose drives get their commands some ticks late; all else is the plant's.

    Parameters
    ----------
    plant : PlantEmulator
    force_ticks, speed_ticks : int
    start : Command
        What the drives hold until the first command arrives.
    """

    def __init__(self, plant: Any, force_ticks: int, speed_ticks: int, start: Command) -> None:
        self._plant = plant
        self._force = deque([start.force_kn] * force_ticks)
        self._speed = deque([start.speed_rpm] * speed_ticks)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plant, name)

    def apply(self, command: Command, stamp_ns: int, source: str) -> None:
        """Queue a command, and apply what is due."""
        self._force.append(command.force_kn)
        self._speed.append(command.speed_rpm)
        self._plant.apply(Command(self._force.popleft(), self._speed.popleft()), stamp_ns, source)


def is_stable(controller: str, plant: Mapping[str, float], force_ticks: int = 0, speed_ticks: int = 0) -> bool:
    """Whether small steps of both set-points die out, without noise.

    Parameters
    ----------
    controller : str
    plant : mapping of str to float
        Parameters of the plant.
    force_ticks, speed_ticks : int
        By how much the drives are late.
    """
    name = controller.partition(":")[0]
    loop = ClosedLoop(scenario("small_steps", {"noise": False, **plant}, name), {name: _controller(controller)})
    loop.plant = LateDrives(loop.plant, force_ticks, speed_ticks, loop.plant.applied)  # type: ignore[assignment]
    signals = loop.run()
    truth = signals.truth
    assert truth is not None
    for value, floor in ((truth.depth_mm, 1e-4), (truth.temperature_c, 1e-2)):
        earlier, later = np.ptp(value[-1200:-600]), np.ptp(value[-600:])
        if later > max(0.9 * earlier, floor):
            return False
    return True
