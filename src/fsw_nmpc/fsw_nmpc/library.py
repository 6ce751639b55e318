"""ctypes binding of the controller library (``kernel/fsw_controller.h``), and the model as its tables."""

from __future__ import annotations

import ctypes
from ctypes import c_double
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fsw_control.units import RAD_PER_S_PER_RPM
from fsw_model import ModelParameters
from fsw_model.equations import depth_modes
from fsw_nmpc.horizon import Horizon, make_horizon
from fsw_nmpc.kernel_codegen import TORQUE_PARAMETERS
from fsw_nmpc.kernel_structs import (
    ControllerHead,
    Input,
    Model,
    Output,
    ProblemStruct,
    Start,
    TuningStruct,
)

Vector = NDArray[np.float64]
DISTURBANCES = ("force_kn", "power_kw", "torque_scale", "depth_mm", "temperature_c")


class Fate(IntEnum):
    """What became of a solve."""

    OK = 0
    CAP = 1
    FAILED = 2
    TOO_FAST = 3
    BEYOND = 4
    UNSOLVED = 5


#: fates in words
FATES = {
    Fate.OK: "solved",
    Fate.CAP: "iteration cap",
    Fate.FAILED: "not finite",
    Fate.TOO_FAST: "solution moves faster than the limits",
    Fate.BEYOND: "solution leaves the bounds",
    Fate.UNSOLVED: "nothing to solve",
}


class Reason(IntEnum):
    """Why the proposal is as it is."""

    PROPOSING = 0
    WAITING_FOR_SENSORS = 1
    WAITING_FOR_REFERENCE = 2
    SOLVER_FAILED = 3
    BLIND = 4
    OUT_OF_BOUNDS = 5


class Tables:
    """The model's tables for the library; they must outlive every controller that is given them.

    Parameters
    ----------
    parameters : ModelParameters
    horizon : Horizon

    Attributes
    ----------
    model : Model
    """

    def __init__(self, parameters: ModelParameters, horizon: Horizon) -> None:
        p, h = parameters, horizon
        ahead = make_horizon(p, (0.0, p.dead_time_s), (1,), p.dead_time_s)
        by_power = np.zeros((2, 3 * h.n_history))
        for segment, weight in zip(ahead.weight_segment, ahead.weight, strict=True):
            by_power[:, 3 * segment : 3 * segment + 3] = weight.reshape(2, 3)
        torque = np.array([getattr(p, name) for name in TORQUE_PARAMETERS])
        poles, gains = depth_modes(p)
        self._kept = [by_power, torque, horizon]
        self.model = Model(
            n_steps=len(h.step_length_s),
            n_out=h.n_out,
            n_blocks=h.n_blocks,
            n_history=h.n_history,
            n_weights=len(h.weight),
            step_interval=_ints(h.step_interval),
            interval_block=_ints(h.interval_block),
            interval_ticks=doubles(h.interval_ticks),
            block_reach=doubles(h.block_reach),
            out_step=_ints(h.out_step),
            depth_width=_ints(h.depth_width),
            temp_width=_ints(h.temperature_width),
            time_s=doubles(h.time_s),
            modes=doubles(h.modes),
            weight_start=_ints(h.weight_start),
            weight_segment=_ints(h.weight_segment),
            weight=doubles(h.weight),
            ahead_power=doubles(by_power),
            ahead_mode=tuple(ahead.modes[0].tolist()),
            torque_par=doubles(torque),
            friction=(p.friction_constant_nm, p.friction_linear_nm_per_rpm, p.friction_quadratic_nm_per_rpm2),
            depth_gain=(gains[0], gains[1]),
            slow_pole=poles[1],
            fast_gain=-gains[2] / poles[2],
            softening_per_c=p.softening_per_c,
            thermal_gain_c_per_kw=p.thermal_gain_c_per_kw,
            copper_lag_s=p.copper_lag_s,
            tool_lag_s=p.tool_lag_s,
            dead_time_s=p.dead_time_s,
            inertia_nm_s_per_rpm=p.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM,
            operating_force_kn=p.operating_force_kn,
            operating_depth_mm=p.operating_depth_mm,
            operating_temperature_c=p.operating_temperature_c,
            operating_power_kw=p.operating_power_kw,
        )


