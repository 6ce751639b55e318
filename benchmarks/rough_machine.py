#!/usr/bin/env python3
"""Coarse or noisy sensors and slow drives.

The NMPC with and without what identification sees of them.

usage: rough_machine.py [--quick] [--json FILE]

Each machine is welded once for its identification; the controllers then weld the standard cases.
"""

import tempfile
from math import nan
from pathlib import Path
from typing import NamedTuple

import _benchmark
import numpy as np
from identification import welded

import fsw
from controller_comparison.processes import random_factors
from fsw_analysis.kpi import compute
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make, name_of
from fsw_tuning.standard_cases import CASES, CONSERVATIVE, DEFAULT, TIGHT, scenario
from fsw_tuning.standard_runs import JUDGED

#: a third of the rates that the controllers take the drives to have
SLOW = {"limits.force_rate_kn_per_s": 10.0 / 3.0, "limits.speed_rate_rpm_per_s": 10.0}
NOISY = {
    "sensors.depth_noise_mm": 8e-3,
    "sensors.torque_noise_nm": 8.0,
    "sensors.temperature_noise_c": 0.4,
}
COARSE = {"sensors.temperature_resolution_c": 1.0}
SILENT = "drives a third as fast, no feedback"  #: to the controllers; the identified weld has it
KINDS = {
    "as the controllers take it": {},
    "temperature in steps of 1 °C": COARSE,
    "noise × 4": NOISY,
    "drives a third as fast": SLOW,
    SILENT: SLOW,
    "all three": COARSE | NOISY | SLOW,
}
RIVALS = (TIGHT, CONSERVATIVE)
NMPCS = ("model", "model and machine")  #: files that the NMPC has
PLANTS = 5  #: random ones
MOST = 1.1  #: ratio to the better PI
SICKER = 0.01  #: share of a weld's ticks


class Task(NamedTuple):
    """A machine to be measured."""

    kind: str
    index: int
    factors: dict[str, float]


class Silent:
    """A controller to which the drives report nothing."""

    def __init__(self, controller):
        self._controller = controller

    def __getattr__(self, name):
        return getattr(self._controller, name)

    def step(self, measurement, *arguments):
        """One tick, without the acting inputs."""
        return self._controller.step(measurement._replace(force_kn=nan, speed_rpm=nan), *arguments)


def figures_of(label, case, plant, parameters, silent):
    """Figures of a weld, and the share of its ticks without a healthy proposal."""
    name = name_of(label)
    controller = make(label, parameters)
    loop = ClosedLoop(
        scenario(case, plant, name), {name: Silent(controller) if silent else controller}
    )
    signals = loop.run()
    return compute(signals), float(np.mean(~signals.proposals[name].healthy.astype(bool)))


def measured(task):
    """Judged figures of the controllers on a machine."""
    plant = {"seed": task.index + 1, **task.factors, **KINDS[task.kind]}
    known = fsw.identify(welded("identify_closed_loop", plant))
    row = {"task": task, "machine": known.machine}
    with tempfile.TemporaryDirectory() as folder:
        model, machine = Path(folder) / "model.yaml", Path(folder) / "machine.yaml"
        model.write_text(known.text, encoding="utf-8")
        machine.write_text(known.machine.text, encoding="utf-8")
        files = {"model_file": str(model)}
        runs = {label: (label, {}) for label in RIVALS} | {
            NMPCS[0]: (DEFAULT, files),
            NMPCS[1]: (DEFAULT, files | {"machine_file": str(machine)}),
        }
        for name, (label, parameters) in runs.items():
            for case in CASES:
                values, unhealthy = figures_of(label, case, plant, parameters, task.kind == SILENT)
                keys = [key for key in JUDGED if key.startswith(f"{case} ")]
                row |= {(name, key): values[key.partition(" ")[2]] for key in keys}
                row[name, f"{case} unhealthy"] = unhealthy
                row[name, f"{case} moved"] = values["total_variation_speed_rpm"]
    return row


def ratios(rows, name, key):
    """Of each machine the NMPC's figure over the better PI's."""
    return [row[name, key] / min(row[rival, key] for rival in RIVALS) for row in rows]


def figures(rows):
    """By kind and NMPC: median and worst of the ratios, speed moved, share of unhealthy ticks."""
    table = {}
    for kind in dict.fromkeys(row["task"].kind for row in rows):
        own = [row for row in rows if row["task"].kind == kind]
        for name in NMPCS:
            values = {key: ratios(own, name, key) for key in JUDGED}
            moved = [row[name, "tracking moved"] / row[TIGHT, "tracking moved"] for row in own]
            worst = max(row[name, f"{case} unhealthy"] for row in own for case in CASES)
            table[kind, name] = {
                **{key: (float(np.median(of)), max(of)) for key, of in values.items()},
                "moved": float(np.median(moved)),
                "unhealthy": worst,
                "lost": sum(ratio > MOST for of in values.values() for ratio in of),
            }
    return table


def measure(quick):
    """Figures, and the content of the page."""
    kinds = ("noise × 4", "drives a third as fast") if quick else KINDS
    plants = random_factors(1 if quick else PLANTS)
    tasks = [Task(kind, i, factors) for kind in kinds for i, factors in enumerate(plants)]
    table = figures(_benchmark.each(measured, tasks, "machines:"))
    flat = {
        f"{kind}: {name}: {key}": value[1] if isinstance(value, tuple) else value
        for (kind, name), values in table.items()
        for key, value in values.items()
    }
    return flat, globals() | {"ratio_table": table}


if __name__ == "__main__":
    _benchmark.run(
        __doc__, "noise and slow drives on one plant, no page", measure, "rough-machines"
    )
