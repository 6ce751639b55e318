"""Runs welds of a campaign, in a worker."""

from __future__ import annotations

import gc
import json
import time
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from fsw_analysis.judgement import judge
from fsw_analysis.kpi import compute
from fsw_analysis.weld_signals import FloatArray, WeldSignals
from fsw_campaign import definition
from fsw_campaign.definition import ERRORS, Campaign, Entrant
from fsw_campaign.programme_signals import with_programme
from fsw_campaign.software import versions
from fsw_control.contract import Controller
from fsw_control.weld import TICK_S
from fsw_scenario.closed_loop import ClosedLoop

Row = dict[str, Any]
#: possible outcomes of a weld
OK, DIVERGED, ERROR = "ok", "diverged", "error"


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
