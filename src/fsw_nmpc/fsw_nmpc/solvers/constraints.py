"""What every solver in CasADi shares: the start vector, cumulated inputs and reachable bounds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fsw_nmpc.horizon import Horizon
from fsw_nmpc.ocp import Problem

Vector = NDArray[np.float64]
#: Share of the largest moves that an input outside its bounds must use to come back (as in the C kernel).
RETURN_SHARE = 0.98


def start_vector(problem: Problem) -> Vector:
    """The ``start`` of :func:`fsw_nmpc.prediction.prediction_function`, shape (11,)."""
    e, u = problem.estimate, problem.applied
    return np.concatenate(
        [
            e.x,
            [u.force_kn, u.speed_rpm, e.force_offset_kn, e.torque_scale, e.depth_offset_mm, e.temperature_offset_c],
        ]
    )


def cumulation(horizon: Horizon) -> Vector:
    """Matrix (2 n_blocks, 2 n_blocks) from moves to the inputs' change at the end of every block."""
    lower = np.tril(np.ones((horizon.n_blocks, horizon.n_blocks))) * horizon.block_sizes[None, :]
    return np.asarray(np.kron(lower, np.eye(2)), dtype=np.float64)


def move_bounds(problem: Problem, horizon: Horizon) -> Vector:
    """Largest move of every variable, shape (2 n_blocks,)."""
    return np.tile([problem.limits.force_step_kn, problem.limits.speed_step_rpm], horizon.n_blocks)


def input_bounds(problem: Problem, horizon: Horizon) -> tuple[Vector, Vector]:
    """Bounds (2 n_blocks,) on the inputs' change at the end of every block, relaxed to what can be reached."""
    limits, u = problem.limits, problem.applied
    reach = RETURN_SHARE * np.outer(np.cumsum(horizon.block_sizes), [limits.force_step_kn, limits.speed_step_rpm])
    now = np.array([u.force_kn, u.speed_rpm])
    low = np.array([limits.force_min_kn, limits.speed_min_rpm]) - now
    high = np.array([limits.force_max_kn, limits.speed_max_rpm]) - now
    return np.minimum(low, reach).ravel(), np.maximum(high, -reach).ravel()


def failed(horizon: Horizon, moves: Vector, why: str) -> tuple[Vector, Vector, Vector, str]:
    """Fields of a :class:`fsw_nmpc.ocp.Solution` for a solve that brought nothing."""
    nothing = np.full(horizon.n_out, np.nan)
    return moves, nothing, nothing, why
