"""Real-time iteration in the C kernel: one prediction with exact sensitivities and one condensed QP per tick."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fsw_model import ModelParameters
from fsw_nmpc import kernel_build
from fsw_nmpc.horizon import Horizon, make_horizon
from fsw_nmpc.kernel_binding import Kernel, KernelCall, doubles
from fsw_nmpc.ocp import Problem, Solution, Weights

Vector = NDArray[np.float64]
STATUS = {0: "solved", 1: "iteration cap", 2: "not finite"}


class RtiSolver:
    """Solves with the C kernel.

    Parameters
    ----------
    parameters : ModelParameters
    horizon : Horizon, optional
        The paper's grid with 20 blocks by default.
    library : Path, optional
        The built kernel; found, or built now, by default.
    max_iterations : int
        Cap of the interior-point method; together with the problem's size it bounds the time of a step.
    tolerance : float
        Complementarity gap relative to 1 + |cost|.

    Raises
    ------
    RuntimeError
        If the kernel is not built and cannot be.
    OSError
        If ``library`` cannot be loaded.
    """

    name = "rti"

    def __init__(
        self,
        parameters: ModelParameters,
        horizon: Horizon | None = None,
        library: Path | None = None,
        max_iterations: int = 50,
        tolerance: float = 1e-6,
    ) -> None:
        self.horizon = h = horizon or make_horizon(parameters)
        self.kernel = Kernel(library or kernel_build.ensure(), parameters, h)
        self._call = c = KernelCall()
        c.max_iterations = max_iterations
        c.tolerance = tolerance
        # the call points at these for good; pointers made anew at every tick would cost more than the copies
        self._moves = np.zeros(2 * h.n_blocks)
        self._moves_ref = doubles(self._moves)
        self._history = np.zeros(2 * h.n_history)
        self._bands = np.zeros((4, h.n_out))
        self._weights = np.zeros((4, h.n_out))
        self._spread: Weights | None = None
        c.history = doubles(self._history)
        c.depth_low, c.depth_high, c.temp_low, c.temp_high = (doubles(row) for row in self._bands)
        c.depth_weight, c.temp_weight, c.depth_square, c.temp_square = (doubles(row) for row in self._weights)

    def call(self, problem: Problem) -> KernelCall:
        """The problem as the kernel wants it; valid until the next one."""
        c, e, lim = self._call, problem.estimate, problem.limits
        c.x[:] = e.x.tolist()
        self._history[:] = e.history_kw
        c.force_kn, c.speed_rpm = problem.applied.force_kn, problem.applied.speed_rpm
        c.force_offset_kn, c.torque_scale = e.force_offset_kn, e.torque_scale
        c.depth_offset_mm, c.temp_offset_c = e.depth_offset_mm, e.temperature_offset_c
        bands = self._bands
        bands[0], bands[1] = problem.depth_low_mm, problem.depth_high_mm
        bands[2], bands[3] = problem.temperature_low_c, problem.temperature_high_c
        if problem.weights is not self._spread:
            self._take_weights(problem.weights)
        c.move_max[:] = lim.force_step_kn, lim.speed_step_rpm
        c.input_min[:] = lim.force_min_kn, lim.speed_min_rpm
        c.input_max[:] = lim.force_max_kn, lim.speed_max_rpm
        return c

    def _take_weights(self, weights: Weights) -> None:
        rows = self._weights
        rows[0], rows[1] = weights.depth, weights.temperature
        rows[2], rows[3] = weights.depth_square, weights.temperature_square
        self._call.move_weight[:] = weights.move
        self._call.move_square[:] = weights.move_square
        self._spread = weights

    def solve(self, problem: Problem, moves: Vector) -> Solution:
        """One iteration about ``moves``; see :class:`fsw_nmpc.ocp.Solver`."""
        self._moves[:] = moves
        result = self.kernel.solve(self.call(problem), self._moves_ref)
        return Solution(
            moves=self._moves.copy(),
            depth_mm=self.kernel.depth_mm.copy(),
            temperature_c=self.kernel.temperature_c.copy(),
            status=STATUS[result.status],
            iterations=result.iterations,
            cost=result.cost,
        )
