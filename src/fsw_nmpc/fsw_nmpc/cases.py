"""Random problems over the whole working range, for tests and benchmarks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fsw_control import Command, Limits
from fsw_model import ModelParameters
from fsw_nmpc.horizon import Horizon
from fsw_nmpc.ocp import Estimate, Problem, Weights
from fsw_nmpc.tuning import PRESETS, Tuning

Vector = NDArray[np.float64]


def random_tuning(rng: np.random.Generator) -> Tuning:
    """A preset, or weights drawn over decades."""
    if rng.random() < 0.5:
        return Tuning.preset(str(rng.choice(list(PRESETS))))

    def decades(low: float, high: float) -> float:
        return float(10.0 ** rng.uniform(low, high))

    return Tuning(
        corridor_depth_s=float(rng.uniform(0.0, 8.0)),
        corridor_temperature_s=float(rng.uniform(0.0, 8.0)),
        dead_band_depth_mm=decades(-4, -2),
        dead_band_temperature_c=decades(-2, 0),
        weight_depth_per_mm=decades(0, 2.5),
        weight_temperature_per_c=decades(-1, 1),
        square_depth_per_mm2=float(rng.choice([0.0, decades(0, 3)])),
        square_temperature_per_c2=float(rng.choice([0.0, decades(-2, 0)])),
        move_force_per_kn=decades(-2, 0.5),
        move_speed_per_rpm=decades(-3, 0),
        move_force_square=float(rng.choice([0.0, decades(-1, 0)])),
        move_speed_square=float(rng.choice([0.0, decades(-1, 0)])),
        interval_weighting=float(rng.choice([0.0, 1.0])),
    )


def random_problem(
    rng: np.random.Generator, horizon: Horizon, parameters: ModelParameters, tuning: Tuning | None = None
) -> Problem:
    """A problem that a weld could pose: any state, history, input, disturbance and set-point that limits allow.

    Parameters
    ----------
    rng : numpy.random.Generator
    horizon : Horizon
    parameters : ModelParameters
    tuning : Tuning, optional
        Random by default.
    """
    limits, tuning = Limits(), tuning or random_tuning(rng)
    temperature = parameters.operating_temperature_c + rng.normal(0.0, 20.0)
    thermal = parameters.softening_gain_mm_per_c * rng.normal(0.0, 15.0)
    x = np.array([rng.uniform(-0.4, 0.4) - thermal, rng.normal(0.0, 0.05), rng.normal(0.0, 1e-3), thermal, temperature])
    level = (temperature - parameters.ambient_temperature_c) / parameters.thermal_gain_c_per_kw
    history = level + np.cumsum(rng.normal(0.0, 0.3, 2 * horizon.n_history))
    estimate = Estimate(
        x=x,
        history_kw=history,
        force_offset_kn=float(rng.normal(0.0, 0.5)),
        torque_scale=float(rng.uniform(0.85, 1.15)),
        depth_offset_mm=float(rng.normal(0.0, 0.05)),
        temperature_offset_c=float(rng.normal(0.0, 3.0)),
    )
    applied = Command(
        float(rng.uniform(limits.force_min_kn, limits.force_max_kn)),
        float(rng.uniform(limits.speed_min_rpm, limits.speed_max_rpm)),
    )
    depth = parameters.operating_depth_mm + float(x[:4].sum()) + estimate.depth_offset_mm
    small = rng.random() < 0.3
    depth_set_point = depth + float(rng.normal(0.0, 1e-3)) if small else float(rng.uniform(2.2, 3.1))
    temperature_set_point = temperature + float(rng.normal(0.0, 0.1 if small else 20.0))
    return Problem(
        estimate,
        applied,
        limits,
        *_bands(horizon, depth_set_point, depth, tuning.corridor_depth_s, tuning.dead_band_depth_mm),
        *_bands(
            horizon,
            temperature_set_point,
            temperature,
            tuning.corridor_temperature_s,
            tuning.dead_band_temperature_c,
        ),
        Weights.from_tuning(tuning, horizon, limits),
    )


def _bands(
    horizon: Horizon, set_point: float, output: float, time_constant_s: float, width: float
) -> tuple[Vector, Vector]:
    """First-order corridor from the output to the set-point."""
    centre = set_point + (output - set_point) * np.exp(-horizon.time_s / max(time_constant_s, 1e-3))
    return centre - width, centre + width


def random_moves(rng: np.random.Generator, horizon: Horizon, limits: Limits) -> Vector:
    """Moves (2 n_blocks,) anywhere within their limits."""
    largest = np.tile([limits.force_step_kn, limits.speed_step_rpm], horizon.n_blocks)
    return np.asarray(largest * rng.uniform(-1.0, 1.0, 2 * horizon.n_blocks) * 10.0 ** rng.uniform(-2.0, 0.0))
