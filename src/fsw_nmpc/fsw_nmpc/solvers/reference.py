"""The nonlinear problem solved to convergence by a cold IPOPT: the oracle of tests and offline studies."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from fsw_model import ModelParameters
from fsw_nmpc.horizon import Horizon, horizon_of
from fsw_nmpc.ocp import Problem, Solution
from fsw_nmpc.prediction import prediction_function
from fsw_nmpc.solvers.constraints import cumulation, failed, input_bounds, move_bounds, start_vector

Vector = NDArray[np.float64]
_LONGEST_ITERATIONS = 500


class ReferenceSolver:
    """Solves the problem with all slacks, to the optimum and from nothing; too slow for real time.

    Variables are the moves, the violation of every dead-band and the size of every move, so that the L1 costs are
    smooth. Unlike in the other solvers, nothing is linearised.

    Parameters
    ----------
    parameters : ModelParameters
    horizon : Horizon, optional
        The paper's grid with a move in every interval by default.
    tolerance : float
        Of IPOPT.
    """

    name = "reference"

    def __init__(self, parameters: ModelParameters, horizon: Horizon | None = None, tolerance: float = 1e-8) -> None:
        self.horizon = h = horizon or horizon_of(parameters, 54)
        predict = prediction_function(parameters, h)
        n, r = 2 * h.n_blocks, 2 * h.n_out
        z, over, size = ca.SX.sym("z", n), ca.SX.sym("violation", r), ca.SX.sym("size", n)
        start, history = ca.SX.sym("start", predict.size1_in(1)), ca.SX.sym("history", predict.size1_in(2))
        largest, weight, square, low, high, move, move_square = (
            ca.SX.sym(name, length)
            for name, length in (
                ("largest", n), ("weight", r), ("square", r), ("low", r), ("high", r), ("move", n), ("move_square", n),
            )
        )  # fmt: skip
        outputs = ca.vertcat(*predict(z * largest, start, history))
        bent = 0.5 * ca.dot(square, (outputs - 0.5 * (low + high)) ** 2) + 0.5 * ca.dot(move_square, z**2)
        cost = ca.dot(weight, over) + ca.dot(move, size) + bent
        # what is not weighted has no use for its violation
        used = weight > 0
        constraints = ca.vertcat(
            ca.if_else(used, outputs - high, -1.0) - over,
            ca.if_else(used, low - outputs, -1.0) - over,
            z - size,
            -z - size,
            ca.DM(cumulation(h)) @ (z * largest),
        )
        self._n, self._r = n, r
        options: dict[str, Any] = {
            "print_time": False,
            "ipopt": {"print_level": 0, "sb": "yes", "tol": tolerance, "max_iter": _LONGEST_ITERATIONS},
        }
        self._solver = ca.nlpsol(
            "reference",
            "ipopt",
            {
                "x": ca.vertcat(z, over, size),
                "f": cost,
                "g": constraints,
                "p": ca.vertcat(start, history, largest, weight, square, low, high, move, move_square),
            },
            options,
        )
        self._predict = predict

    def solve(self, problem: Problem, moves: Vector) -> Solution:
        """Solve to convergence; ``moves`` are not used but to give back when it fails."""
        h, w, n, r = self.horizon, problem.weights, self._n, self._r
        largest = move_bounds(problem, h)
        sizes = np.repeat(h.block_sizes, 2)
        input_low, input_high = input_bounds(problem, h)
        history = problem.estimate.history_kw
        parameter = np.concatenate(
            [
                start_vector(problem), history, largest,
                w.depth, w.temperature, w.depth_square, w.temperature_square,
                problem.depth_low_mm, problem.temperature_low_c, problem.depth_high_mm, problem.temperature_high_c,
                np.tile(w.move, h.n_blocks) * sizes * largest, np.tile(w.move_square, h.n_blocks) * sizes * largest**2,
            ]
        )  # fmt: skip
        if not np.isfinite(parameter).all():
            return Solution(*failed(h, moves, "not finite"), iterations=0, cost=np.nan)
        open_ended = np.full(2 * r + 2 * n, -np.inf)
        found = self._solver(
            x0=np.zeros(2 * n + r),
            p=parameter,
            lbx=np.concatenate([-np.ones(n), np.zeros(r + n)]),
            ubx=np.concatenate([np.ones(n), np.full(r + n, np.inf)]),
            lbg=np.concatenate([open_ended, input_low]),
            ubg=np.concatenate([np.zeros(2 * r + 2 * n), input_high]),
        )
        stats = self._solver.stats()
        if not stats["success"]:
            return Solution(*failed(h, moves, str(stats["return_status"])), int(stats["iter_count"]), np.nan)
        best = np.clip(found["x"].full().ravel()[:n], -1.0, 1.0) * largest
        depth, temperature = self._predict(best, start_vector(problem), history)
        return Solution(
            best,
            depth.full().ravel(),
            temperature.full().ravel(),
            "solved",
            int(stats["iter_count"]),
            float(found["f"]),
        )