class Library:
    """The loaded library and one controller in it.

    Parameters
    ----------
    path : Path
        The shared library, see ``kernel_build``.
    parameters : ModelParameters
    horizon : Horizon
    tuning : TuningStruct

    Attributes
    ----------
    state : ControllerHead
        The controller's memory, for tests and for other solvers.
    input, output : Input, Output
        Arguments of :meth:`step`.

    Raises
    ------
    OSError
        If the library cannot be loaded.
    ValueError
        If the horizon is larger than the library was compiled for.
    """

    def __init__(self, path: Path, parameters: ModelParameters, horizon: Horizon, tuning: TuningStruct) -> None:
        self.path, self.horizon = path, horizon
        self._lib = lib = ctypes.CDLL(str(path))
        self.bytes: int = lib.fsw_controller_bytes()
        self._memory = np.zeros(self.bytes // 8 + 1)
        self.state = ControllerHead.from_buffer(self._memory.data)
        self.input, self.output = Input(), Output()
        self._controller = ctypes.c_void_p(self._memory.ctypes.data)
        self._input, self._output = ctypes.byref(self.input), ctypes.byref(self.output)
        self._tables = Tables(parameters, horizon)
        self._step = lib.fsw_controller_step
        if lib.fsw_controller_init(self._controller, ctypes.byref(self._tables.model), ctypes.byref(tuning)):
            raise ValueError(
                f"horizon: {horizon.n_out} intervals, {horizon.n_blocks} blocks, {len(horizon.step_length_s)} steps "
                f"and {horizon.n_history} ticks of dead time are more than the controller library was compiled for"
            )

    def configure(self, tuning: TuningStruct) -> None:
        """Take another tuning; estimate and plan go on.

        Raises
        ------
        ValueError
            If the library does not take it; it goes on with the one before.
        """
        if self._lib.fsw_controller_configure(self._controller, ctypes.byref(tuning)):
            raise ValueError("tuning: a value is not finite, or the limits are no limits")

    def reset(self, force_kn: float, speed_rpm: float) -> None:
        """Forget the past."""
        self._lib.fsw_controller_reset(self._controller, c_double(force_kn), c_double(speed_rpm))

    def go_on_from(self, other: Library) -> None:
        """Take over estimate and plan of a library with the same model and perhaps other blocks."""
        self.reset(other.state.applied[0], other.state.applied[1])
        kept = ("estimator", "corridor", "rate", "has_corridor", "has_rate", "has_reference", "reference", "late_s")
        for name in (*kept, "bad_cycles"):
            setattr(self.state, name, getattr(other.state, name))
        mine, its = self.state.plan, other.state.plan
        ctypes.pointer(mine)[0] = its
        moves = np.array(its.moves).reshape(-1, 2)[other.horizon.interval_block]
        for i in range(2):
            per_block = np.bincount(self.horizon.interval_block, moves[:, i]) / self.horizon.block_sizes
            for block, move in enumerate(per_block.tolist()):
                mine.moves[2 * block + i] = move
                mine.start[2 * block + i] = 0.0 if its.is_cold else move

    def step(self) -> None:
        """One tick: ``input`` to ``output``."""
        self._step(self._controller, self._input, self._output)

    def begin(self) -> bool:
        """First half of a tick; whether there is a problem to solve (``state.problem``)."""
        return bool(self._lib.fsw_controller_begin(self._controller, self._input, self._output))

    def end(self, moves: Vector, depth_mm: Vector, temperature_c: Vector, fate: Fate) -> None:
        """Second half, with the answer of a solver."""
        arrays = (doubles(np.ascontiguousarray(a)) for a in (moves, depth_mm, temperature_c))
        self._lib.fsw_controller_end(self._controller, *arrays, int(fate), self._output)

    def predict(self, start: Start, moves: Vector) -> tuple[Vector, Vector, Vector, Vector]:
        """Outputs and sensitivities along ``moves`` (2 n_blocks,).

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
        found = [np.zeros(n), np.zeros(n), *(np.zeros((n, 2 * self.horizon.n_blocks)) for _ in range(2))]
        arrays = [doubles(a) for a in (np.ascontiguousarray(moves), *found)]
        if self._lib.fsw_predict(self._controller, ctypes.byref(start), *arrays):
            raise FloatingPointError("the prediction is not finite")
        return found[0], found[1], found[2], found[3]

    def solve(self, problem: ProblemStruct, moves: Vector) -> tuple[Fate, Vector, Vector, Vector]:
        """One real-time iteration about ``moves``; residuals and cost are in ``output``.

        Returns
        -------
        fate : Fate
        moves : (2 n_blocks,) array
        depth_mm, temperature_c : (n_out,) arrays
        """
        found = np.array(moves, dtype=np.float64), np.zeros(self.horizon.n_out), np.zeros(self.horizon.n_out)
        fate = self._lib.fsw_solve(self._controller, ctypes.byref(problem), *(doubles(a) for a in found), self._output)
        return Fate(fate), *found


def doubles(array: Vector) -> Any:
    """Pointer to the data of a contiguous float64 array; the caller keeps the array alive."""
    if array.dtype != np.float64 or not array.flags.c_contiguous:
        raise TypeError("arrays of the library must be contiguous float64")
    return array.ctypes.data_as(ctypes.POINTER(c_double))


def _ints(array: NDArray[np.int32]) -> Any:
    if array.dtype != np.int32 or not array.flags.c_contiguous:
        raise TypeError("index arrays of the library must be contiguous int32")
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_int))
