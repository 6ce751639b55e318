#!/usr/bin/env python3
"""Depth on a machine that deflects and grows.

True errors, detection of faulty channels, false isolations.

usage: depth.py [--quick] [--json FILE]

Machines, copper and noise are drawn by seeds that did not tune the estimator (from 5000 on).
"""

from __future__ import annotations

import json
import math
import tempfile
from itertools import product
from math import pi
from pathlib import Path
from typing import Any, NamedTuple

import _benchmark
import numpy as np
import pandas as pd
from scipy.stats import norm

from fsw.footprint_command import footprint_of
from fsw_analysis.report import numbers
from fsw_analysis.weld_signals import WeldSignals
from fsw_control.depth_bank import DepthBank
from fsw_control.depth_channels import CHANNELS, ChannelHealth, DepthFusionSettings
from fsw_control.depth_fusion import DepthEstimate
from fsw_control.sensors import DEPTH_CHANNELS
from fsw_control.weld import TICK_S
from fsw_plant.canister import CanisterParameters
from fsw_plant.parameters import Tool
from fsw_scenario import scenario_file
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make_all

#: first machine (a seed) that is measured
FIRST = 5000
#: largest error that the aim permits [mm]
AIM_MM = 0.05
#: seconds within which a faulty channel is to be named
NAMED_S = 3.0
CONTROLLERS = ("decentral:tight", "nmpc:default")
#: what the depth comes from: the axial position alone, or all four channels
ONE, FOUR = "axial", "four"
#: ranges of the machine's parameters; chosen
MACHINE = {
    "compliance_mm_per_kn": (0.02, 0.04),
    "tool_growth_mm_per_kw": (0.001, 0.005),
    "tool_growth_s": (400.0, 900.0),
    "canister_growth_mm_per_kw": (0.0005, 0.002),
    "canister_growth_s": (1000.0, 2000.0),
    "hardness": (0.95, 1.05),
    "hardness_variation": (0.01, 0.03),
    "runout_mm": (0.0, 0.01),
    "swelling_mm_per_mm": (0.0, 0.2),
    "edge_mm": (-0.2, 0.2),
    "edge_at_mm": (60.0, 160.0),
}
#: standard deviations of a sensor's bias on a machine, and of its change from weld to weld; chosen
BIAS_MM, CHANGE_MM = 0.02, 0.005
#: places of a footprint [deg], and standard deviation of its depths
EVERY_DEG, MEASURED_MM = 2.0, 0.01
#: by name, a fault as an entry of a scenario
FAULTS: dict[str, dict[str, Any]] = {
    "slip 2 mm": {"kind": "bias", "magnitude_mm": 2.0},
    "slip 0.3 mm": {"kind": "bias", "magnitude_mm": 0.3},
    "slip 0.1 mm": {"kind": "bias", "magnitude_mm": -0.1},
    "drift 0.02 mm/s": {"kind": "drift", "magnitude_mm": 0.02},
    "drift 0.002 mm/s": {"kind": "drift", "magnitude_mm": 0.002},
    "spike 1 mm, every second": {"kind": "spike", "magnitude_mm": 1.0, "duration_s": 600.0},
    "stuck": {"kind": "freeze"},
    "stuck from the start": {"kind": "freeze", "at_s": TICK_S},
    "dust 0.1 mm": {"kind": "dust", "magnitude_mm": 0.1},
    "dropout": {"kind": "dropout"},
    "not a number": {"kind": "nan"},
    "out of range": {"kind": "bias", "magnitude_mm": 5.0},
}
#: time of a fault, and length of its weld [s]
AT_S, FAULTY_S = 30.0, 100.0
#: slips near an edge: mm, or share of the edge's height
SLIPS = {"2 mm": 2.0, "0.3 mm": 0.3, "-0.1 mm": -0.1}
SHARES = {"as high as the edge": 1.0, "hides the edge": -1.0}
#: of such an edge: ranges of height, with either sign, and place; chosen. Time between it and the
#: slip, and of the weld after both [s]
EDGE_MM, EDGE_AT_MM, NEAR_S, AFTER_S = (0.03, 0.2), (90.0, 150.0), 1.0, 15.0
#: drifts for which the least possible delay is given [mm/s]
DRIFTS = (0.02, 0.002)
#: ticks of the joint line, and welds in which a sound channel may be isolated once
WELD_TICKS, WELDS = 24_000, 200


