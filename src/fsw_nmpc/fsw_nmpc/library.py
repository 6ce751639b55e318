"""Binding of the controller library (``kernel/fsw_nmpc.h``), and the model as its tables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fsw_control.c_library import CController, CLibrary
from fsw_control.units import RAD_PER_S_PER_RPM
from fsw_model import ModelParameters
from fsw_model.equations import depth_modes
from fsw_nmpc.horizon import Horizon, make_horizon
from fsw_nmpc.kernel_codegen import TORQUE_PARAMETERS

Vector = NDArray[np.float64]

KERNEL = CLibrary("fsw_nmpc", Path(__file__).parent / "kernel")
SolveStatus = KERNEL.enum("fsw_solve_status", "FSW_")
Reason = KERNEL.enum("fsw_reason", "FSW_")
Missing = KERNEL.enum("fsw_missing", "FSW_NO_")
State = KERNEL.enum("fsw_state", "FSW_")
Trajectory = KERNEL.enum("fsw_trajectory", "FSW_")


class Tables:
    """The model's tables for the library; they must outlive every controller that uses them.

    Parameters
    ----------
    parameters : ModelParameters
    horizon : Horizon

    Attributes
    ----------
    arrays : dict of str to array
        What the model's pointers refer to, by field.
    model : Any
        A ``fsw_nmpc_model *``.
    """

    def __init__(self, parameters: ModelParameters, horizon: Horizon) -> None:
        p, h = parameters, horizon
        ahead = make_horizon(p, (0.0, p.dead_time_s), (1,), p.dead_time_s)
        by_power = np.zeros((2, 3 * h.n_history))
        for segment, weight in zip(ahead.weight_segment, ahead.weight, strict=True):
            by_power[:, 3 * segment : 3 * segment + 3] = weight.reshape(2, 3)
        poles, gains = depth_modes(p)
        values: dict[str, Any] = {
            "n_steps": len(h.step_length_s),
            "n_weights": len(h.weight),
            "ahead_power": by_power,
            "ahead_mode": ahead.modes[0].tolist(),
            "torque_par": np.array([getattr(p, name) for name in TORQUE_PARAMETERS]),
            "friction": (p.friction_constant_nm, p.friction_linear_nm_per_rpm, p.friction_quadratic_nm_per_rpm2),
            "depth_gain": (gains[0], gains[1]),
            "slow_pole": poles[1],
            "fast_gain": -gains[2] / poles[2],
            "inertia_nm_s_per_rpm": p.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM,
        }
        for field, _ in KERNEL.ffi.typeof("fsw_nmpc_model").fields:
            if field not in values:  # it is a number or a table of this name
                values[field] = getattr(h if hasattr(h, field) else p, field)
        self.arrays = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
        self._pointers = {name: pointer(array) for name, array in self.arrays.items()}
        self.model = KERNEL.new("fsw_nmpc_model", **(values | self._pointers))


class Library(CController):
    """One controller in the loaded library.

    Parameters
    ----------
    parameters : ModelParameters
    horizon : Horizon
    tuning : Any
        A ``fsw_nmpc_tuning *``.
    lib : Any, optional
        Another build of the library.

    Raises
    ------
    RuntimeError, OSError
        If the library cannot be built or loaded.
    ValueError
        If the horizon is larger than the library was compiled for, or the tuning cannot be used.
    """

    def __init__(self, parameters: ModelParameters, horizon: Horizon, tuning: Any, lib: Any = None) -> None:
        self.horizon, self._tables = horizon, Tables(parameters, horizon)
        refusal = (
            f"horizon: {horizon.n_out} intervals, {horizon.n_blocks} blocks, {len(horizon.step_length_s)} steps and "
            f"{horizon.n_history} ticks of dead time exceed the sizes for which the controller library was compiled"
        )
        super().__init__(KERNEL, lib, refusal, self._tables.model, tuning)
        self._refusal = "tuning: a value is not finite, or a minimum is not below its maximum"

    @property
    def problem(self) -> Any:
        """The problem of the tick, a ``fsw_problem *`` into ``state``."""
        return KERNEL.ffi.addressof(self.state, "problem")

    def go_on_from(self, other: Library) -> None:
        """Take over estimate and plan of a library with the same model and perhaps other blocks."""
        self.reset(other.state.applied[0], other.state.applied[1])
        kept = ("estimator", "corridor", "rate", "has_corridor", "has_rate", "has_reference", "reference", "late_s")
        for name in (*kept, "bad_cycles", "plan"):
            setattr(self.state, name, getattr(other.state, name))
        plan = self.state.plan
        moves = np.array(list(plan.moves)).reshape(-1, 2)[other.horizon.interval_block]
        for i in range(2):
            per_block = np.bincount(self.horizon.interval_block, moves[:, i]) / self.horizon.block_sizes
            for block, move in enumerate(per_block.tolist()):
                plan.moves[2 * block + i] = move
                plan.start[2 * block + i] = 0.0 if plan.is_cold else move

    def begin(self) -> bool:
        """First half of a tick; whether there is a problem to solve (:attr:`problem`)."""
        return bool(self.lib.fsw_nmpc_begin(self.state, self.input, self.output))

    def end(self, moves: Vector, depth_mm: Vector, temperature_c: Vector, status: int) -> None:
        """Second half, with the answer of a solver."""
        arrays = (pointer(np.ascontiguousarray(a)) for a in (moves, depth_mm, temperature_c))
        self.lib.fsw_nmpc_end(self.state, *arrays, status, self.output)

    def predict(self, start: Any, moves: Vector) -> tuple[Vector, Vector, Vector, Vector]:
        """Outputs and sensitivities along ``moves`` (2 n_blocks,) from a ``fsw_start *``.

        Returns
        -------
        depth_mm, temperature_c : (n_out,) arrays
        by_depth, by_temperature : (n_out, 2 n_blocks) arrays

        Raises
        ------
        FloatingPointError
            If the prediction is not finite.
        """
        n = self.horizon.n_out
        found = np.zeros(n), np.zeros(n), np.zeros((n, 2 * self.horizon.n_blocks)), np.zeros((n, len(moves)))
        if self.lib.fsw_predict(self.state, start, *(pointer(a) for a in (np.ascontiguousarray(moves), *found))):
            raise FloatingPointError("the prediction is not finite")
        return found

    def solve(self, problem: Any, moves: Vector) -> tuple[int, Vector, Vector, Vector]:
        """One real-time iteration about ``moves``; residuals and cost are in ``output``.

        Parameters
        ----------
        problem : Any
            A ``fsw_problem *``.
        moves : (2 n_blocks,) array

        Returns
        -------
        status : SolveStatus
        moves : (2 n_blocks,) array
        depth_mm, temperature_c : (n_out,) arrays
        """
        found = np.array(moves, dtype=np.float64), np.zeros(self.horizon.n_out), np.zeros(self.horizon.n_out)
        status = self.lib.fsw_solve(self.state, problem, *map(pointer, found), self.output)
        return SolveStatus(status), *found


def pointer(array: NDArray[Any]) -> Any:
    """Pointer to the data of a contiguous array of float64 or int32, which it keeps alive."""
    return KERNEL.ffi.from_buffer({"d": "double[]", "i": "int[]"}[array.dtype.char], array)
