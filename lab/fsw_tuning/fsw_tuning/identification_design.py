"""Proposes an experiment for identification.

Informative steps of set-points or inputs within bounds.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml

from fsw_control.weld import DEPTH_MM, TEMPERATURE_C
from fsw_identification.estimation import expected_deviations
from fsw_identification.weld_data import prepare
from fsw_model import ModelParameters, ProcessModel, nominal
from fsw_plant.config import PlantConfig
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make
from fsw_scenario.scenario import OPEN_LOOP
from fsw_scenario.scenario_file import parse
from fsw_tuning.decentral_loop import NOISE

#: bounds of an experiment about the operating point
SAFE_MM, SAFE_C = 0.15, 8.0
#: shares of the bounds that the modelled process may use, in closed loop and in open loop: in
#: closed loop room is left for processes that differ from the model; in open loop none can be,
#: because only the model knows the steady state
_SHARES = {True: (0.6, 0.45), False: (0.75, 0.75)}
#: relative standard deviations to aim for, by which experiments are compared
AIMS = {
    "thermal_gain_c_per_kw": 0.02,
    "depth_gain_mm_per_kn_s": 0.02,
    "copper_lag_s": 0.04,
    "tool_lag_s": 0.04,
    "dead_time_s": 0.05 / nominal().dead_time_s,
    "depth_zero_s": 0.05,
    "depth_pole_slow_s": 0.05,
    "softening_per_c": 0.05,
    "motor_lag_s": 0.05,
    "sliding_friction": 0.02,
}
_CONTROLLER = "decentral:conservative"
#: how long a level may be held [s]; longer for inputs that act on the temperature
_HOLD_S = {
    "depth_mm": (4, 8, 12, 20),
    "temperature_c": (8, 16, 30),
    "force_kn": (3, 6, 10, 15),
    "speed_rpm": (5, 9, 14),
}
_CLOSED, _OPEN = {"depth_mm": 0.06, "temperature_c": 4.0}, {"force_kn": 1.5, "speed_rpm": 6.0}
#: first event and quiet time at the end [s]
_BEGIN_S, _QUIET_S = 5, 5
_ROUNDS = 5


@dataclass(frozen=True, slots=True)
class Proposal:
    """An experiment, its expected relative deviations, and how far it moves the process."""

    scenario: str
    deviations: dict[str, float]
    depth_mm: float
    temperature_c: float

    def use(self, closed: bool) -> tuple[float, float]:
        """Used share of the permitted part of the bounds, of depth and of temperature."""
        return self.depth_mm / SAFE_MM / _SHARES[closed][0], self.temperature_c / SAFE_C / _SHARES[
            closed
        ][1]


def propose(
    duration_s: float,
    closed: bool,
    model: ModelParameters,
    tries: int = 24,
    progress: Callable[[float], None] | None = None,
) -> Proposal:
    """The best random binary sequence, by the largest ratio of a deviation to its aim.

    ``closed``: set-points are stepped under the decentralized controller; otherwise force and
    speed, without controller. ``model`` is the process as far as it is known. ``progress`` is
    called with the share done.
    """

    def worst(proposal: Proposal) -> float:
        beyond = max(
            0.0, max(proposal.use(closed)) - 1.0
        )  # only if nothing stays within the share of the bounds
        return max(proposal.deviations[name] / aim for name, aim in AIMS.items()) + 100.0 * beyond

    # Random binary sequences excite all frequencies; which one separates parameters best is hard
    # to foresee, so that the best of some is taken (minimax over the aims).
    proposals = []
    for seed in range(tries):
        proposals.append(_bounded(seed, duration_s, closed, model))
        if progress is not None:
            progress((seed + 1) / tries)
    return min(proposals, key=worst)


def _bounded(seed: int, duration_s: float, closed: bool, model: ModelParameters) -> Proposal:
    """A sequence with amplitudes at which the modelled process uses its share of the bounds."""
    rest = ProcessModel(model).equilibrium(DEPTH_MM, TEMPERATURE_C)
    centre = {"depth_mm": DEPTH_MM, "temperature_c": TEMPERATURE_C}
    centre |= {"force_kn": rest.force_kn, "speed_rpm": rest.speed_rpm}
    plant = plant_factors(model)
    sizes = dict(_CLOSED if closed else _OPEN)
    for _ in range(_ROUNDS):
        proposal = assess(_scenario(seed, duration_s, sizes, centre, closed), plant)
        use = proposal.use(closed)
        if min(use) > 0.85 and max(use) <= 1.0:
            break
        # the first input is mostly for the depth, the second for the temperature
        sizes = {
            name: size * min(0.95 / share, 1.5)
            for (name, size), share in zip(sizes.items(), use, strict=True)
        }
        sizes = {name: float(f"{size:.2g}") for name, size in sizes.items()}
    return proposal


def _scenario(
    seed: int, duration_s: float, sizes: dict[str, float], centre: dict[str, float], closed: bool
) -> str:
    generator = random.Random(seed)
    events: dict[float, dict[str, float]] = {}
    for name, size in sizes.items():
        at_s, sign, last = float(_BEGIN_S), generator.choice((-1, 1)), 0
        while at_s < duration_s - _QUIET_S:
            # a level and its opposite for as long, so that what integrates returns
            hold_s = generator.choice(_HOLD_S[name])
            for level in (sign, -sign):
                if level != last and at_s < duration_s - _QUIET_S:
                    events.setdefault(at_s, {})[name] = round(centre[name] + level * size, 4)
                    last = level
                at_s += hold_s
            sign = generator.choice((-1, 1))
    kind = "reference" if closed else "command"
    content: dict[str, Any] = {
        "name": f"identify_{'closed' if closed else 'open'}_loop",
        "description": "Experiment for identification: steps chosen by their information on the "
        "nominal model; proposed by fsw.py identify --design.",
        "duration_s": duration_s,
        "controller": "decentral" if closed else OPEN_LOOP,
        "events": [{"at_s": at_s, kind: events[at_s]} for at_s in sorted(events)],
    }
    return yaml.safe_dump(content, sort_keys=False, width=120, default_flow_style=None)


def plant_factors(model: ModelParameters) -> dict[str, float]:
    """Parameters of the plant emulator that make it the process of a model."""
    usual = dict(nominal())
    return {
        f"factors.{name}": v / usual[name] for name, v in dict(model).items() if v != usual[name]
    }


def assess(text: str, plant: dict[str, float] | None = None) -> Proposal:
    """Accuracy to expect of an experiment on a process, and how far it moves the process.

    Without noise.
    """
    overrides = [
        "plant.noise=false",
        *(f"plant.{name}={value!r}" for name, value in (plant or {}).items()),
    ]
    scenario = parse(text, "design", overrides)
    controllers = {} if scenario.open_loop else {scenario.controller: make(_CONTROLLER)}
    signals = ClosedLoop(scenario, controllers).run()
    assert signals.truth is not None  # a simulation has it
    config = PlantConfig.from_values(scenario.plant)
    segments = prepare(signals, config["actuators.lag_s"]).segments
    depth_mm = float(np.abs(signals.truth.depth_mm - DEPTH_MM).max())
    temperature_c = float(np.abs(signals.truth.temperature_c - TEMPERATURE_C).max())
    return Proposal(
        text, expected_deviations(segments, config.model, np.array(NOISE)), depth_mm, temperature_c
    )