class Size(NamedTuple):
    """How much is measured."""

    machines: int = 6  #: welded on by each controller
    faulty: int = 3  #: welds of each fault in each channel
    near: int = 4  #: welds of each slip near an edge in each channel
    sound: int = 200  #: welds without a fault
    seconds: float = 600.0  #: length of a weld without a fault


QUICK = Size(1, 1, 1, 2, 60.0)


class Case(NamedTuple):
    """A weld to be made."""

    machine: int
    weld: int  #: of the machine: seed of noise and changes
    seconds: float
    controller: str = CONTROLLERS[0]
    source: str = FOUR
    fault: str = ""
    channel: str = ""  #: row of the table of sensors that fails
    event: dict[str, Any] = {}  #: replaces the fault's own entry
    edge: dict[str, float] = {}  #: replaces what the machine draws
    footprint: str = ""  #: file


def scenario_of(case: Case) -> Any:
    """The weld as a scenario.

    Constant set-points, the machine's biases as faults of its sensors.
    """
    draws = np.random.default_rng(case.machine)
    machine: dict[str, Any] = {name: float(draws.uniform(*ends)) for name, ends in MACHINE.items()}
    biases = {name: draws.normal(0.0, BIAS_MM) for name in DEPTH_CHANNELS}
    change = np.random.default_rng([case.machine, case.weld])
    for name in biases:
        biases[name] += change.normal(0.0, CHANGE_MM)
    if case.source == ONE:
        machine["depth_sensor"] = "depth_axial"
        biases = {"depth": biases["depth_axial"]}
    machine |= {"depth_channels": case.source == FOUR, "footprint_file": case.footprint}
    machine |= case.edge
    events = [
        {"at_s": TICK_S, "fault": {"sensor": name, "kind": "bias", "magnitude_mm": float(bias)}}
        for name, bias in biases.items()
        if name != case.channel
    ]
    if case.channel:
        own = {"sensor": case.channel, **(case.event or FAULTS[case.fault])}
        events.append({"at_s": own.pop("at_s", AT_S), "fault": own})
    content = {
        "name": "depth",
        "description": "constant set-points on a machine that deflects and grows",
        "duration_s": case.seconds,
        "controller": case.controller.partition(":")[0],
        "plant": {"seed": 10_000 * case.weld + case.machine, "machine": machine},
        "events": events,
    }
    return scenario_file.read(content, "depth")


def welded(case: Case) -> tuple[WeldSignals, list[DepthEstimate]]:
    """Make the weld; returns its signals, and what the depth rested on at each tick."""
    scenario = scenario_of(case)
    loop = ClosedLoop(scenario, make_all(scenario, case.controller, {}))
    estimates: dict[int, DepthEstimate] = {}
    measure = loop.plant.measure

    def noted(stamp_ns: int | None = None) -> Any:
        reading = measure(stamp_ns)
        if reading.fused is not None:
            estimates[reading.tick] = reading.fused
        return reading

    loop.plant.measure = noted  # type: ignore[method-assign]
    signals = loop.run()
    circumference_mm = 2.0 * pi * CanisterParameters().outer_radius_mm
    mm_per_s = Tool().traverse_mm_per_min / 60.0
    signals.angle_deg = 360.0 * mm_per_s * signals.time_s / circumference_mm
    return signals, list(estimates.values())


