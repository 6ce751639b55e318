#!/usr/bin/env python3
"""Gain of a perfectly known model, and of a bank of filters, over the identified model.

usage: known_model.py [--quick] [--json FILE]

Random plants that tuned nothing, as they are and with a process that changes in mid-weld.
"""

import tempfile
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import _benchmark
import numpy as np
import yaml
from identification import welded

import fsw
from controller_comparison.processes import random_factors
from fsw_control import Command
from fsw_control.weld import TICK_S
from fsw_model import nominal
from fsw_plant import PlantConfig
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make
from fsw_tuning.standard_cases import CASES, DEFAULT, scenario

#: random ones, of a seed that no tuning and no other page has; the first of them also change
PLANTS, CHANGING, SEED = 8, 2, 4711
MODELS = ("paper's", "identified", "bank", "true")
#: the bank's models about the identified one: factors on the thermal gain, added dead time [s];
#: how long it remembers, the largest innovation that counts in standard deviations; all chosen
GAINS, MORE_S, MEMORY_S, OUTLIER = (0.8, 1.0, 1.2), (0.0, 1.5), 20.0, 4.0
#: what the process changes to in mid-weld: factors on its parameters, and what is added to them
CHANGES = {
    "none": {},
    "thermal gain + 20 %": {"thermal_gain_c_per_kw": (1.2, 0.0)},
    "thermal gain − 20 %": {"thermal_gain_c_per_kw": (0.8, 0.0)},
    "dead time + 1.5 s": {"dead_time_s": (1.0, 1.5)},
    # between the bank's models
    "thermal gain + 10 %, dead time + 0.75 s": {
        "thermal_gain_c_per_kw": (1.1, 0.0),
        "dead_time_s": (1.0, 0.75),
    },
}
#: when, between the events of each case
CHANGED_S = {"tracking": 70.0, "disturbances": 70.0}
FIGURES = {
    "tracking depth": "set-points, depth",
    "tracking temperature": "set-points, temperature",
    "disturbances depth": "disturbances, depth",
    "disturbances temperature": "disturbances, temperature",
    "tracking moved": "speed moved",
}


class Task(NamedTuple):
    """A plant to be measured."""

    index: int
    factors: dict[str, float]


class Bank:
    """NMPCs with different models, all warm.

    The command is their mean by the likelihood of what was measured.
    """

    def __init__(self, controllers):
        self._controllers = controllers
        self._evidence = np.zeros(len(controllers))

    def __getattr__(self, name):
        return getattr(self._controllers[0], name)

    def reset(self, applied):
        """All of them."""
        self._evidence[:] = 0.0
        for controller in self._controllers:
            controller.reset(applied)

    def weights(self, time_s):
        """Weight of each: fading likelihoods of the innovations, an outlier's bounded."""
        for i, controller in enumerate(self._controllers):
            filtered = controller.library.state.estimator
            self._evidence[i] *= np.exp(-TICK_S / MEMORY_S)
            for innovation, variance in zip(filtered.innovation, filtered.expected, strict=True):
                if variance > 0.0:
                    square = min(innovation**2 / variance, OUTLIER**2)
                    self._evidence[i] -= 0.5 * (square + np.log(variance))
        likely = np.exp(self._evidence - self._evidence.max())
        return likely / likely.sum()

    def step(self, measurement, *arguments):
        """One tick of all."""
        proposals = [each.step(measurement, *arguments) for each in self._controllers]
        weights = self.weights(measurement.time_s)
        command = Command(*(weights @ np.array([proposal.command for proposal in proposals])))
        return replace(proposals[int(weights.argmax())], command=command)


class Informed(Bank):
    """A perfect bank: that of the model before the change, then that of the one after it."""

    def __init__(self, controllers, changed_s):
        super().__init__(controllers)
        self._changed_s = changed_s

    def weights(self, time_s):
        """All to the right one."""
        after = float(time_s > self._changed_s)
        return np.array([1.0 - after, after])


