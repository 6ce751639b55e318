"""The optimal control problem of one tick, and what a solver is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fsw_control import Command, Limits
from fsw_nmpc.horizon import Horizon
from fsw_nmpc.tuning import Tuning

Vector = NDArray[np.float64]


@dataclass(slots=True)
class Estimate:
    """What the prediction starts from.

    Attributes
    ----------
    x : (5,) array
        State of the linear blocks, in the order of ``fsw_model.equations.STATE_NAMES``.
    history_kw : (2 n_history,) array
        Power on its way through the dead time: left and right value of each step, oldest first.
    force_offset_kn : float
        Disturbance of the axial force.
    torque_scale : float
        Real process torque over the model's.
    depth_offset_mm, temperature_offset_c : float
        Disturbances of the outputs.
    """

    x: Vector
    history_kw: Vector
    force_offset_kn: float = 0.0
    torque_scale: float = 1.0
    depth_offset_mm: float = 0.0
    temperature_offset_c: float = 0.0


@dataclass(slots=True)
class Problem:
    """One tick's problem (28)-(37): estimate, inputs applied last, dead-bands around the corridors, weights per row."""

    estimate: Estimate
    applied: Command
    limits: Limits
    depth_low_mm: Vector
    depth_high_mm: Vector
    temperature_low_c: Vector
    temperature_high_c: Vector
    weights: Weights

    def objective(self, horizon: Horizon, moves: Vector, depth_mm: Vector, temperature_c: Vector) -> float:
        """Cost (28) of moves (2 n_blocks,) and the outputs (n_out,) that they lead to."""
        w, total = self.weights, 0.0
        for output, low, high, weight, square in (
            (depth_mm, self.depth_low_mm, self.depth_high_mm, w.depth, w.depth_square),
            (temperature_c, self.temperature_low_c, self.temperature_high_c, w.temperature, w.temperature_square),
        ):
            outside = np.maximum(output - high, 0.0) + np.maximum(low - output, 0.0)
            total += float(weight @ outside + 0.5 * square @ (output - 0.5 * (low + high)) ** 2)
        pairs = np.abs(moves.reshape(-1, 2))
        each = pairs @ np.array(w.move) + 0.5 * pairs**2 @ np.array(w.move_square)
        return total + float(horizon.block_sizes @ each)


@dataclass(slots=True)
class Weights:
    """Weights per output point (n_out,) and per move."""

    depth: Vector
    temperature: Vector
    depth_square: Vector
    temperature_square: Vector
    move: tuple[float, float]
    move_square: tuple[float, float]

    @classmethod
    def from_tuning(cls, tuning: Tuning, horizon: Horizon, limits: Limits) -> Weights:
        """Spread a tuning over the horizon."""
        lengths = np.diff(np.concatenate([[0.0], horizon.time_s])) / 0.1
        row = lengths**tuning.interval_weighting
        return cls(
            depth=tuning.weight_depth_per_mm * row,
            temperature=tuning.weight_temperature_per_c * row,
            depth_square=tuning.square_depth_per_mm2 * row,
            temperature_square=tuning.square_temperature_per_c2 * row,
            move=(tuning.move_force_per_kn, tuning.move_speed_per_rpm),
            move_square=(tuning.move_force_square, tuning.move_speed_square / 3.0**2),
        )


@dataclass(slots=True)
class Solution:
    """A solver's answer.

    Attributes
    ----------
    moves : (2 n_blocks,) array
        Force (kN) and speed (rpm) move per interval of each block, interleaved.
    depth_mm, temperature_c : (n_out,) arrays
        Predicted outputs.
    status : str
        ``solved`` or what went wrong.
    """

    moves: Vector
    depth_mm: Vector
    temperature_c: Vector
    status: str
    iterations: int
    cost: float

    @property
    def solved(self) -> bool:
        """Whether the solver met its tolerance."""
        return self.status == "solved"


class Solver(Protocol):
    """Anything that solves a :class:`Problem`, starting from given moves."""

    name: str
    horizon: Horizon

    def solve(self, problem: Problem, moves: Vector) -> Solution:
        """Solve; never raises on a bad problem, but answers with a status."""
        ...