def error_mm(signals: WeldSignals) -> np.ndarray:
    """True depth less its set-point."""
    assert signals.truth is not None
    return signals.truth.depth_mm - signals.reference_depth_mm


def accuracy(task: tuple[str, int, str, str, float]) -> list[dict[str, Any]]:
    """Errors of a weld without and with the footprint of the weld before it."""
    folder, machine, controller, source, seconds = task
    before, _ = welded(Case(machine, 0, seconds, controller, source))
    assert before.truth is not None
    at_deg = np.arange(0.0, before.angle_deg[-1], EVERY_DEG)
    noise = np.random.default_rng([machine, 99]).normal(0.0, MEASURED_MM, at_deg.size)
    depths = np.interp(at_deg, before.angle_deg, before.truth.depth_mm) + noise
    footprint = footprint_of(before, at_deg, depths, ("before", "0" * 64), MEASURED_MM)
    file = Path(folder) / f"{machine}_{controller}_{source}.json"
    file.write_text(json.dumps(footprint.model_dump()), encoding="utf-8")
    rows = []
    for path in ("", str(file)):
        case = Case(machine, 1, seconds, controller, source, footprint=path)
        signals, _ = welded(case)
        error = error_mm(signals)
        shown = signals.depth_mm - signals.reference_depth_mm
        rows.append(
            {
                "controller": controller,
                "source": source,
                "footprint": bool(path),
                "seconds": seconds,
                "worst_mm": float(np.abs(error).max()),
                "error_99_mm": float(np.quantile(np.abs(error), 0.99)),
                "inside": float((np.abs(error) <= AIM_MM).mean()),
                "shown_99_mm": float(np.nanquantile(np.abs(shown), 0.99)),
            }
        )
    return rows


#: what a channel is called that is not simply good
_BLAMED = frozenset(ChannelHealth) - {ChannelHealth.GOOD, ChannelHealth.SUSPECT}
_FOR_GOOD = frozenset({ChannelHealth.SLIP, ChannelHealth.DRIFT})


def named_at(states: list[ChannelHealth], first: int) -> int | None:
    """First tick at which a channel was blamed, but for steps that proved to be an edge."""
    bad = [state in _BLAMED for state in states] + [True]
    k = first
    while k < len(states):
        end = bad.index(False, k) if bad[k] and False in bad[k:] else len(states)
        if bad[k] and (end == len(states) or ChannelHealth.STEPPED not in states[k:end]):
            return k
        k = end if bad[k] else k + 1
    return None


def least_delay_s(channel: str, mm_per_s: float) -> float:
    """Time in which the best test of a drift of known begin and rate finds half of all cases.

    By Neyman and Pearson, on the white innovations of the estimator's own model: their mean under
    the drift, in standard deviations, must reach the threshold that a sound weld rarely exceeds.
    """
    bank, k = DepthBank(DepthFusionSettings(), CHANNELS), list(CHANNELS).index(channel)
    used, shown, seen, tick = np.ones(len(CHANNELS), bool), np.zeros(len(CHANNELS)), 0.0, 0
    bank.start(0.0)
    before = round(AT_S / TICK_S)
    enough = norm.isf(1.0 / (WELDS * WELD_TICKS * len(CHANNELS))) ** 2
    while seen < enough:
        tick += 1
        shown[k] = mm_per_s * TICK_S * max(tick - before, 0)
        bank.predict(TICK_S, math.nan)
        bank.innovate(shown, 0.0)
        seen += float(bank.z[0] @ np.linalg.solve(bank.s[0] + np.diag(bank.noise), bank.z[0]))
        bank.correct(used)
    return (tick - before) * TICK_S


