"""The same real-time iteration without the C kernel: CasADi's sensitivities and an interior-point QP solver (PIQP)."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from fsw_model import ModelParameters
from fsw_nmpc.horizon import Horizon, make_horizon
from fsw_nmpc.ocp import Problem, Solution
from fsw_nmpc.prediction import prediction_function
from fsw_nmpc.solvers.constraints import cumulation, failed, input_bounds, move_bounds, start_vector

Vector = NDArray[np.float64]


class CasadiSolver:
    """Solves with CasADi alone; the fallback where no C compiler is there.

    Parameters
    ----------
    parameters : ModelParameters
    horizon : Horizon, optional
        The paper's grid with 20 blocks by default.
    tolerance : float
        Of the QP solver.
    """

    name = "casadi"

    def __init__(self, parameters: ModelParameters, horizon: Horizon | None = None, tolerance: float = 1e-9) -> None:
        self.horizon = h = horizon or make_horizon(parameters)
        predict = prediction_function(parameters, h)
        moves = ca.SX.sym("moves", 2 * h.n_blocks)
        rest = [ca.SX.sym("start", predict.size1_in(1)), ca.SX.sym("history", predict.size1_in(2))]
        outputs = ca.vertcat(*predict(moves, *rest))
        self._linearise = ca.Function("linearise", [moves, *rest], [outputs, ca.jacobian(outputs, moves)])
        widths = np.concatenate([h.depth_width, h.temperature_width])
        self._rows = np.nonzero(widths > 0)[0]
        n, r, b = 2 * h.n_blocks, len(self._rows), len(h.block_sizes) * 2
        self._cumulation = cumulation(h)
        # variables: moves (n), violations of the output rows (r), absolute moves (n)
        dependence = np.zeros((r, n), dtype=bool)
        for i, row in enumerate(self._rows):
            dependence[i, : widths[row]] = True
        one_r, one_n = np.eye(r, dtype=bool), np.eye(n, dtype=bool)
        none = np.zeros((r, n), dtype=bool)
        self._pattern = np.block(
            [
                [dependence, one_r, none],
                [dependence, one_r, none],
                [one_n, none.T, one_n],
                [one_n, none.T, one_n],
                [self._cumulation != 0, np.zeros((b, r + n), dtype=bool)],
            ]
        )
        sparsity = ca.DM(self._pattern.astype(float)).sparsity()
        options = {"piqp": {"eps_abs": tolerance, "eps_rel": tolerance, "max_iter": 100}, "error_on_fail": False}
        size = n + r + n
        dense_moves = np.zeros((size, size))
        dense_moves[:n, :n] = 1.0
        np.fill_diagonal(dense_moves, 1.0)
        self._hessian_sparsity = ca.DM(dense_moves).sparsity()
        self._qp = ca.conic("qp", "piqp", {"h": self._hessian_sparsity, "a": sparsity}, options)
        self._sparsity = sparsity

    def solve(self, problem: Problem, moves: Vector) -> Solution:
        """One iteration about ``moves``; see :class:`fsw_nmpc.ocp.Solver`."""
        h, w = self.horizon, problem.weights
        n = 2 * h.n_blocks
        largest = move_bounds(problem, h)
        moves = np.asarray(moves, dtype=np.float64)
        values, slopes = self._linearise(moves, start_vector(problem), problem.estimate.history_kw)
        outputs, jacobian = np.array(values).ravel(), np.array(slopes)
        if not (np.isfinite(outputs).all() and np.isfinite(jacobian).all()):
            return Solution(*failed(h, moves, "not finite"), iterations=0, cost=np.nan)
        at_zero = outputs - jacobian @ moves
        rows = self._rows
        low = np.concatenate([problem.depth_low_mm, problem.temperature_low_c])[rows] - at_zero[rows]
        high = np.concatenate([problem.depth_high_mm, problem.temperature_high_c])[rows] - at_zero[rows]
        weight = np.concatenate([w.depth, w.temperature])[rows]
        square = np.concatenate([w.depth_square, w.temperature_square])[rows]
        a = jacobian[rows]
        sizes = np.repeat(h.block_sizes, 2)
        hessian = a.T @ (square[:, None] * a) + np.diag(np.tile(w.move_square, h.n_blocks) * sizes + 1e-9 / largest**2)
        gradient = -a.T @ (square * 0.5 * (low + high))
        r = len(rows)
        size = n + r + n
        full_hessian = np.zeros((size, size))
        full_hessian[:n, :n] = hessian
        identity, nothing = np.eye(n), np.zeros((r, n))
        matrix = np.block(
            [
                [a, -np.eye(r), nothing],
                [a, np.eye(r), nothing],
                [identity, nothing.T, -identity],
                [identity, nothing.T, identity],
                [self._cumulation, np.zeros((n, r + n))],
            ]
        )
        input_low, input_high = input_bounds(problem, h)
        free = np.inf
        result = self._qp(
            h=ca.project(ca.DM(full_hessian), self._hessian_sparsity),
            g=np.concatenate([gradient, weight, np.tile(w.move, h.n_blocks) * sizes]),
            a=ca.project(ca.DM(matrix), self._sparsity),
            lba=np.concatenate([np.full(r, -free), low, np.full(n, -free), np.zeros(n), input_low]),
            uba=np.concatenate([high, np.full(r, free), np.zeros(n), np.full(n, free), input_high]),
            lbx=np.concatenate([-largest, np.zeros(r + n)]),
            ubx=np.concatenate([largest, np.full(r + n, free)]),
        )
        stats = self._qp.stats()
        if not stats["success"]:
            return Solution(
                *failed(h, moves, str(stats["return_status"])), iterations=int(stats["iter_count"]), cost=np.nan
            )
        found = np.clip(np.array(result["x"]).ravel()[:n], -largest, largest)
        predicted = at_zero + jacobian @ found
        return Solution(
            moves=found,
            depth_mm=predicted[: h.n_out],
            temperature_c=predicted[h.n_out :],
            status="solved",
            iterations=max(int(stats["iter_count"]), 0),
            cost=float(result["cost"]),
        )
