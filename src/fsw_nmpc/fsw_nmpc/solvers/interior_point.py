"""Mehrotra's predictor-corrector method for the condensed QP, on numpy: ``kernel/solve.c``, step by step.

min  1/2 z'Dz + g'z + sum_r w_r (max(0, a_r'z - high_r) + max(0, low_r - a_r'z)) + 1/2 q_r (a_r'z - centre_r)^2
     + sum_j v_j |z_j|   s.t.  |z| <= 1,  input_low <= C z <= input_high
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotrs

Vector = NDArray[np.float64]
_STEP_TO_BOUNDARY, _SHORT_STEP = 0.995, 0.3
_PRIMAL_TOLERANCE, _DUAL_TOLERANCE = 1e-7, 1e-6


@dataclass(slots=True)
class QuadraticProgram:
    """The condensed QP in moves scaled to at most 1.

    Attributes
    ----------
    rows : (m, n) array
        ``a``, one output per row.
    low, high, weight, square : (m,) arrays
        Dead-band, L1 weight and quadratic weight per row.
    diagonal, move_weight : (n,) arrays
        D, and the L1 weights of the moves.
    inputs : (n, n) array
        C.
    input_low, input_high : (n,) arrays
    """

    rows: Vector
    low: Vector
    high: Vector
    weight: Vector
    square: Vector
    diagonal: Vector
    move_weight: Vector
    inputs: Vector
    input_low: Vector
    input_high: Vector

    def cost(self, z: Vector) -> float:
        """Objective at ``z``."""
        value = self.rows @ z
        outside = np.maximum(value - self.high, 0.0) + np.maximum(self.low - value, 0.0)
        bent = 0.5 * self.square * (value - 0.5 * (self.low + self.high)) ** 2
        moves = self.move_weight * np.abs(z) + 0.5 * self.diagonal * z * z
        return float(self.weight @ outside + bent.sum() + moves.sum())


@dataclass(slots=True)
class Answer:
    """Solution of a :class:`QuadraticProgram`: ``status`` is ``solved`` or what went wrong."""

    z: Vector
    status: str
    iterations: int
    cost: float


def solve(qp: QuadraticProgram, z: Vector, max_iterations: int, tolerance: float) -> Answer:
    """Solve a QP.

    Parameters
    ----------
    qp : QuadraticProgram
    z : (n,) array
        Where to start.
    max_iterations : int
    tolerance : float
        On the complementarity gap, relative to 1 + |cost|.
    """
    with np.errstate(all="ignore"):  # what is not finite is found and reported
        return _Iteration(qp, np.clip(z, -0.95, 0.95)).run(max_iterations, tolerance)


class _Iteration:
    """State of the method: z, and slack, violation and duals of every side of the rows.

    A soft side has e = t - s, t >= 0 with dual pi, s >= 0 with dual lambda, lambda + pi = weight; a hard one e = -s.
    Both are kept in one array, soft sides first; t and pi of the hard ones stay out of all sums.
    """

    def __init__(self, qp: QuadraticProgram, z: Vector) -> None:
        self.qp, self.z = qp, z
        self.is_soft = qp.weight > 0.0
        self.limited = qp.move_weight > 0.0
        rows = qp.rows[self.is_soft]
        chosen = np.eye(len(z))[self.limited]
        self.m, self.k = len(rows), len(chosen)
        self.n_soft = 2 * self.m + self.k
        # one row for each side: e = sides z - offset
        self.sides = np.vstack([rows, -rows, chosen, np.eye(len(z)), -np.eye(len(z)), qp.inputs, -qp.inputs])
        one = np.ones(len(z))
        self.offset = np.concatenate(
            [
                qp.high[self.is_soft], -qp.low[self.is_soft], np.zeros(self.k), one, one, qp.input_high, -qp.input_low,
            ]
        )  # fmt: skip
        soft_weight = qp.weight[self.is_soft]
        # weight |z| = 2 weight max(0, z) - weight z: one side instead of two
        self.weight = np.concatenate([soft_weight, soft_weight, 2.0 * qp.move_weight[self.limited]])
        centre = 0.5 * (qp.low + qp.high)
        self.hessian = np.diag(qp.diagonal) + qp.rows.T @ (qp.square[:, None] * qp.rows)
        self.gradient = -qp.move_weight - qp.rows.T @ (qp.square * centre)
        self._start()

    def _start(self) -> None:
        n = self.n_soft
        e = self.sides @ self.z - self.offset
        cost = float(self.weight @ np.maximum(e[:n], 0.0))
        mu = 0.02 + 0.1 * cost / max(n, 1)
        self.pi = 0.5 * self.weight
        self.t = np.maximum(e[:n], 0.0) + mu / self.pi
        self.s = np.concatenate([self.t - e[:n], np.maximum(-e[n:], 0.05)])
        self.lam = np.concatenate([self.pi, mu / self.s[n:]])
        self.pairs = n + len(self.s)

    def run(self, max_iterations: int, tolerance: float) -> Answer:
        n, status, iteration = self.n_soft, "iteration cap", 0
        while True:
            e = self.sides @ self.z - self.offset
            sl, tp = self.s * self.lam, self.t * self.pi
            gap = float(sl.sum() + tp.sum())
            residual = e + self.s
            residual[:n] -= self.t
            dual = self.gradient + self.hessian @ self.z + self.lam @ self.sides
            cost = self.qp.cost(self.z)
            if not np.isfinite(gap + cost):
                status = "not finite"
                break
            loss = tolerance * (1.0 + abs(cost))
            if (
                gap <= loss
                and np.abs(residual).max() <= _PRIMAL_TOLERANCE
                and np.abs(dual).max() <= max(_DUAL_TOLERANCE, loss / len(self.z))
            ):
                status = "solved"
                break
            if iteration >= max_iterations:
                break
            pivot = self.s / self.lam
            pivot[:n] += self.t / self.pi
            pivot = 1.0 / pivot
            factor, failed = dpotrf(self.hessian + self.sides.T @ (pivot[:, None] * self.sides))
            if failed:
                status = "not finite"
                break
            ahead = self._direction(factor, pivot, residual, dual, -sl, -tp)
            alpha = self._longest_step(*ahead)
            _, ds, dt, dl = ahead
            there = (self.s + alpha * ds) @ (self.lam + alpha * dl)
            there += (self.t + alpha * dt) @ (self.pi - alpha * dl[:n])
            mu = max((float(there) / gap) ** 3 * gap, 0.02 * loss) / self.pairs
            second = 1.0 if alpha > _SHORT_STEP else alpha
            c1, c2 = mu - sl - second * ds * dl, mu - tp + second * dt * dl[:n]
            found = self._direction(factor, pivot, residual, dual, c1, c2)
            alpha = self._longest_step(*found)
            self._advance(_STEP_TO_BOUNDARY * alpha if alpha < 1.0 else 1.0, *found)
            iteration += 1
        return Answer(self.z, status, iteration, cost)

    def _direction(
        self, factor: Vector, pivot: Vector, residual: Vector, dual: Vector, c1: Vector, c2: Vector
    ) -> tuple[Vector, Vector, Vector, Vector]:
        """Newton direction (dz, ds, dt, dlambda) for the changes c1 of s lambda and c2 of t pi."""
        n = self.n_soft
        shift = residual + c1 / self.lam
        shift[:n] -= c2 / self.pi
        dz, _ = dpotrs(factor, -dual - (pivot * shift) @ self.sides)
        dl = pivot * (self.sides @ dz + shift)
        return dz, (c1 - self.s * dl) / self.lam, (c2 + self.t * dl[:n]) / self.pi, dl

    def _longest_step(self, dz: Vector, ds: Vector, dt: Vector, dl: Vector) -> float:
        n = self.n_soft
        ratio = max(float((-ds / self.s).max()), float((-dl / self.lam).max()))
        if n:
            ratio = max(ratio, float((-dt / self.t).max()), float((dl[:n] / self.pi).max()))
        return 1.0 / ratio if ratio > 1.0 else 1.0

    def _advance(self, alpha: float, dz: Vector, ds: Vector, dt: Vector, dl: Vector) -> None:
        self.z = self.z + alpha * dz
        self.s += alpha * ds
        self.t += alpha * dt
        self.lam += alpha * dl
        self.pi -= alpha * dl[: self.n_soft]
