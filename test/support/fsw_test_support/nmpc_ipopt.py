"""The nonlinear problem solved to convergence by a cold IPOPT.

The oracle of tests and benchmarks.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from fsw_model import ModelParameters
from fsw_nmpc.horizon import Horizon
from fsw_nmpc.library import Library, SolveStatus, Vector
from fsw_test_support.nmpc_prediction import prediction_function, start_vector

_LONGEST_ITERATIONS = 500


def cumulation(horizon: Horizon) -> Vector:
    """Matrix (2 n_blocks, 2 n_blocks) from moves to the inputs' change at the end of every block."""
    lower = np.tril(np.ones((horizon.n_blocks, horizon.n_blocks))) * horizon.block_sizes[None, :]
    return np.asarray(np.kron(lower, np.eye(2)), dtype=np.float64)


def input_bounds(problem: Any, tuning: Any, horizon: Horizon) -> tuple[Vector, Vector]:
    """Bounds (2 n_blocks,) on the inputs' change at the end of every block."""
    now = np.array([problem.start.force_kn, problem.start.speed_rpm])
    low, high = np.array(input_ranges(tuning)).T - now
    return np.tile(low, horizon.n_blocks), np.tile(high, horizon.n_blocks)


def input_ranges(tuning: Any) -> list[tuple[float, float]]:
    """Bounds of force and speed."""
    return [
        (tuning.force_min_kn, tuning.force_max_kn),
        (tuning.speed_min_rpm, tuning.speed_max_rpm),
    ]


def largest_moves(tuning: Any) -> list[float]:
    """Largest moves of force and speed per tick."""
    return [tuning.force_step_kn, tuning.speed_step_rpm]


def weights(tuning: Any) -> list[float]:
    """L1 weights of depth and temperature."""
    return [tuning.weight_depth_per_mm, tuning.weight_temperature_per_c]


def move_weights(tuning: Any) -> list[float]:
    """L1 weights of the moves of force and speed."""
    return [tuning.move_force_per_kn, tuning.move_speed_per_rpm]


def move_squares(tuning: Any) -> list[float]:
    """Quadratic costs of the moves of force and speed."""
    return [tuning.full_move_cost / largest**2 for largest in largest_moves(tuning)]


def squares(tuning: Any) -> list[float]:
    """Quadratic costs of depth and temperature."""
    scales = (tuning.depth_scale_mm, tuning.temperature_scale_c)
    return [1.0 / scale**2 if scale > 0.0 else 0.0 for scale in scales]


def objective(
    problem: Any,
    tuning: Any,
    horizon: Horizon,
    moves: Vector,
    depth_mm: Vector,
    temperature_c: Vector,
) -> float:
    """Cost (28) of moves (2 n_blocks,) and the outputs (n_out,) that they lead to."""
    total, n, square = 0.0, horizon.n_out, squares(tuning)
    for q, output in enumerate((depth_mm, temperature_c)):
        low, high = np.array(list(problem.low[q][0:n])), np.array(list(problem.high[q][0:n]))
        reached = (horizon.depth_width, horizon.temperature_width)[q] > 0
        outside = np.maximum(output - high, 0.0) + np.maximum(low - output, 0.0)
        bent = 0.5 * square[q] * (output - 0.5 * (low + high)) ** 2
        total += float((weights(tuning)[q] * outside + bent)[reached].sum())
    pairs = np.abs(moves.reshape(-1, 2))
    each = (
        pairs @ move_weights(tuning) + 0.5 * pairs**2 @ move_squares(tuning) / horizon.block_reach
    )
    return total + float(horizon.block_sizes @ each)


