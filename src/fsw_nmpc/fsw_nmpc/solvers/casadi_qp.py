"""The same real-time iteration without the C kernel: CasADi's sensitivities, and the same interior-point method."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from fsw_model import ModelParameters
from fsw_nmpc.horizon import Horizon, make_horizon
from fsw_nmpc.ocp import Problem, Solution
from fsw_nmpc.prediction import prediction_function
from fsw_nmpc.solvers.constraints import cumulation, failed, input_bounds, move_bounds, start_vector
from fsw_nmpc.solvers.interior_point import QuadraticProgram, solve

Vector = NDArray[np.float64]
_LEAST_CURVATURE = 1e-9


class CasadiSolver:
    """Solves without compiled code of this project; the fallback where no C compiler is there.

    Parameters
    ----------
    parameters : ModelParameters
    horizon : Horizon, optional
        The paper's grid with 20 blocks by default.
    max_iterations : int
        Cap of the interior-point method.
    tolerance : float
        Complementarity gap relative to 1 + |cost|.
    """

    name = "casadi"

    def __init__(
        self,
        parameters: ModelParameters,
        horizon: Horizon | None = None,
        max_iterations: int = 50,
        tolerance: float = 1e-6,
    ) -> None:
        self.horizon = h = horizon or make_horizon(parameters)
        self.max_iterations, self.tolerance = max_iterations, tolerance
        predict = prediction_function(parameters, h)
        moves = ca.SX.sym("moves", 2 * h.n_blocks)
        rest = [ca.SX.sym("start", predict.size1_in(1)), ca.SX.sym("history", predict.size1_in(2))]
        outputs = ca.vertcat(*predict(moves, *rest))
        self._linearise = ca.Function("linearise", [moves, *rest], [outputs, ca.densify(ca.jacobian(outputs, moves))])
        self._reachable = np.concatenate([h.depth_width, h.temperature_width]) > 0
        self._cumulation = cumulation(h)
        self._sizes = np.repeat(h.block_sizes, 2)

    def linearise(self, problem: Problem, moves: Vector) -> tuple[Vector, Vector]:
        """Outputs along ``moves`` (depth, then temperature; (2 n_out,)) and their derivatives (2 n_out, 2 n_blocks)."""
        values, slopes = self._linearise(moves, start_vector(problem), problem.estimate.history_kw)
        return values.full().ravel(), slopes.full()

    def program(self, problem: Problem, at_zero: Vector, slopes: Vector) -> QuadraticProgram:
        """The condensed QP, for outputs ``at_zero`` of the linear model without moves."""
        h, w = self.horizon, problem.weights
        largest = move_bounds(problem, h)
        weight, square = (
            np.concatenate([w.depth, w.temperature]),
            np.concatenate([w.depth_square, w.temperature_square]),
        )
        used = self._reachable & ((weight > 0.0) | (square > 0.0))
        low = np.concatenate([problem.depth_low_mm, problem.temperature_low_c]) - at_zero
        high = np.concatenate([problem.depth_high_mm, problem.temperature_high_c]) - at_zero
        input_low, input_high = input_bounds(problem, h)
        return QuadraticProgram(
            rows=slopes[used] * largest,
            low=low[used],
            high=high[used],
            weight=weight[used],
            square=square[used],
            diagonal=np.tile(w.move_square, h.n_blocks) * self._sizes * largest**2 + _LEAST_CURVATURE,
            move_weight=np.tile(w.move, h.n_blocks) * self._sizes * largest,
            inputs=self._cumulation * largest,
            input_low=input_low,
            input_high=input_high,
        )

    def solve(self, problem: Problem, moves: Vector) -> Solution:
        """One iteration about ``moves``; see :class:`fsw_nmpc.ocp.Solver`."""
        moves = np.asarray(moves, dtype=np.float64)
        outputs, slopes = self.linearise(problem, moves)
        if not (np.isfinite(outputs).all() and np.isfinite(slopes).all()):
            return Solution(*failed(self.horizon, moves, "not finite"), iterations=0, cost=np.nan)
        at_zero = outputs - slopes @ moves
        largest = move_bounds(problem, self.horizon)
        answer = solve(self.program(problem, at_zero, slopes), moves / largest, self.max_iterations, self.tolerance)
        found = answer.z * largest
        predicted = at_zero + slopes @ found
        n_out = self.horizon.n_out
        return Solution(found, predicted[:n_out], predicted[n_out:], answer.status, answer.iterations, answer.cost)
