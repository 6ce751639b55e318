"""The plan in force: which solutions it accepts, and what of it is left when a solve fails."""

from __future__ import annotations

from math import isfinite

import numpy as np
from numpy.typing import NDArray

from fsw_control import Command, Plan
from fsw_model import STEP_S
from fsw_nmpc.horizon import Horizon
from fsw_nmpc.ocp import Problem, Solution
from fsw_nmpc.solvers.constraints import RETURN_SHARE

Vector = NDArray[np.float64]
#: share of the largest move by which a solution may be beyond a limit; the command itself is clipped to it
_TOLERANCE = 1e-6


class MovePlan:
    """Moves of the last accepted solution on a horizon's blocks, seen from the present tick.

    Parameters
    ----------
    horizon : Horizon

    Attributes
    ----------
    moves : (2 n_blocks,) array
        Where the next solve starts: the last plan one tick later, or nothing after a failure.
    """

    def __init__(self, horizon: Horizon) -> None:
        self.horizon = horizon
        n = horizon.n_blocks
        later = np.append(horizon.interval_block[1:], -1)  # what each interval does one tick later
        shift = np.zeros((n, n))
        for block, source in zip(horizon.interval_block, later, strict=True):
            if source >= 0:
                shift[block, source] += 1.0 / horizon.block_sizes[block]
        self._shift = shift
        self._time_s = tuple(horizon.time_s.tolist())
        self._pairs = np.zeros((n, 2))
        self._outputs: tuple[Vector, Vector] | None = None
        self._ends = np.cumsum(horizon.block_sizes)
        self._sizes = horizon.block_sizes
        self._cold = True
        self.moves = np.zeros(2 * n)

    def on(self, horizon: Horizon) -> MovePlan:
        """The same plan on another horizon's blocks (of the same grid)."""
        other = MovePlan(horizon)
        for mine, its in zip(self.horizon.interval_block, horizon.interval_block, strict=True):
            other._pairs[its] += self._pairs[mine] / horizon.block_sizes[its]
        other._outputs, other._cold = self._outputs, self._cold
        if not self._cold:
            other.moves = other._pairs.ravel().copy()
        return other

    def clear(self) -> None:
        """Forget the plan: stand still, start cold."""
        self._pairs[:] = 0.0
        self.moves = np.zeros_like(self.moves)
        self._outputs, self._cold = None, True

    def refusal(self, solution: Solution, problem: Problem) -> str:
        """Why a solution cannot be used; empty if it is solved, finite and keeps all limits."""
        if not solution.solved:
            return solution.status
        moves, depth, temperature = solution.moves, solution.depth_mm, solution.temperature_c
        if not isfinite(np.dot(moves, moves) + np.dot(depth, depth) + np.dot(temperature, temperature)):
            return "solution is not finite"
        limits, applied = problem.limits, problem.applied
        force = moves[0::2], limits.force_step_kn, applied.force_kn, limits.force_min_kn, limits.force_max_kn
        speed = moves[1::2], limits.speed_step_rpm, applied.speed_rpm, limits.speed_min_rpm, limits.speed_max_rpm
        return self._beyond(*force) or self._beyond(*speed)

    def _beyond(self, moves: Vector, step: float, now: float, low: float, high: float) -> str:
        """Which limit the moves of one input break, empty if none."""
        slack = _TOLERANCE * step
        if np.maximum.reduce(moves) > step + slack or np.minimum.reduce(moves) < -step - slack:
            return "solution moves faster than the limits"
        inputs = now + np.add.accumulate(moves * self._sizes)
        slack *= len(self._time_s)
        if low <= now <= high:
            beyond = np.maximum.reduce(inputs) > high + slack or np.minimum.reduce(inputs) < low - slack
        else:  # outside now: it must come back, as fast as it may
            reach = RETURN_SHARE * step * self._ends
            beyond = (inputs > np.maximum(high, now - reach) + slack).any()
            beyond = beyond or (inputs < np.minimum(low, now + reach) - slack).any()
        return "solution leaves the bounds" if beyond else ""

    def accept(self, solution: Solution) -> tuple[float, float]:
        """Take a solution; returns its first moves (kN, rpm)."""
        self._pairs = solution.moves.reshape(-1, 2)
        self._outputs = solution.depth_mm, solution.temperature_c
        self._cold = False
        return float(self._pairs[0, 0]), float(self._pairs[0, 1])

    def follow(self) -> tuple[float, float]:
        """First moves of what is left of the last accepted plan; the next solve starts cold."""
        self._cold = True
        return float(self._pairs[0, 0]), float(self._pairs[0, 1])

    def shift(self) -> None:
        """Go on to the next tick."""
        self._pairs = np.dot(self._shift, self._pairs)
        self.moves = np.zeros_like(self.moves) if self._cold else self._pairs.ravel()
        if self._cold and self._outputs is not None:
            time_s = self.horizon.time_s
            depth, temperature = self._outputs
            self._outputs = np.interp(time_s + STEP_S, time_s, depth), np.interp(time_s + STEP_S, time_s, temperature)

    def seen_from(self, applied: Command) -> Plan | None:
        """Predicted outputs and inputs over the whole horizon; None before the first accepted solution."""
        if self._outputs is None:
            return None
        inputs = self._pairs[self.horizon.interval_block].cumsum(axis=0)
        return Plan(
            time_s=self._time_s,
            depth_mm=tuple(self._outputs[0].tolist()),
            temperature_c=tuple(self._outputs[1].tolist()),
            force_kn=tuple((inputs[:, 0] + applied.force_kn).tolist()),
            speed_rpm=tuple((inputs[:, 1] + applied.speed_rpm).tolist()),
        )