def changed(parameters, change):
    """Parameters after a change of the process."""
    return parameters.changed(
        **{name: k * getattr(parameters, name) + more for name, (k, more) in change.items()}
    )


def loop_of(case, plant, controller, change):
    """A weld whose process changes between two events."""
    loop = ClosedLoop(scenario(case, plant, "nmpc"), {"nmpc": controller})
    if change:
        emulator, advance = loop.plant, loop.plant.step
        before = emulator.config
        model = changed(before.model, change)
        factors = {f"factors.{k}": getattr(model, k) / getattr(nominal(), k) for k in change}
        after = PlantConfig.from_values({**before.values, **factors})

        def step():
            if emulator.time_s > CHANGED_S[case] and emulator.config is before:
                emulator.reconfigure(after)
            advance()

        emulator.step = step
    return loop


def figures_of(signals, begin_s):
    """Errors and movement from a time on."""
    late = signals.time_s > begin_s
    truth = signals.truth
    errors = {
        "depth": truth.depth_mm - signals.reference_depth_mm,
        "temperature": truth.temperature_c - signals.reference_temperature_c,
    }
    integrals = {name: TICK_S * float(np.abs(of[late]).sum()) for name, of in errors.items()}
    return integrals | {"moved": float(np.abs(np.diff(signals.speed_rpm[late])).sum())}


def measured(task):
    """Figures by change, model and case."""
    plant = {"seed": task.index + 1, **task.factors}
    known = fsw.identify(welded("identify_closed_loop", plant)).parameters
    factors = {name.removeprefix("factors."): of for name, of in task.factors.items()}
    models = {
        "paper's": nominal(),
        "identified": known,
        "true": nominal().scaled(**factors),
    }
    figures = {}
    with tempfile.TemporaryDirectory() as folder:

        def controller(model):
            file = Path(folder) / "model.yaml"
            differ = {k: v for k, v in model if v != getattr(nominal(), k)}
            file.write_text(yaml.safe_dump(differ), encoding="utf-8")
            return make(DEFAULT, {"model_file": str(file)} if differ else {})

        def welder(name, change, case):
            if name == "bank":
                around = [
                    {"thermal_gain_c_per_kw": (gain, 0.0), "dead_time_s": (1.0, more_s)}
                    for gain in GAINS
                    for more_s in MORE_S
                ]
                return Bank([controller(changed(known, change)) for change in around])
            single = controller(models[name])
            if name == "true" and change:
                after = controller(changed(models[name], change))
                return Informed((single, after), CHANGED_S[case])
            return single

        for kind, name, case in product(CHANGES, MODELS, CASES):
            change = CHANGES[kind]
            if change and name == "paper's":
                continue
            if task.index >= CHANGING and (change or name == "bank"):
                continue
            signals = loop_of(case, plant, welder(name, change, case), change).run()
            values = figures_of(signals, CHANGED_S[case] if change else 0.0)
            figures |= {(kind, name, f"{case} {key}"): of for key, of in values.items()}
    return figures


def table_of(rows):
    """By change, model and figure: median and worst ratio to that with the true model."""
    table = {}
    for kind in CHANGES:
        for name in MODELS[:-1]:
            own = [row for row in rows if (kind, name, "tracking depth") in row]
            for key in FIGURES if own else ():
                ratios = [row[kind, name, key] / row[kind, MODELS[-1], key] for row in own]
                table.setdefault((kind, name), {})[key] = (float(np.median(ratios)), max(ratios))
    return table


def measure(quick):
    """Figures, and the content of the page."""
    plants = random_factors(2 if quick else PLANTS, seed=SEED)
    tasks = [Task(i, factors) for i, factors in enumerate(plants)]
    table = table_of(_benchmark.each(measured, tasks, "plants:"))
    figures = {
        (*names, key): dict(zip(("median", "worst"), both, strict=True))
        for names, of in table.items()
        for key, both in of.items()
    }
    return _benchmark.flat(figures), globals() | {"ratio_table": table}


if __name__ == "__main__":
    _benchmark.run(__doc__, "two plants, no page", measure, "known-model")