class ReferenceSolver:
    """Solves the problem with all slacks, to the optimum and from nothing; too slow for real time.

    Variables are the moves, the violation of every dead-band and the size of every move, so that
    the L1 costs are smooth. Unlike in the library's solver, nothing is linearised.

    Parameters
    ----------
    library : Library
        Its horizon, and its tuning at the time of a solve.
    parameters : ModelParameters
    tolerance : float
        Of IPOPT.
    method : str
        CasADi's name of another solver to use instead, with its ``options``.
    """

    name = "reference"

    def __init__(
        self,
        library: Library,
        parameters: ModelParameters,
        tolerance: float = 1e-8,
        method: str = "ipopt",
        options: Mapping[str, Any] | None = None,
    ) -> None:
        self._library, h = library, library.horizon
        predict = prediction_function(parameters, h)
        n, r = 2 * h.n_blocks, 2 * h.n_out
        z, over, size = ca.SX.sym("z", n), ca.SX.sym("violation", r), ca.SX.sym("size", n)
        start, history = (
            ca.SX.sym("start", predict.size1_in(1)),
            ca.SX.sym("history", predict.size1_in(2)),
        )
        lengths = {
            "largest": n,
            "weight": r,
            "square": r,
            "low": r,
            "high": r,
            "move": n,
            "move_square": n,
        }
        p = {name: ca.SX.sym(name, length) for name, length in lengths.items()}
        scale = ca.SX.sym("scale")  # brings the cost to about 1, which the tolerance is for
        outputs = ca.vertcat(*predict(z * p["largest"], start, history))
        middle = 0.5 * (p["low"] + p["high"])
        bent = 0.5 * ca.dot(p["square"], (outputs - middle) ** 2) + 0.5 * ca.dot(
            p["move_square"], z**2
        )
        used = p["weight"] > 0  # what has no weight has no use for its violation
        constraints = ca.vertcat(
            ca.if_else(used, outputs - p["high"], -1.0) - over,
            ca.if_else(used, p["low"] - outputs, -1.0) - over,
            z - size,
            -z - size,
            ca.DM(cumulation(h)) @ (z * p["largest"]),
        )
        if options is None:
            options = {
                "ipopt": {
                    "print_level": 0,
                    "sb": "yes",
                    "tol": tolerance,
                    "max_iter": _LONGEST_ITERATIONS,
                }
            }
        program = {
            "x": ca.vertcat(z, over, size),
            "f": scale * (ca.dot(p["weight"], over) + ca.dot(p["move"], size) + bent),
            "g": constraints,
            "p": ca.vertcat(start, history, *p.values(), scale),
        }
        self._solver = ca.nlpsol("reference", method, program, {"print_time": False, **options})
        self._predict = predict
        self.iterations, self.cost = 0, np.nan

    def solve(self, problem: Any, moves: Vector) -> tuple[int, Vector, Vector, Vector]:
        """Solve to convergence; ``moves`` are not used but to give back when it fails."""
        h, t = self._library.horizon, self._library.state.tuning
        n, r, n_out = 2 * h.n_blocks, 2 * h.n_out, h.n_out
        nothing = np.full(n_out, np.nan)
        largest, sizes = (
            np.outer(h.block_reach, largest_moves(t)).ravel(),
            np.repeat(h.block_sizes, 2),
        )
        reached = np.concatenate([h.depth_width > 0, h.temperature_width > 0])
        weight = np.repeat(weights(t), n_out) * reached
        input_low, input_high = input_bounds(problem, t, h)
        start, history = (
            start_vector(problem.start, h),
            list(problem.start.history[0 : 3 * h.n_history]),
        )
        parameter = np.concatenate(
            [
                start, history, largest,
                weight, np.repeat(squares(t), n_out) * reached,
                *(list(side[q][0:n_out]) for side in (problem.low, problem.high) for q in (0, 1)),
                np.tile(move_weights(t), h.n_blocks) * sizes * largest,
                np.tile(move_squares(t), h.n_blocks) * sizes * largest**2 / np.repeat(h.block_reach, 2),
            ]
        )  # fmt: skip
        if not np.isfinite(parameter).all():
            return SolveStatus.NOT_FINITE, moves, nothing, nothing
        still = np.zeros(n)
        scale = 1.0 / (1.0 + objective(problem, t, h, still, *self._outputs(problem, still)))
        open_ended = np.full(2 * r + 2 * n, -np.inf)
        solution = self._solver(
            x0=np.zeros(2 * n + r),
            p=np.append(parameter, scale),
            lbx=np.concatenate([-np.ones(n), np.zeros(r + n)]),
            # a slack without a cost would be free to run away
            ubx=np.concatenate([np.ones(n), np.where(weight > 0.0, np.inf, 0.0), np.ones(n)]),
            lbg=np.concatenate([open_ended, input_low]),
            ubg=np.concatenate([np.zeros(2 * r + 2 * n), input_high]),
        )
        stats = self._solver.stats()
        self.iterations, self.cost = int(stats["iter_count"]), float(solution["f"]) / scale
        if not stats["success"]:
            return SolveStatus.ITERATION_CAP, moves, nothing, nothing
        best = np.clip(solution["x"].full().ravel()[:n], -1.0, 1.0) * largest
        return SolveStatus.OK, best, *self._outputs(problem, best)

    def _outputs(self, problem: Any, moves: Vector) -> tuple[Vector, Vector]:
        history = list(problem.start.history[0 : 3 * self._library.horizon.n_history])
        depth, temperature = self._predict(
            moves, start_vector(problem.start, self._library.horizon), history
        )
        return depth.full().ravel(), temperature.full().ravel()
