"""Runs welds of a campaign, in a worker; and what a row says of the software that made it."""

from __future__ import annotations

import gc
import hashlib
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, lru_cache
from importlib.metadata import PackageNotFoundError, version
from platform import python_version
from typing import Any

import numpy as np

from fsw_analysis.judgement import judge
from fsw_analysis.kpi import compute
from fsw_analysis.weld_signals import FloatArray, WeldEvent, WeldSignals
from fsw_campaign import definition
from fsw_campaign.definition import ERRORS, Campaign, Entrant
from fsw_control.contract import Controller
from fsw_control.weld import TICK_S
from fsw_recorder.recording import code_sha256
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.scenario import Scenario
from fsw_scenario.weld_programme import READING_AGE_TICKS, PhaseMachine, Progress, State

Row = dict[str, Any]
#: possible outcomes of a weld
OK, DIVERGED, ERROR = "ok", "diverged", "error"
#: packages that compute and judge a weld
PACKAGES = (
    "fsw_model",
    "fsw_control",
    "fsw_nmpc",
    "fsw_decentral",
    "fsw_plant",
    "fsw_supervisor",
    "fsw_analysis",
    "fsw_scenario",
    "fsw_campaign",
    "fsw_recorder",  # the last has the signatures
)


@cache
def versions() -> str:
    """Versions of packages, and a digest of the code that computes and judges a weld."""
    try:
        own = version("fsw-control")
    except PackageNotFoundError:  # imported from the source tree
        own = "source"
    code = hashlib.sha256("".join(map(code_sha256, PACKAGES)).encode()).hexdigest()[:16]
    parts = {"fsw_control": own, "code": code}
    parts |= {name: version(name) for name in ("numpy", "casadi")} | {"python": python_version()}
    return ", ".join(f"{name} {value}" for name, value in parts.items())


@lru_cache(maxsize=2)
def _campaign(text: str) -> Campaign:
    return definition.read(json.loads(text))


@lru_cache(maxsize=32)
def _controllers(text: str, label: str, names: tuple[str, ...]) -> dict[str, Controller]:
    campaign = _campaign(text)
    entrant = next(entrant for entrant in campaign.entrants if entrant.label == label)
    return campaign.controllers(campaign.weld({}, entrant), entrant)


def run_batch(
    text: str, batch: Sequence[tuple[int, Mapping[str, Any], Sequence[str]]]
) -> list[Row]:
    """Run welds one after the other and return their rows of the dataset.

    Parameters
    ----------
    text : str
        Of the campaign, see ``Campaign.text``.
    batch : sequence of (int, mapping, sequence of str)
        Number of a weld, its parameters by path, and the labels of the controllers to run.
    """
    campaign = _campaign(text)
    entrants = {entrant.label: entrant for entrant in campaign.entrants}
    gc.disable()  # a weld makes many objects and no reference cycles
    try:
        return [
            run_weld(campaign, index, parameters, entrants[label])
            for index, parameters, labels in batch
            for label in labels
        ]
    finally:
        gc.enable()


def run_weld(
    campaign: Campaign, index: int, parameters: Mapping[str, Any], entrant: Entrant
) -> Row:
    """Run one weld; returns a row in any case."""
    began = time.perf_counter()
    row: Row = {
        "index": index,
        "controller": entrant.label,
        "reason": "",
        "inside": False,
        **parameters,
    }
    try:
        scenario = campaign.weld(parameters, entrant)
        loop = ClosedLoop(
            scenario, _controllers(campaign.text, entrant.label, scenario.controllers)
        )
        signals = loop.run()
        row |= _figures(signals)
        inside = [
            _outside(signals, name, limit, row) <= limit.at_most_s
            for name, limit in campaign.limits.items()
        ]
        row["status"] = DIVERGED if loop.plant.stopped else OK
        row["reason"] = loop.plant.stopped
        decided = judge(with_programme(signals, scenario), campaign.book, recorded=False).deciding
        row["verdict"], row["rule"] = str(decided.verdict), decided.name
        row["inside"] = all(inside) and not loop.plant.stopped
    except Exception as error:  # one weld of thousands may fail in any way, the others go on
        row["status"], row["reason"] = (
            ERROR,
            f"{type(error).__name__}: {' '.join(str(error).split())}",
        )
    row["versions"] = versions()
    row["wall_time_s"] = time.perf_counter() - began
    return row


def _figures(signals: WeldSignals) -> Row:
    """Figures of merit under names that do not depend on the controller."""
    figures = compute(signals)
    for key in ("label", "controllers", "outputs"):
        del figures[key]
    selected = signals.command_source[0] if signals.n_ticks else ""
    for key in [key for key in figures if key.startswith("solve_time_")]:
        value, prefix = figures.pop(key), f"solve_time_{selected}_"
        if key.startswith(prefix):
            figures[f"solve_time_{key.removeprefix(prefix)}"] = value
    return figures


def _outside(signals: WeldSignals, name: str, limit: definition.Limit, row: Row) -> float:
    """Time outside a limit [s]; puts it and the extremes of the signal into the row."""
    values = _signal(signals, name)
    row[f"lowest_{name}"], row[f"highest_{name}"] = float(values.min()), float(values.max())
    row[f"outside_{name}_s"] = outside_s = round(int(np.sum(~limit.hold(values))) * TICK_S, 9)
    return outside_s


def _signal(signals: WeldSignals, name: str) -> FloatArray:
    truth = getattr(signals.truth, ERRORS.get(name, name))
    reference = getattr(signals, f"reference_{ERRORS[name]}") if name in ERRORS else 0.0
    values: FloatArray = truth - reference
    return values


def progress(scenario: Scenario, signals: WeldSignals) -> list[Progress]:
    """Progress of the programme at each tick; the player gets thermocouple readings late."""
    machine, reports = PhaseMachine(scenario.phases), []
    shown = signals.temperature_c.tolist()
    readings = [*shown[:1] * READING_AGE_TICKS, *shown]
    for tick in range(1, signals.n_ticks + 1):
        machine.follow(tick, readings[tick - 1])
        reports.append(machine.progress())
    return reports


def with_programme(signals: WeldSignals, scenario: Scenario) -> WeldSignals:
    """Signals with phases, positions and end of the weld as in a bag; unchanged without phases."""
    if not scenario.phases or not signals.n_ticks:
        return signals
    reports = list(zip(signals.time_s.tolist(), progress(scenario, signals), strict=True))
    phases = [(reports[0][1].phase, reports[0][0])]
    for time_s, report in reports:
        if report.phase != phases[-1][0]:
            phases.append((report.phase, time_s))
    events = [*signals.events, *(WeldEvent(time_s, "phase", name) for name, time_s in phases)]
    done = [time_s for time_s, report in reports if report.state is State.DONE]
    events += [WeldEvent(time_s, "weld", str(State.DONE)) for time_s in done[:1]]
    events.sort(key=lambda event: event.time_s)
    places = np.array([(report.angle_deg, report.length_mm) for _, report in reports])
    return replace(
        signals, phases=phases, angle_deg=places[:, 0], travel_mm=places[:, 1], events=events
    )
