#!/usr/bin/env python3
"""Tunes the decentralized controller on the coupled process model and prints gains, robustness and KPIs.

Minimises the errors in set-point steps and output disturbances under three bounds: the peak Ms of the sensitivity of
each loop with the other one closed, and the size of the moves that sensor noise causes. Ms is that of the sampled,
coupled loop linearised about the operating point: the response of model and controller to an infinitesimal impulse
on one sensor, with the dead time, the rates and the coupling as they are, and one whole tick of delay added for
transport and actuators.

Without ``--write`` the tunings in the package stay as they are; with ``--check`` they are only assessed.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

if __name__ == "__main__":
    from _bootstrap import ensure

    ensure()

import numpy as np
from scipy.optimize import minimize

from fsw_control import Command, Measurement, Reference
from fsw_control.weld import DEPTH_MM, TEMPERATURE_C
from fsw_decentral import DecentralController, Gains, tunings
from fsw_model import ModelParameters, OperatingPointError, ProcessModel, nominal

STEP_S = 0.1
NOISE = (2e-3, 2.0, 0.1)  # mm, N m, degC: standard deviations of the sensors
RAD_PER_RPM = math.pi / 30.0

Row = tuple[float, float, float, float]  # measured depth, measured temperature, force, speed


@dataclass(frozen=True)
class Bounds:
    """What a set of gains may not exceed, and how much it weighs the disturbance of the other loop."""

    sensitivity: float
    force_move_kn: float
    speed_move_rpm: float
    coupling_weight: float


SETS = {
    "conservative": Bounds(sensitivity=1.6, force_move_kn=0.03, speed_move_rpm=0.5, coupling_weight=0.6),
    "tight": Bounds(sensitivity=2.0, force_move_kn=0.12, speed_move_rpm=0.8, coupling_weight=0.05),
}

#: where the search starts; what is not searched for stays as it is here
START = {
    "conservative": Gains(
        depth_gain=65.0,
        depth_integral_time=3.0,
        depth_derivative_time=0.0,
        depth_filter=0.5,
        depth_weight=1.0,
        depth_reference_filter=6.0,
        depth_tracking_time=0.75,
        temperature_gain=0.22,
        temperature_integral_time=33.0,
        temperature_filter=0.5,
        temperature_weight=1.0,
        temperature_reference_filter=3.0,
        temperature_tracking_time=16.0,
        power_gain=0.6,
        power_integral_time=2.0,
        power_filter=0.3,
        feedforward_filter=0.14,
    ),
    "tight": Gains(
        depth_gain=180.0,
        depth_integral_time=4.0,
        depth_derivative_time=0.0,
        depth_filter=0.3,
        depth_weight=0.1,
        depth_reference_filter=0.1,
        depth_tracking_time=1.0,
        temperature_gain=0.3,
        temperature_integral_time=36.0,
        temperature_filter=0.3,
        temperature_weight=1.0,
        temperature_reference_filter=0.1,
        temperature_tracking_time=18.0,
        power_gain=5.0,
        power_integral_time=2.0,
        power_filter=0.2,
        feedforward_filter=0.3,
    ),
}

#: searched for, one block after the other (the rest is fixed or follows by rule)
BLOCKS = (
    ("depth_gain", "depth_integral_time", "depth_weight", "depth_reference_filter"),
    ("temperature_gain", "temperature_integral_time", "temperature_weight", "temperature_reference_filter"),
    ("feedforward_filter", "power_gain", "depth_gain", "temperature_gain"),
)
LARGEST = {"depth_weight": 1.0, "temperature_weight": 1.0, "power_gain": 6.0}


class Loop:
    """Controller and process model in closed loop, as the plant runs them."""

    def __init__(self, gains: Gains, parameters: ModelParameters | None = None, latency_ticks: int = 0) -> None:
        self.model = _model(parameters or nominal())
        self.inertia = self.model.parameters.spindle_inertia_kgm2 * RAD_PER_RPM
        start = self.model.equilibrium(DEPTH_MM, TEMPERATURE_C)
        self.state = start.state.copy()
        self.controller = DecentralController(asdict(gains))
        self.queue = [Command(start.force_kn, start.speed_rpm)] * (2 + latency_ticks)
        self.controller.reset(self.queue[0])

    def run(
        self,
        ticks: int,
        reference: Callable[[float], Reference],
        disturbance: Callable[[int], tuple[float, float]] = lambda k: (0.0, 0.0),
        load: Callable[[int], tuple[float, float]] = lambda k: (0.0, 0.0),
        noise: random.Random | None = None,
    ) -> list[Row]:
        """Run from equilibrium; ``disturbance`` adds to measured depth and temperature, ``load`` to force and speed."""
        rows: list[Row] = []
        for k in range(ticks):
            now, (acting_before, acting) = self.queue[-1], self.queue[:2]
            force_more, speed_more = load(k)
            outputs = self.model.outputs(self.state, acting.force_kn + force_more, acting.speed_rpm + speed_more)
            depth_more, temperature_more = disturbance(k)
            depth = outputs.depth_mm + depth_more
            temperature = outputs.temperature_c + temperature_more
            rows.append((depth, temperature, now.force_kn, now.speed_rpm))
            torque = outputs.motor_torque_nm + self.inertia * (acting.speed_rpm - acting_before.speed_rpm) / STEP_S
            if noise is not None:
                depth += noise.gauss(0.0, NOISE[0])
                torque += noise.gauss(0.0, NOISE[1])
                temperature += noise.gauss(0.0, NOISE[2])
            measurement = Measurement(k * STEP_S, depth, torque, temperature)
            proposal = self.controller.step(measurement, reference(k * STEP_S), now, STEP_S)
            self.queue = [*self.queue[1:], proposal.command]
            acting = self.queue[1]
            self.model.step(self.state, acting.force_kn + force_more, acting.speed_rpm + speed_more)
        return rows


_models: dict[ModelParameters, ProcessModel] = {}


def _model(parameters: ModelParameters) -> ProcessModel:
    if parameters not in _models:
        _models[parameters] = ProcessModel(parameters)
    return _models[parameters]


def constant(_: float) -> Reference:
    """Reference at the operating point."""
    return Reference(DEPTH_MM, TEMPERATURE_C)


def steps(time_s: float) -> Reference:
    """Reference steps: +0.2 mm at 40 s, +10 degC at 80 s, -0.2 mm at 120 s, -10 degC at 160 s."""
    depth = DEPTH_MM + (0.2 if 40.0 <= time_s < 120.0 else 0.0)
    return Reference(depth, TEMPERATURE_C + (10.0 if 80.0 <= time_s < 160.0 else 0.0))


def disturbances(k: int) -> tuple[float, float]:
    """Output disturbances: +0.1 mm from 40 s, -5 degC from 100 s."""
    return (0.1 if k >= 400 else 0.0, -5.0 if k >= 1000 else 0.0)


def loads(k: int) -> tuple[float, float]:
    """Input disturbances: +2 kN from 5 s, +10 rpm from 65 s."""
    return (2.0 if k >= 50 else 0.0, 10.0 if k >= 650 else 0.0)


def sensitivity(gains: Gains, parameters: ModelParameters | None = None) -> tuple[float, float]:
    """Peak of the sensitivity of the depth loop and of the temperature loop, the other one closed; inf if unstable."""
    peaks = []
    for channel, size in enumerate((1e-5, 1e-4)):
        pulse = (size, 0.0) if channel == 0 else (0.0, size)
        try:
            loop = Loop(gains, parameters, latency_ticks=1)
            rows = loop.run(3010, constant, lambda k, pulse=pulse: pulse if k == 10 else (0.0, 0.0))
        except OperatingPointError:
            return math.inf, math.inf
        response = np.array([row[channel] for row in rows[10:]]) - (DEPTH_MM, TEMPERATURE_C)[channel]
        settled = np.abs(response[-500:]).max() < 1e-3 * size
        peaks.append(float(np.abs(np.fft.rfft(response / size)).max()) if settled else math.inf)
    return peaks[0], peaks[1]


def noise_moves(gains: Gains) -> tuple[float, float]:
    """Standard deviation of the moves per tick of force (kN) and speed (rpm) under sensor noise."""
    rows = np.array(Loop(gains).run(1000, constant, noise=random.Random(1)))
    moves = np.diff(rows[200:, 2:], axis=0)
    return float(moves[:, 0].std()), float(moves[:, 1].std())


def kpis(gains: Gains, parameters: ModelParameters | None = None) -> dict[str, float]:
    """Errors of a set of gains, noise-free: IAE in mm s and degC s, peaks of the other loop in degC and mm."""
    rows = np.array(Loop(gains, parameters).run(2000, steps))
    reference = [steps(k * STEP_S) for k in range(2000)]
    depth_error = rows[:, 0] - [r.depth_mm for r in reference]
    temperature_error = rows[:, 1] - [r.temperature_c for r in reference]
    result = {
        "tracking_iae_depth": float(np.abs(depth_error).sum() * STEP_S),
        "tracking_iae_temperature": float(np.abs(temperature_error).sum() * STEP_S),
        "peak_c_depth_up": float(np.abs(temperature_error[400:800]).max()),
        "peak_c_depth_down": float(np.abs(temperature_error[1200:1600]).max()),
        "peak_mm_temperature_step": float(np.abs(np.r_[depth_error[800:1200], depth_error[1600:]]).max()),
        "variation_force": float(np.abs(np.diff(rows[:, 2])).sum()),
        "variation_speed": float(np.abs(np.diff(rows[:, 3])).sum()),
    }
    rows = np.array(Loop(gains, parameters).run(1600, constant, disturbances))
    depth_error, temperature_error = rows[:, 0] - DEPTH_MM, rows[:, 1] - TEMPERATURE_C
    loaded = np.abs(
        np.array(Loop(gains, parameters).run(1400, constant, load=loads))[:, :2] - (DEPTH_MM, TEMPERATURE_C)
    )
    return result | {
        "load_iae_depth": float(loaded[:, 0].sum() * STEP_S),
        "load_iae_temperature": float(loaded[:, 1].sum() * STEP_S),
        "disturbance_iae_depth": float(np.abs(depth_error).sum() * STEP_S),
        "disturbance_iae_temperature": float(np.abs(temperature_error).sum() * STEP_S),
        "peak_c_depth_disturbance": float(np.abs(temperature_error[400:1000]).max()),
    }


def with_rules(gains: Gains) -> Gains:
    """Apply the rules that tie gains to each other."""
    return replace(
        gains,
        depth_tracking_time=round(gains.depth_integral_time / 4.0, 3),
        temperature_tracking_time=round(gains.temperature_integral_time / 2.0, 3),
    )


def cost(gains: Gains, bounds: Bounds) -> float:
    """Errors relative to a usual size, and a steep penalty beyond the bounds."""
    try:
        k = kpis(gains)
    except OperatingPointError:
        return math.inf
    errors = (
        k["tracking_iae_depth"] / 1.5
        + k["tracking_iae_temperature"] / 200.0
        + k["disturbance_iae_depth"] / 0.35
        + 2.0 * k["disturbance_iae_temperature"] / 45.0
        + 0.1 * k["load_iae_depth"] / 0.1
        + 0.1 * k["load_iae_temperature"] / 100.0
    )
    coupling = (k["peak_c_depth_up"] + k["peak_c_depth_down"] + k["peak_c_depth_disturbance"]) / 1.0 + k[
        "peak_mm_temperature_step"
    ] / 0.01
    moves = noise_moves(gains)
    # a little inside, so that the bounds hold after rounding
    excess = max(moves[0] / bounds.force_move_kn, moves[1] / bounds.speed_move_rpm, 0.985) - 0.985
    excess += max(max(sensitivity(gains)) / bounds.sensitivity, 0.985) - 0.985
    return errors + bounds.coupling_weight * coupling + 200.0 * min(excess, 1e3)


def tune(start: Gains, bounds: Bounds, evaluations: int) -> Gains:
    """Search from ``start`` block by block, twice, each by Nelder-Mead over the logarithms."""
    gains = start
    for block in BLOCKS * 2:

        def gains_of(x: np.ndarray, block: tuple[str, ...] = block, base: Gains = gains) -> Gains:
            values = {name: min(math.exp(v), LARGEST.get(name, math.inf)) for name, v in zip(block, x, strict=True)}
            return with_rules(replace(base, **values))

        x = np.log([max(getattr(gains, name), 0.05) for name in block])
        simplex = np.vstack([x, x + 0.4 * np.diag([-1.0 if name in LARGEST else 1.0 for name in block])])
        options = {"maxfev": evaluations // (2 * len(BLOCKS)), "initial_simplex": simplex, "xatol": 0.01, "fatol": 1e-3}
        x = minimize(lambda v, of=gains_of: cost(of(v), bounds), x, method="Nelder-Mead", options=options).x
        gains = gains_of(x)
    names = {name for block in BLOCKS for name in block}
    return with_rules(replace(gains, **{name: float(f"{getattr(gains, name):.3g}") for name in names}))


def assess(gains: Gains) -> dict[str, float]:
    """Return everything that is said of a set of gains."""
    peaks, moves = sensitivity(gains), noise_moves(gains)
    return {
        "ms_depth": peaks[0],
        "ms_temperature": peaks[1],
        "noise_move_kn": moves[0],
        "noise_move_rpm": moves[1],
    } | kpis(gains)


#: factors on model parameters
MISMATCH = {
    "dead time -20 %": {"dead_time_s": 0.8},
    "dead time +20 %": {"dead_time_s": 1.2},
    "thermal gain -20 %": {"thermal_gain_c_per_kw": 0.8},
    "thermal gain +20 %": {"thermal_gain_c_per_kw": 1.2},
    "depth gain +20 %": {"depth_gain_mm_per_kn_s": 1.2},
    "coupling x 1.5": {"softening_per_c": 1.5},
}


def report(sets: dict[str, Gains]) -> dict[str, dict[str, float]]:
    """Print gains and figures of the sets side by side; return the figures."""
    figures = {name: assess(gains) for name, gains in sets.items()}
    print(f"{'':32}" + "".join(f"{name:>14}" for name in sets))
    for field in fields(Gains):
        print(f"{field.name:32}" + "".join(f"{getattr(gains, field.name):14g}" for gains in sets.values()))
    print()
    for key in next(iter(figures.values())):
        print(f"{key:32}" + "".join(f"{figures[name][key]:14.4g}" for name in sets))
    print("\nMs depth / temperature and disturbance IAE mm s / degC s under mismatch")
    for label, factors in MISMATCH.items():
        cells = []
        for gains in sets.values():
            parameters = nominal().scaled(**factors)
            peaks, k = sensitivity(gains, parameters), kpis(gains, parameters)
            iae = f"{k['disturbance_iae_depth']:.2f}/{k['disturbance_iae_temperature']:.0f}"
            cells.append(f"{peaks[0]:.2f}/{peaks[1]:.2f} {iae}")
        print(f"{label:32}" + "".join(f"{cell:>26}" for cell in cells))
    return figures


def write(sets: dict[str, Gains], figures: dict[str, dict[str, float]], path: Path) -> None:
    """Write the sets as the package's tunings."""
    lines = ["# Computed by scripts/tune_decentral.py; meaning and units of the gains: decentral.yaml."]
    for name, gains in sets.items():
        bound, of = SETS[name], figures[name]
        lines.append(
            f"# {name}, Ms <= {bound.sensitivity:g}: "
            f"depth {of['ms_depth']:.2f}, temperature {of['ms_temperature']:.2f}; "
            f"moves by noise {of['noise_move_kn']:.3f} kN, {of['noise_move_rpm']:.2f} rpm"
        )
        lines.append(f"{name}:")
        lines += [f"  {key}: {value!r}" for key, value in asdict(gains).items()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> int:
    """Run the script; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--check", action="store_true", help="assess the shipped gains, do not search")
    parser.add_argument("--write", action="store_true", help="write the result into the package")
    parser.add_argument("--evaluations", type=int, default=420, help="of the cost, per set (default 420)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures as JSON")
    arguments = parser.parse_args()
    sets = tunings()
    if not arguments.check:
        for name, bounds in SETS.items():
            sets[name] = tune(START[name], bounds, arguments.evaluations)
    figures = report(sets)
    if arguments.write:
        import fsw_decentral

        write(sets, figures, Path(fsw_decentral.__file__).parent / "tunings.yaml")
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