def faulty(case: Case) -> dict[str, Any]:
    """What became of a weld with a faulty channel, or with none."""
    signals, estimates = welded(case)
    channel = DEPTH_CHANNELS.get(case.channel)
    first = round((case.event or FAULTS.get(case.fault, {})).get("at_s", AT_S) / TICK_S) - 1
    named = (
        named_at([estimate.health[channel] for estimate in estimates], first) if channel else None
    )
    others = {
        name
        for estimate in estimates
        for name, health in estimate.health.items()
        if name != channel and health in _FOR_GOOD
    }
    error = np.abs(error_mm(signals))[first if channel else 0 :]
    return {
        "fault": case.fault,
        "channel": channel or "",
        "delay_s": None if named is None else (named - first) * TICK_S,
        "others": len(others),
        "inside": float((error <= AIM_MM).mean()),
        "worst_mm": float(error.max()),
        "suspect_s": TICK_S
        * sum(ChannelHealth.SUSPECT in estimate.health.values() for estimate in estimates),
    }


def by_source(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Errors by controller, sensors and footprint: over all welds, the worst last."""
    welds = pd.DataFrame(rows).groupby(["controller", "source", "footprint"], sort=False)
    table = welds.agg(
        welds=("seconds", "size"),
        seconds=("seconds", "first"),
        shown_99_mm=("shown_99_mm", "median"),
        error_99_mm=("error_99_mm", "median"),
        worst_mm=("worst_mm", "max"),
        inside=("inside", lambda shares: shares.to_numpy().mean()),
        least_inside=("inside", "min"),
    )
    return _benchmark.records(table.reset_index())


def near_edge(machine: int, slip: str, channel: str) -> Case:
    """A weld in which a channel slips within ``NEAR_S`` of the time at which it meets an edge."""
    draws = np.random.default_rng([machine, 48])
    height_mm = float(draws.uniform(*EDGE_MM) * draws.choice((-1.0, 1.0)))
    at_mm, apart_s = float(draws.uniform(*EDGE_AT_MM)), float(draws.uniform(-NEAR_S, NEAR_S))
    row, mm_per_s = CHANNELS[DEPTH_CHANNELS[channel]], Tool().traverse_mm_per_min / 60.0
    met_s = (at_mm - (row.lead_mm if row.rides else 0.0)) / mm_per_s
    slip_mm = SLIPS[slip] if slip in SLIPS else SHARES[slip] * height_mm
    event = {"kind": "bias", "magnitude_mm": slip_mm, "at_s": round(met_s + apart_s, 1)}
    seconds = round(max(met_s, at_mm / mm_per_s) + AFTER_S)
    edge = {"edge_mm": height_mm, "edge_at_mm": at_mm}
    return Case(machine, 1, seconds, fault=slip, channel=channel, event=event, edge=edge)


def by_fault(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Delays and errors of each fault, over channels and machines."""
    welds = pd.DataFrame(rows).astype({"delay_s": float})
    welds["in_time"], welds["blames_others"] = welds.delay_s <= NAMED_S, welds.others > 0
    table = welds.groupby("fault", sort=False).agg(
        welds=("fault", "size"),
        named=("delay_s", "count"),
        in_time=("in_time", "sum"),
        median_s=("delay_s", "median"),
        worst_s=("delay_s", "max"),
        others=("blames_others", "sum"),
        inside=("inside", lambda shares: shares.to_numpy().mean()),
        least_inside=("inside", "min"),
        worst_mm=("worst_mm", "max"),
    )
    return _benchmark.records(table.reset_index())


def tables_of(size: Size, folder: str) -> dict[str, Any]:
    """Make all welds; returns the tables."""
    tables: dict[str, Any] = {}
    kinds = product(range(size.faulty), FAULTS, DEPTH_CHANNELS)
    cases = [
        Case(FIRST + 100 + k, 1, FAULTY_S, fault=fault, channel=channel)
        for k, (_, fault, channel) in enumerate(kinds)
    ]
    tables["by_channel"] = _benchmark.each(faulty, cases, "faults:")
    tables["faults"] = by_fault(tables["by_channel"])
    tables["bounds"] = {
        f"{rate:g}": {name: least_delay_s(name, rate) for name in CHANNELS} for rate in DRIFTS
    }
    slips = product(range(size.near), (*SLIPS, *SHARES), DEPTH_CHANNELS)
    near = [near_edge(FIRST + 3000 + k, *slip) for k, (_, *slip) in enumerate(slips)]
    rows = tables["edges_by_channel"] = _benchmark.each(faulty, near, "near an edge:")
    tables["edges"] = by_fault(rows)
    cases = [Case(FIRST + 1000 + k, 1, size.seconds) for k in range(size.sound)]
    sound = _benchmark.each(faulty, cases, "sound:")
    tables["sound"] = {
        "welds": len(sound),
        "seconds": size.seconds,
        "isolated": sum(row["others"] > 0 for row in sound),
        "suspect_s": sum(row["suspect_s"] for row in sound),
        "inside": float(np.mean([row["inside"] for row in sound])),
    }
    tasks = [
        (folder, FIRST + machine, controller, source, size.seconds)
        for machine, controller, source in product(range(size.machines), CONTROLLERS, (ONE, FOUR))
    ]
    welds = _benchmark.each(accuracy, tasks, "accuracy:")
    tables["accuracy"] = by_source([row for rows in welds for row in rows])
    return tables


def draw(rows: list[dict[str, Any]], file: Path) -> None:
    """Shown and true error of each controller, by sensors and footprint."""
    from fsw_analysis.figure_style import BLUE, legend_below, sheet

    labels = [
        f"{row['controller']}, {row['source']}{', footprint' if row['footprint'] else ''}"
        for row in rows
    ]
    place = np.arange(len(rows))
    with sheet(9.0, 3.6, file) as figure:
        axes = figure.subplots()
        shown = {"facecolor": "white", "edgecolor": BLUE, "hatch": "////"}
        axes.barh(place - 0.2, [row["error_99_mm"] for row in rows], 0.4, label="true")
        axes.barh(place + 0.2, [row["shown_99_mm"] for row in rows], 0.4, label="shown", **shown)
        axes.axvline(AIM_MM, color="k", linestyle=":", label="aim")
        axes.set_yticks(place, labels)
        axes.invert_yaxis()
        axes.set_xlabel("depth error, 99 % of the weld within [mm], median of the welds")
        legend_below(figure)


def figures_of(tables: dict[str, Any]) -> dict[str, Any]:
    """Flat figures of the tables."""
    errors = {
        (row["controller"], f"{row['source']}{' with footprint' if row['footprint'] else ''}"): {
            key: row[key] for key in ("error_99_mm", "worst_mm", "inside")
        }
        for row in tables["accuracy"]
    }
    faults = {
        row["fault"]: {
            key: row[key] for key in ("named", "median_s", "worst_s", "others", "inside")
        }
        for row in (*tables["faults"], *tables["edges"])
    }
    bounds = {
        f"least delay, {rate} mm/s, {name}": {"s": delay_s}
        for rate, delays in tables["bounds"].items()
        for name, delay_s in delays.items()
    }
    return _benchmark.flat(errors | faults | bounds | {"sound": tables["sound"]})


def measure(quick: bool) -> tuple[dict[str, Any], dict[str, Any]]:
    """Figures, and the content of the page; writes tables and figure."""
    with tempfile.TemporaryDirectory() as folder:
        tables = tables_of(QUICK if quick else Size(), folder)
    if not quick:
        file = _benchmark.RESULTS / "depth_tables.json"
        file.write_text(numbers(tables), encoding="utf-8")
        draw(tables["accuracy"], file.with_name("depth.png"))
    page = {**tables, "aim_mm": AIM_MM, "named_s": NAMED_S, "machine": MACHINE}
    return figures_of(tables), page


if __name__ == "__main__":
    _benchmark.run(__doc__, "a few short welds, no page", measure, "depth")
