"""The four controllers on canisters that none of them knows: figures of each phase of each weld, as lines of JSON."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np

from fsw_analysis.phase_kpi import compute
from fsw_analysis.weld_signals import WeldSignals
from fsw_campaign.definition import Campaign, Entrant, load
from fsw_campaign.software import versions
from fsw_control import weld
from fsw_control.schema.models import InputError
from fsw_control.weld import TICK_S
from fsw_model import OperatingPointError
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.scenario import Scenario
from fsw_scenario.weld_programme import spans

Row = dict[str, Any]
#: within which a phase must stay, but for some seconds: the process window, and errors (chosen)
WINDOW_C = (weld.QUALITY_TEMPERATURE_MIN_C, weld.QUALITY_TEMPERATURE_MAX_C)
DEPTH_MM, TEMPERATURE_C, AT_MOST_S = weld.QUALITY_DEPTH_MM, 10.0, 5.0
#: how near the end of its range the spindle counts as saturated
_NEAR_RPM = 0.3


def phase_rows(scenario: Scenario, signals: WeldSignals) -> Iterator[Row]:
    """Figures of each phase, from the truth."""
    truth = signals.truth
    assert truth is not None
    wrong_c = truth.temperature_c - signals.reference_temperature_c
    low_c, high_c = WINDOW_C
    cold = (wrong_c < -TEMPERATURE_C) | (truth.temperature_c < low_c)
    outside = cold | (wrong_c > TEMPERATURE_C) | (truth.temperature_c > high_c)
    outside |= np.abs(truth.depth_mm - signals.reference_depth_mm) > DEPTH_MM
    fast = signals.speed_rpm > weld.SPEED_MAX_RPM - _NEAR_RPM
    parts = [  # a tick earlier: the set-point at a boundary is that of the later phase
        (name, begin_s - TICK_S, end_s - TICK_S)
        for name, begin_s, end_s in spans(scenario.phases, signals.n_ticks * TICK_S)
    ]
    for (phase, begin_s, end_s), errors in zip(parts, compute(signals, "", parts), strict=False):
        inside = (signals.time_s > begin_s + 1e-6) & (signals.time_s <= end_s + 1e-6)
        temperature, depth = errors.in_force_temperature_c, errors.in_force_depth_mm
        if temperature is None or depth is None:
            continue
        outside_s = float(outside[inside].sum() * TICK_S)
        yield {
            "phase": phase,
            "seconds": float(inside.sum() * TICK_S),
            "temperature_sigma_c": hypot(temperature.mean, temperature.sigma),
            "temperature_peak_c": max(-temperature.low, temperature.high),
            "depth_sigma_mm": hypot(depth.mean, depth.sigma),
            "depth_peak_mm": max(-depth.low, depth.high),
            "moved_kn": float(np.abs(np.diff(signals.force_kn[inside])).sum()),
            "moved_rpm": float(np.abs(np.diff(signals.speed_rpm[inside])).sum()),
            "fastest_s": float(fast[inside].sum() * TICK_S),
            "power_kw": errors.power_kw,
            "cold_s": float(cold[inside].sum() * TICK_S),
            "outside_s": outside_s,
            "good": outside_s <= AT_MOST_S,
        }


def run_weld(campaign: Campaign, index: int, entrant: Entrant) -> list[Row]:
    """The rows of a weld; one with ``stopped`` where it could not be welded to its end."""
    scenario = campaign.weld(campaign.parameters(index), entrant)
    who = {"index": index, "controller": entrant.label, "software": versions()}
    try:
        loop = ClosedLoop(scenario, campaign.controllers(scenario, entrant))
    except OperatingPointError as error:
        return [who | {"phase": "", "stopped": str(error)}]
    signals = loop.run()
    if loop.plant.stopped:
        return [who | {"phase": "", "stopped": loop.plant.stopped}]
    return [who | row for row in phase_rows(scenario, signals)]


def run(file: Path, welds: Sequence[int], minutes: float, controllers: Sequence[str] = ()) -> None:
    """Add the missing welds to a file of rows, canister by canister, for so long."""
    campaign, until_s = load("canisters"), time.monotonic() + 60.0 * minutes
    done = {(row["index"], row["controller"]) for row in read([file])} if file.exists() else set()
    for index in welds:
        for entrant in campaign.entrants:
            if (index, entrant.label) in done or (
                controllers and entrant.label not in controllers
            ):
                continue
            if time.monotonic() > until_s:
                return
            rows = run_weld(campaign, index, entrant)
            with file.open("a", encoding="utf-8") as out:
                out.writelines(json.dumps(row) + "\n" for row in rows)


def read(files: Sequence[Path]) -> list[Row]:
    """The rows of files.

    Raises
    ------
    InputError
        If they are of several versions of the software.
    """
    rows = [
        json.loads(line)
        for file in files
        for line in file.read_text(encoding="utf-8").splitlines()
    ]
    if len(versions := sorted({row.get("software", "unknown") for row in rows})) > 1:
        raise InputError(
            f"{files[0].parent}: rows of several versions: {'; '.join(versions)}; give another --out"
        )
    return rows
