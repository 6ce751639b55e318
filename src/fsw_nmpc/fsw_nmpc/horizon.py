"""The prediction horizon: grid (36), moves, model steps and the exact weights of the dead time.

Copper and tool at the end of a step are linear in the power that entered one dead time earlier.
The power within a step is ``P0 + P1 s/h + P2 exp(-s / motor lag)``, exact for a linear process
torque. The weights of these three are computed once, exactly, for every step and any dead time,
also where a long step of the tail spans many short ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fsw_model import STEP_S, ModelParameters
from fsw_model.equations import depth_modes, matrix_exponential, power_response, thermal_block

Vector = NDArray[np.float64]
Indices = NDArray[np.int32]


#: Grid of the paper (36): every 0.1 s up to 5 s, then 7, 10, 15 and 30 s.
PAPER_GRID_S = (*(round(0.1 * k, 1) for k in range(51)), 7.0, 10.0, 15.0, 30.0)
#: Block lengths in intervals, by the number of blocks: fine where the plan will be applied, coarse
#: later (move blocking); or a move in every interval of the paper's grid.
BLOCK_LENGTHS = {20: (*([1] * 6), 2, 2, 2, 2, 3, 3, 4, 5, 7, 14, 1, 1, 1, 1), 54: (1,) * 54}
BLOCKS = tuple(BLOCK_LENGTHS)
#: No model step is longer than the dead time; a shorter dead time would need more steps than the
#: library has.
LEAST_DEAD_TIME_S = 0.9


def horizon_of(parameters: ModelParameters, blocks: int) -> Horizon:
    """The paper's grid with 20 blocks of ramps, or with a move in every interval (54).

    With 20 blocks a move in the tail may be as large as its interval permits; with 54, as in the
    paper, at most that of one tick.

    Raises
    ------
    ValueError
        If ``blocks`` is neither, or the dead time is too short.
    """
    if blocks not in BLOCK_LENGTHS:
        raise ValueError(f"horizon: {blocks} blocks; known: {', '.join(map(str, BLOCKS))}")
    if parameters.dead_time_s < LEAST_DEAD_TIME_S:
        raise ValueError(
            f"model parameter 'dead_time_s' is {parameters.dead_time_s:g}: "
            f"the NMPC needs at least {LEAST_DEAD_TIME_S:g} s"
        )
    return make_horizon(
        parameters, PAPER_GRID_S, BLOCK_LENGTHS[blocks], long_moves=blocks == BLOCKS[0]
    )


@dataclass(frozen=True, slots=True)
class Horizon:
    """Grid, blocks and the tables that a prediction needs."""

    time_s: Vector  #: (n_out,) output points, the ends of the intervals
    interval_block: Indices  #: (n_out,) block of moves of each interval
    interval_ticks: Vector  #: (n_out,) length of each interval
    #: (n_blocks,) largest move in a block's intervals, in largest moves of a tick
    block_reach: Vector
    #: (n_steps,) model steps, none longer than ``longest_step_s``
    step_length_s: Vector
    step_interval: Indices
    out_step: Indices  #: (n_out,) step whose end is the output point
    #: (n_out,) number of leading variables (two per block) that an output depends on
    depth_width: Indices
    temperature_width: Indices
    #: (n_steps, 10) gain of creep; decay and gain of the slow mode; decay of the motor torque and
    #: its lag over the step's length; transition of (copper, tool): cc, tc, tt; gains of a
    #: constant power
    modes: Vector
    #: delayed power: (n_steps + 1,) first weight of a step, (n,) segment (history first), (n, 6)
    #: weights of its three coefficients on copper, then on the tool
    weight_start: Indices
    weight_segment: Indices
    weight: Vector
    #: power segments before now, of 0.1 s each; the oldest one counts in part if the dead time is
    #: not a multiple of that
    n_history: int

    @property
    def n_out(self) -> int:
        """Number of output points."""
        return len(self.time_s)

    @property
    def n_blocks(self) -> int:
        """Number of blocks of moves; there are two variables per block."""
        return int(self.interval_block[-1]) + 1

    @property
    def block_sizes(self) -> Vector:
        """Intervals per block, shape (n_blocks,)."""
        return np.bincount(self.interval_block).astype(np.float64)


def make_horizon(
    parameters: ModelParameters,
    grid_s: tuple[float, ...],
    block_lengths: tuple[int, ...],
    longest_step_s: float = 1.0,
    long_moves: bool = False,
) -> Horizon:
    """Tables for a model, a grid and a choice of blocks.

    Parameters
    ----------
    parameters : ModelParameters
    grid_s : tuple of float
        Increasing times from 0.
    block_lengths : tuple of int
        Intervals per block; ``(1,) * n`` for a move in every interval.
    longest_step_s : float
        Longest model step in the tail; never longer than the dead time.
    long_moves : bool
        Whether a move of a longer interval may be larger, in proportion.
    """
    grid, dead_time_s = np.array(grid_s), parameters.dead_time_s
    spans, n_blocks = np.diff(grid), len(block_lengths)
    blocks = np.repeat(np.arange(n_blocks), block_lengths).astype(np.int32)
    ticks = spans / STEP_S
    parts = np.maximum(1, np.ceil(spans / min(longest_step_s, dead_time_s) - 1e-9)).astype(
        np.int32
    )
    length = np.repeat(spans / parts, parts)
    reaches = np.searchsorted(grid, grid[1:] - dead_time_s - 1e-9, side="right") - 1
    weight_start, weight_segment, weight, n_history = _delayed_power(parameters, length)
    return Horizon(
        time_s=grid[1:].copy(),
        interval_block=blocks,
        interval_ticks=ticks,
        block_reach=np.array([ticks[blocks == b].min() for b in range(n_blocks)])
        if long_moves
        else np.ones(n_blocks),
        step_length_s=length,
        step_interval=np.repeat(np.arange(len(spans)), parts).astype(np.int32),
        out_step=(np.cumsum(parts) - 1).astype(np.int32),
        depth_width=(2 * (blocks + 1)).astype(np.int32),
        temperature_width=np.where(
            grid[1:] > dead_time_s + 1e-9, 2 * (blocks[reaches] + 1), 0
        ).astype(np.int32),
        modes=np.array([_modes(parameters, h) for h in length]),
        weight_start=weight_start,
        weight_segment=weight_segment,
        weight=weight,
        n_history=n_history,
    )


def _delayed_power(p: ModelParameters, length: Vector) -> tuple[Indices, Indices, Vector, int]:
    """Tables of the delayed power (first weight, segment, weights), and length of the history."""
    n_history = int(np.ceil(p.dead_time_s / STEP_S - 1e-9))
    ends = np.cumsum(length)
    starts = np.concatenate([-STEP_S * np.arange(n_history, 0, -1), ends - length])
    lengths = np.concatenate([np.full(n_history, STEP_S), length])
    entries_of_steps = [
        _delayed_weights(p, end - h - p.dead_time_s, h, starts, lengths)
        for end, h in zip(ends, length, strict=True)
    ]
    counts = np.cumsum([0, *map(len, entries_of_steps)], dtype=np.int32)
    segments, weights = zip(*(entry for step in entries_of_steps for entry in step), strict=True)
    return counts, np.array(segments, dtype=np.int32), np.array(weights), n_history


def _modes(p: ModelParameters, h: float) -> Vector:
    """Exact transition over a step of ``h`` seconds under constant inputs, shape (10,).

    The last column of the exponential of the thermal block, extended by its input, is the response
    to a constant power (Van Loan 1978).
    """
    poles, gains = depth_modes(p)
    decay = np.exp(poles[1] * h)
    gain = (decay - 1.0) / poles[1] * gains[1]
    a, b = thermal_block(p)
    chain = np.zeros((3, 3))
    chain[:2, :2], chain[:2, 2] = a, b
    e = matrix_exponential(chain * h)
    motor = np.exp(-h / p.motor_lag_s)
    return np.array(
        [
            gains[0] * h,
            decay,
            gain,
            motor,
            p.motor_lag_s / h,
            e[0, 0],
            e[1, 0],
            e[1, 1],
            e[0, 2],
            e[1, 2],
        ]
    )


def _delayed_weights(
    p: ModelParameters, window_start: float, h: float, starts: Vector, lengths: Vector
) -> list[tuple[int, Vector]]:
    """Weights of the power segments that overlap [window_start, window_start + h]."""
    a, _ = thermal_block(p)
    result = []
    for j in np.nonzero(
        (starts < window_start + h - 1e-9) & (starts + lengths > window_start + 1e-9)
    )[0]:
        begin, end = max(starts[j], window_start), min(starts[j] + lengths[j], window_start + h)
        response = power_response(p, float(lengths[j]), begin - starts[j], end - begin)[
            :, [0, 1, 3]
        ]
        onward = matrix_exponential(a * (window_start + h - end))
        result.append((int(j), (onward @ response).ravel()))
    return result
