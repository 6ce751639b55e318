"""Welds of the campaign ``realistic``, and the statistics of groups of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fsw_analysis.weld_signals import WeldSignals
from fsw_campaign.definition import Campaign, Entrant, load
from fsw_campaign.distributions import Normal
from fsw_campaign.welds import versions
from fsw_control.schema.models import InputError
from fsw_control.weld import TICK_S
from fsw_plant import PlantConfig
from fsw_plant.process import prepare
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.scenario import Scenario
from fsw_scenario.weld_programme import spans
from fsw_tuning.standard_runs import on_all_cores

Row = dict[str, Any]
PHASE = "joint_line"
#: sizes and times of the disturbances, by path in the scenario
FALL = "events[3].disturbance.amplitude_c"
HEAT, HEAT_S = "events[0].disturbance.amplitude_c", "events[0].disturbance.period_s"
TORQUE, TORQUE_S = "events[1].disturbance.amplitude_nm", "events[1].disturbance.period_s"
#: scatter between welds, by name: the path that the campaign has a distribution of
SCATTER = {
    f"{path} scatter": path
    for path in ("plant.canister.tool_share", "plant.factors.sliding_friction", FALL, HEAT)
}
TOOL_SCATTER, FRICTION_SCATTER, FALL_SCATTER, HEAT_SCATTER = SCATTER
#: see ``fit.py``; chosen ones are varied
FITTED = (FALL, HEAT)
CHOSEN = (HEAT_S, HEAT_SCATTER, FALL_SCATTER, TORQUE, TORQUE_S, TOOL_SCATTER, FRICTION_SCATTER)
#: welds of a published group, groups drawn from the emulated welds with replacement
GROUP, GROUPS = 8, 2000


@dataclass(frozen=True)
class Task:
    """A weld to be made."""

    controller: str
    index: int  #: of the campaign
    changes: tuple[tuple[str, float], ...] = ()  #: factor on a parameter, by its name

    @property
    def key(self) -> tuple[Any, ...]:
        """What tells the weld from others."""
        return self.controller, self.index, self.changes


@cache
def campaign() -> Campaign:
    """The shipped campaign."""
    return load("realistic")


def at(content: Any, path: str) -> Any:
    """Value at a path of the scenario file."""
    for step in path.replace("[", ".").replace("]", "").split("."):
        content = content[int(step)] if isinstance(content, list) else content[step]
    return content


def law_of(path: str) -> Normal:
    """The campaign's distribution of a parameter."""
    law = campaign().distributions[path].normal
    assert law is not None
    return law


def scenario_of(task: Task) -> Scenario:
    """The weld of a task, up to the end of the joint line."""
    source, entrant = campaign(), Entrant(controller=task.controller)
    drawn = source.parameters(task.index)
    for name, factor in task.changes:
        if path := SCATTER.get(name):
            mean = law_of(path).mean
            drawn[path] = mean + factor * (drawn[path] - mean)
        else:
            drawn[name] = factor * (drawn[name] if name in drawn else at(source.scenario, name))
    names = [phase["name"] for phase in source.scenario["phases"]]
    short = {**source.scenario, "phases": source.scenario["phases"][: names.index(PHASE) + 1]}
    return source.model_copy(update={"scenario": short}).weld(drawn, entrant)


def joint_line(task: Task) -> tuple[WeldSignals, NDArray[np.bool_], str]:
    """Signals of a weld, which of their ticks are on the joint line, and why it stopped."""
    scenario = scenario_of(task)
    controllers = campaign().controllers(scenario, Entrant(controller=task.controller))
    loop = ClosedLoop(scenario, controllers)
    signals = loop.run()
    begin_s, end_s = next(
        span[1:] for span in spans(scenario.phases, signals.n_ticks * TICK_S) if span[0] == PHASE
    )
    inside = (signals.time_s > begin_s) & (signals.time_s <= end_s)
    return signals, inside, loop.plant.stopped


