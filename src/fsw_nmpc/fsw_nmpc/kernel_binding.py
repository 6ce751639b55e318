"""ctypes binding of the C kernel (``kernel/fsw_nmpc.h``)."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fsw_model import ModelParameters
from fsw_nmpc.horizon import Horizon
from fsw_nmpc.kernel_codegen import TORQUE_PARAMETERS

_double_p = ctypes.POINTER(ctypes.c_double)
_int_p = ctypes.POINTER(ctypes.c_int)
Vector = NDArray[np.float64]


class KernelModel(ctypes.Structure):
    """``fsw_nmpc_model``."""

    _fields_ = [
        ("n_steps", ctypes.c_int),
        ("n_out", ctypes.c_int),
        ("n_blocks", ctypes.c_int),
        ("n_history", ctypes.c_int),
        ("step_interval", _int_p),
        ("interval_block", _int_p),
        ("out_step", _int_p),
        ("depth_width", _int_p),
        ("temp_width", _int_p),
        ("modes", _double_p),
        ("weight_start", _int_p),
        ("weight_segment", _int_p),
        ("weight", _double_p),
        ("torque_par", _double_p),
        ("operating_depth_mm", ctypes.c_double),
        ("operating_force_kn", ctypes.c_double),
    ]


class KernelCall(ctypes.Structure):
    """``fsw_nmpc_call``."""

    _fields_ = [
        ("x", ctypes.c_double * 5),
        ("history", _double_p),
        ("force_kn", ctypes.c_double),
        ("speed_rpm", ctypes.c_double),
        ("force_offset_kn", ctypes.c_double),
        ("torque_scale", ctypes.c_double),
        ("depth_offset_mm", ctypes.c_double),
        ("temp_offset_c", ctypes.c_double),
        ("depth_low", _double_p),
        ("depth_high", _double_p),
        ("temp_low", _double_p),
        ("temp_high", _double_p),
        ("depth_weight", _double_p),
        ("temp_weight", _double_p),
        ("depth_square", _double_p),
        ("temp_square", _double_p),
        ("move_weight", ctypes.c_double * 2),
        ("move_square", ctypes.c_double * 2),
        ("move_max", ctypes.c_double * 2),
        ("input_min", ctypes.c_double * 2),
        ("input_max", ctypes.c_double * 2),
        ("max_iterations", ctypes.c_int),
        ("tolerance", ctypes.c_double),
    ]


class KernelResult(ctypes.Structure):
    """``fsw_nmpc_result``."""

    _fields_ = [
        ("status", ctypes.c_int),
        ("iterations", ctypes.c_int),
        ("gap", ctypes.c_double),
        ("primal_residual", ctypes.c_double),
        ("dual_residual", ctypes.c_double),
        ("cost", ctypes.c_double),
    ]


def doubles(array: Vector) -> ctypes._Pointer[ctypes.c_double]:
    """Pointer to the data of a contiguous float64 array; the caller keeps the array alive."""
    if array.dtype != np.float64 or not array.flags.c_contiguous:
        raise TypeError("kernel arrays must be contiguous float64")
    return array.ctypes.data_as(_double_p)


def _ints(array: NDArray[np.int32]) -> ctypes._Pointer[ctypes.c_int]:
    if array.dtype != np.int32 or not array.flags.c_contiguous:
        raise TypeError("kernel index arrays must be contiguous int32")
    return array.ctypes.data_as(_int_p)


class Kernel:
    """A loaded kernel with its model tables and workspace.

    Parameters
    ----------
    library : Path
        The shared library, see ``kernel_build``.
    parameters : ModelParameters
    horizon : Horizon

    Raises
    ------
    OSError
        If the library cannot be loaded.
    """

    def __init__(self, library: Path, parameters: ModelParameters, horizon: Horizon) -> None:
        self._lib = ctypes.CDLL(str(library))
        self._lib.fsw_nmpc_workspace_bytes.restype = ctypes.c_int
        self.workspace_bytes: int = self._lib.fsw_nmpc_workspace_bytes()
        self._workspace = np.zeros(self.workspace_bytes // 8 + 1)
        self._torque_par = np.array([getattr(parameters, name) for name in TORQUE_PARAMETERS])
        self._horizon = horizon
        h = horizon
        self.model = KernelModel(
            len(h.step_length_s), h.n_out, h.n_blocks, h.n_history,
            _ints(h.step_interval), _ints(h.interval_block), _ints(h.out_step), _ints(h.depth_width),
            _ints(h.temperature_width), doubles(h.modes), _ints(h.weight_start), _ints(h.weight_segment),
            doubles(h.weight), doubles(self._torque_par), parameters.operating_depth_mm, parameters.operating_force_kn,
        )  # fmt: skip
        self.result = KernelResult()
        self.depth_mm = np.zeros(h.n_out)
        self.temperature_c = np.zeros(h.n_out)
        self._outputs = (doubles(self.depth_mm), doubles(self.temperature_c))
        self._model_ref = ctypes.byref(self.model)
        self._result_ref = ctypes.byref(self.result)
        self._workspace_ref = self._workspace.ctypes.data_as(ctypes.c_void_p)

    def predict(self, call: KernelCall, moves: Vector) -> tuple[Vector, Vector, Vector, Vector]:
        """Outputs and sensitivities along ``moves`` (2 n_blocks,).

        Returns
        -------
        depth_mm, temperature_c : (n_out,) arrays
        by_depth, by_temperature : (n_out, 2 n_blocks) arrays
            Derivatives by the moves.

        Raises
        ------
        FloatingPointError
            If the prediction is not finite.
        """
        shape = (self._horizon.n_out, 2 * self._horizon.n_blocks)
        by_depth, by_temperature = np.zeros(shape), np.zeros(shape)
        status = self._lib.fsw_nmpc_predict(
            self._model_ref, ctypes.byref(call), doubles(moves), *self._outputs, doubles(by_depth),
            doubles(by_temperature), self._workspace_ref,
        )  # fmt: skip
        if status:
            raise FloatingPointError("kernel: the prediction is not finite")
        return self.depth_mm.copy(), self.temperature_c.copy(), by_depth, by_temperature

    def solve(self, call: KernelCall, moves: ctypes._Pointer[ctypes.c_double]) -> KernelResult:
        """One real-time iteration: the solution replaces ``moves``, its outputs those in ``depth_mm`` and so on."""
        self._lib.fsw_nmpc_solve(
            self._model_ref, ctypes.byref(call), moves, *self._outputs, self._result_ref, self._workspace_ref
        )
        return self.result
