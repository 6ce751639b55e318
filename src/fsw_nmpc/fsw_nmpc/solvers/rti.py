"""Real-time iteration in the C kernel: one prediction with exact sensitivities and one condensed QP per tick."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fsw_model import ModelParameters
from fsw_nmpc import kernel_build
from fsw_nmpc.horizon import Horizon, make_horizon
from fsw_nmpc.kernel_binding import Kernel, KernelCall, doubles
from fsw_nmpc.ocp import Problem, Solution

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
        max_iterations: int = 40,
        tolerance: float = 1e-6,
    ) -> None:
        self.horizon = horizon or make_horizon(parameters)
        self.kernel = Kernel(library or kernel_build.ensure(), parameters, self.horizon)
        self._call = KernelCall()
        self._call.max_iterations = max_iterations
        self._call.tolerance = tolerance

    def call(self, problem: Problem) -> KernelCall:
        """The problem as the kernel wants it; its arrays must outlive the call."""
        c, e, w, lim = self._call, problem.estimate, problem.weights, problem.limits
        c.x[:] = e.x.tolist()
        c.history = doubles(e.history_kw)
        c.force_kn, c.speed_rpm = problem.applied.force_kn, problem.applied.speed_rpm
        c.force_offset_kn, c.torque_scale = e.force_offset_kn, e.torque_scale
        c.depth_offset_mm, c.temp_offset_c = e.depth_offset_mm, e.temperature_offset_c
        c.depth_low, c.depth_high = doubles(problem.depth_low_mm), doubles(problem.depth_high_mm)
        c.temp_low, c.temp_high = doubles(problem.temperature_low_c), doubles(problem.temperature_high_c)
        c.depth_weight, c.temp_weight = doubles(w.depth), doubles(w.temperature)
        c.depth_square, c.temp_square = doubles(w.depth_square), doubles(w.temperature_square)
        c.move_weight = (ctypes.c_double * 2)(*w.move)
        c.move_square = (ctypes.c_double * 2)(*w.move_square)
        c.move_max = (ctypes.c_double * 2)(lim.force_step_kn, lim.speed_step_rpm)
        c.input_min = (ctypes.c_double * 2)(lim.force_min_kn, lim.speed_min_rpm)
        c.input_max = (ctypes.c_double * 2)(lim.force_max_kn, lim.speed_max_rpm)
        return c

    def solve(self, problem: Problem, moves: Vector) -> Solution:
        """One iteration about ``moves``; see :class:`fsw_nmpc.ocp.Solver`."""
        moves = np.array(moves, dtype=np.float64)
        result = self.kernel.solve(self.call(problem), moves)
        return Solution(
            moves=moves,
            depth_mm=self.kernel.depth_mm.copy(),
            temperature_c=self.kernel.temperature_c.copy(),
            status=STATUS[result.status],
            iterations=result.iterations,
            cost=result.cost,
        )