def weld(task: Task) -> Row:
    """Statistics of the measured temperature on the joint line, and a weld's other figures."""
    signals, inside, stopped = joint_line(task)
    truth = signals.truth
    assert truth is not None
    error_c = (signals.temperature_c - signals.reference_temperature_c)[inside]
    depth_mm = (truth.depth_mm - signals.reference_depth_mm)[inside]
    power_kw = truth.process_power_kw[inside]
    minute = round(60.0 / TICK_S)
    return {
        **asdict(task),
        "stopped": stopped,
        "seconds": error_c.size * TICK_S,
        "mean_c": float(error_c.mean()),
        "square_c2": float(np.square(error_c).mean()),
        "min_c": float(error_c.min()),
        "max_c": float(error_c.max()),
        "depth_um": 1e3 * float(np.sqrt(np.square(depth_mm).mean())),
        "moved_rpm_per_min": float(np.abs(np.diff(signals.speed_rpm[inside])).sum())
        / (error_c.size * TICK_S / 60.0),
        "power_kw": [float(power_kw[:minute].mean()), float(power_kw[-minute:].mean())],
    }


def each(
    function: Callable[[Task], Any],
    tasks: Sequence[Task],
    workers: int,
    progress: Callable[[float], None],
) -> Iterator[Any]:
    """Results of a function of each task, in order."""
    prepare(PlantConfig.from_values(scenario_of(tasks[0]).plant))
    for done, result in enumerate(on_all_cores(function, tasks, workers=workers), start=1):
        progress(done)
        yield result


def run(
    tasks: Sequence[Task], file: Path, workers: int, progress: Callable[[float], None]
) -> None:
    """Make the welds that a file of rows lacks."""
    there = {_key(row) for row in read(file)} if file.exists() else set()
    software = f"{versions()}, campaign {campaign().digest}"
    missing = [task for task in tasks if task.key not in there]
    if missing:
        with file.open("a", encoding="utf-8") as out:
            for row in each(weld, missing, workers, progress):
                out.write(json.dumps(row | {"software": software}) + "\n")
                out.flush()


def _key(row: Row) -> tuple[Any, ...]:
    return row["controller"], row["index"], tuple((path, value) for path, value in row["changes"])


def read(file: Path) -> list[Row]:
    """The rows of a file; InputError if they are of several versions of the software."""
    rows = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    if len({row["software"] for row in rows}) > 1:
        raise InputError(f"{file}: rows of several versions of the software; give another --out")
    return rows


Figures = NDArray[np.float64]
#: of a group, in this order
STATISTICS = ("mean", "sigma", "min", "max")


def pooled(figures: Figures) -> Figures:
    """Statistics of groups from their welds' (..., welds, 4): mean, square, min, max."""
    mean = figures[..., 0].mean(-1)
    sigma = np.sqrt(np.maximum(figures[..., 1].mean(-1) - mean**2, 0.0))
    return np.stack([mean, sigma, figures[..., 2].min(-1), figures[..., 3].max(-1)], -1)


def groups(rows: Sequence[Row], size: int) -> Figures:
    """Statistics of :data:`GROUPS` groups that are drawn from the welds with replacement."""
    names = ("mean_c", "square_c2", "min_c", "max_c")
    return grouped(np.array([[row[name] for name in names] for row in rows]), size)


def grouped(figures: Figures, size: int) -> Figures:
    """Statistics of groups, from mean, square, min and max of each weld."""
    drawn = np.random.default_rng(1).integers(len(figures), size=(GROUPS, size))
    return pooled(figures[drawn])


def intervals(statistics: Figures) -> dict[str, list[float]]:
    """2.5 %, 50 % and 97.5 % of each statistic."""
    return {
        name: [float(value) for value in np.percentile(statistics[:, i], (2.5, 50.0, 97.5))]
        for i, name in enumerate(STATISTICS)
    }


def shipped_values() -> dict[str, float]:
    """Fitted and chosen values as shipped: of a scatter, the deviation before it is truncated."""
    scenario, laws = campaign().scenario, campaign().distributions
    return {
        name: law_of(SCATTER[name]).deviation
        if name in SCATTER
        else law_of(name).mean
        if name in laws
        else float(at(scenario, name))
        for name in (*FITTED, *CHOSEN)
    }
