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
from fsw_nmpc.tuning import Settings
from fsw_nmpc.tuning_struct import values

Vector = NDArray[np.float64]

KERNEL = CLibrary("fsw_nmpc", Path(__file__).parent / "kernel")
#: Parameters of the torque function, in the order of the kernel's ``torque_par``.
TORQUE_PARAMETERS = (
    "sticking_stress_pa",
    "sliding_friction",
    "contact_radius_m",
    "contact_slope",
    "geometry_offset_m3",
    "geometry_factor",
)
SolveStatus = KERNEL.enum("fsw_solve_status", "FSW_")
Reason = KERNEL.enum("fsw_reason", "FSW_")
Missing = KERNEL.enum("fsw_missing", "FSW_NO_")
State = KERNEL.enum("fsw_state", "FSW_")


def tuning_of(settings: Settings) -> Any:
    """The settings as a ``fsw_nmpc_tuning *`` of the library."""
    return KERNEL.new("fsw_nmpc_tuning", **values(settings))


class Tables:
    """The model's tables for the library; they must outlive every controller that uses them."""

    def __init__(self, parameters: ModelParameters, horizon: Horizon) -> None:
        p, h = parameters, horizon
        ahead = make_horizon(p, (0.0, p.dead_time_s), (1,), p.dead_time_s)
        by_power = np.zeros((2, 3 * h.n_history))
        for segment, weight in zip(ahead.weight_segment, ahead.weight, strict=True):
            by_power[:, 3 * segment : 3 * segment + 3] = weight.reshape(2, 3)
        poles, gains = depth_modes(p)
        numbers: dict[str, Any] = {
            "n_steps": len(h.step_length_s),
            "n_weights": len(h.weight),
            "ahead_power": by_power,
            "ahead_mode": ahead.modes[0].tolist(),
            "torque_par": np.array([getattr(p, name) for name in TORQUE_PARAMETERS]),
            "friction": (
                p.friction_constant_nm,
                p.friction_linear_nm_per_rpm,
                p.friction_quadratic_nm_per_rpm2,
            ),
            "depth_gain": (gains[0], gains[1]),
            "slow_pole": poles[1],
            "fast_gain": -gains[2] / poles[2],
            "inertia_nm_s_per_rpm": p.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM,
        }
        for field, _ in KERNEL.ffi.typeof("fsw_nmpc_model").fields:
            if field not in numbers:  # the attribute itself is a number or table
                numbers[field] = getattr(h if hasattr(h, field) else p, field)
        #: arrays that the model's pointers refer to, by field
        self.arrays = {
            name: value for name, value in numbers.items() if isinstance(value, np.ndarray)
        }
        self._pointers = {name: pointer(array) for name, array in self.arrays.items()}
        self.model = KERNEL.new(
            "fsw_nmpc_model", **(numbers | self._pointers)
        )  #: a ``fsw_nmpc_model *``


class Library(CController):
    """A controller of the library; ``tuning`` is a ``fsw_nmpc_tuning *``, ``lib`` another build.

    Raises
    ------
    RuntimeError, OSError
        If the library cannot be built or loaded.
    ValueError
        If the horizon exceeds the compiled sizes, or the tuning is invalid.
    """

    def __init__(
        self, parameters: ModelParameters, horizon: Horizon, tuning: Any, lib: Any = None
    ) -> None:
        self.horizon, self.tables = horizon, Tables(parameters, horizon)
        refusal = (
            f"horizon: {horizon.n_out} intervals, {horizon.n_blocks} blocks, "
            f"{len(horizon.step_length_s)} steps and {horizon.n_history} ticks of dead time "
            "exceed the sizes for which the controller library was compiled"
        )
        super().__init__(KERNEL, lib, refusal, self.tables.model, tuning)
        self._refusal = "tuning: a value is not finite, or a minimum is not below its maximum"

    def go_on_from(self, other: Library) -> None:
        """Take over estimate and plan of a controller with the same model; blocks may differ."""
        self.reset(other.state.applied[0], other.state.applied[1])
        kept = (
            "estimator",
            "corridor",
            "rate",
            "has_corridor",
            "has_rate",
            "has_reference",
            "reference",
        )
        for name in (*kept, "late_s", "bad_cycles", "plan"):
            setattr(self.state, name, getattr(other.state, name))
        plan = self.state.plan
        moves = np.array(list(plan.moves)).reshape(-1, 2)[other.horizon.interval_block]
        for i in range(2):
            per_block = (
                np.bincount(self.horizon.interval_block, moves[:, i]) / self.horizon.block_sizes
            )
            for block, move in enumerate(per_block.tolist()):
                plan.moves[2 * block + i] = move
                plan.start[2 * block + i] = 0.0 if plan.is_cold else move


def pointer(array: NDArray[Any]) -> Any:
    """Pointer to a contiguous array of float64 or int32, which it keeps alive."""
    return KERNEL.ffi.from_buffer({"d": "double[]", "i": "int[]"}[array.dtype.char], array)
