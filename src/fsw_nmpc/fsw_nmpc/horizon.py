"""The prediction horizon: grid (28), moves, model steps and the exact weights of the dead time.

The temperature at the end of a step is linear in the power that entered one dead time earlier. The power jumps with the
spindle speed, so it is taken as linear within each step, with a left and a right value; the weights of these values are
computed once, exactly, for every step, also where a long step of the tail looks back over many short ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fsw_model import STEP_S, ModelParameters
from fsw_model.equations import linear_blocks, matrix_exponential

Vector = NDArray[np.float64]
Indices = NDArray[np.int32]


def paper_grid() -> tuple[float, ...]:
    """Grid of the paper (28): every 0.1 s up to 5 s, then 7, 10, 15 and 30 s."""
    return (*(round(0.1 * k, 1) for k in range(51)), 7.0, 10.0, 15.0, 30.0)


def default_block_lengths() -> tuple[int, ...]:
    """Lengths, in intervals, of 20 blocks: fine where the plan will be applied, coarse later."""
    return (*([1] * 6), 2, 2, 2, 2, 3, 3, 4, 5, 6, 7, 8, 2, 1, 1)


def horizon_of(parameters: ModelParameters, blocks: int) -> Horizon:
    """The paper's grid with 20 blocks of ramps, or with a move in every interval (54).

    Raises
    ------
    ValueError
        If ``blocks`` is neither.
    """
    choices = {20: None, len(paper_grid()) - 1: (1,) * (len(paper_grid()) - 1)}
    if blocks not in choices:
        raise ValueError(f"horizon: {blocks} blocks; known: {', '.join(map(str, choices))}")
    return make_horizon(parameters, block_lengths=choices[blocks])


@dataclass(frozen=True, slots=True)
class Horizon:
    """Grid, blocks and the tables that a prediction needs.

    Attributes
    ----------
    time_s : (n_out,) array
        Output points (the ends of the intervals).
    interval_block : (n_out,) int array
        Block of moves of each interval.
    step_length_s, step_interval : (n_steps,) arrays
        Model steps, none longer than ``longest_step_s``.
    out_step : (n_out,) int array
        Step whose end is the output point.
    depth_width, temperature_width : (n_out,) int arrays
        Leading variables (two per block) that an output depends on.
    modes : (n_steps, 10) array
        Per step: creep gain; decay and gain of the slow and the fast part; thermal-depth/temperature transition
        (tt, tT, TT); constants of both.
    weight_start : (n_steps + 1,) int array
    weight_segment : (n,) int array
    weight : (n, 4) array
        Delayed power: segment (history first), weights on (thermal depth, temperature) of left and right value.
    n_history : int
        Power segments before now.
    """

    time_s: Vector
    interval_block: Indices
    step_length_s: Vector
    step_interval: Indices
    out_step: Indices
    depth_width: Indices
    temperature_width: Indices
    modes: Vector
    weight_start: Indices
    weight_segment: Indices
    weight: Vector
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
    grid_s: tuple[float, ...] | None = None,
    block_lengths: tuple[int, ...] | None = None,
    longest_step_s: float = 1.0,
) -> Horizon:
    """Tables for a model, a grid and a choice of blocks.

    Parameters
    ----------
    parameters : ModelParameters
    grid_s : tuple of float, optional
        Increasing times from 0; the paper's grid by default.
    block_lengths : tuple of int, optional
        Intervals per block; ``(1,) * n`` for a move in every interval. 20 blocks by default.
    longest_step_s : float
        Longest model step in the tail, less than the dead time.

    Raises
    ------
    ValueError
        If the grid, the blocks or the longest step do not fit together.
    """
    grid = np.array(paper_grid() if grid_s is None else grid_s)
    lengths = default_block_lengths() if block_lengths is None else block_lengths
    if grid[0] != 0.0 or np.any(np.diff(grid) <= 0):
        raise ValueError("horizon grid: must begin at 0 and increase")
    n_out = len(grid) - 1
    if sum(lengths) != n_out or min(lengths) < 1:
        raise ValueError(f"horizon blocks: lengths must be >= 1 and add up to {n_out} intervals, not {sum(lengths)}")
    if not 0 < longest_step_s < parameters.dead_time_s:
        raise ValueError(f"horizon: longest_step_s must lie between 0 and the dead time {parameters.dead_time_s} s")
    blocks = np.repeat(np.arange(len(lengths)), lengths).astype(np.int32)

    length: list[float] = []
    interval: list[int] = []
    for i, span in enumerate(np.diff(grid)):
        parts = max(1, int(np.ceil(span / longest_step_s - 1e-9)))
        length += [float(span) / parts] * parts
        interval += [i] * parts
    ends = np.cumsum(length)
    step_interval = np.array(interval, dtype=np.int32)
    out_step = np.array([np.nonzero(step_interval == i)[0][-1] for i in range(n_out)], dtype=np.int32)
    reaches = np.searchsorted(grid, grid[1:] - parameters.dead_time_s - 1e-9, side="right") - 1
    temperature_width = np.array(
        [
            2 * (blocks[r] + 1) if g > parameters.dead_time_s + 1e-9 else 0
            for r, g in zip(reaches, grid[1:], strict=True)
        ],
        dtype=np.int32,
    )

    n_history = round(parameters.dead_time_s / STEP_S)
    starts = np.concatenate([-parameters.dead_time_s + STEP_S * np.arange(n_history), ends - np.array(length)])
    lengths_all = np.concatenate([np.full(n_history, STEP_S), length])
    modes = np.empty((len(length), 10))
    weight_start, weight_segment, weight = [0], [], []
    for k, h in enumerate(length):
        modes[k] = _modes(parameters, h)
        window = ends[k] - h - parameters.dead_time_s
        for segment, values in _delayed_weights(parameters, window, h, starts, lengths_all):
            weight_segment.append(segment)
            weight.append(values)
        weight_start.append(len(weight))
    return Horizon(
        time_s=grid[1:].copy(),
        interval_block=blocks,
        step_length_s=np.array(length),
        step_interval=step_interval,
        out_step=out_step,
        depth_width=(2 * (blocks + 1)).astype(np.int32),
        temperature_width=temperature_width,
        modes=modes,
        weight_start=np.array(weight_start, dtype=np.int32),
        weight_segment=np.array(weight_segment, dtype=np.int32),
        weight=np.array(weight),
        n_history=n_history,
    )


def _thermal(p: ModelParameters) -> tuple[Vector, Vector, Vector]:
    """The (thermal depth, temperature) block: matrix, power input, constant."""
    a, _, b_power, b_const = linear_blocks(p)
    return a[3:, 3:], b_power[3:], b_const[3:]


def _modes(p: ModelParameters, h: float) -> Vector:
    a, b_force, _, _ = linear_blocks(p)
    slow, fast = np.exp(a[1, 1] * h), np.exp(a[2, 2] * h)
    at, _, const = _thermal(p)
    chain = np.zeros((3, 3))
    chain[:2, :2], chain[:2, 2] = at, const
    e = matrix_exponential(chain * h)
    gain_slow, gain_fast = (slow - 1.0) / a[1, 1] * b_force[1], (fast - 1.0) / a[2, 2] * b_force[2]
    return np.array([b_force[0] * h, slow, gain_slow, fast, gain_fast, e[0, 0], e[0, 1], e[1, 1], e[0, 2], e[1, 2]])


def _delayed_weights(
    p: ModelParameters, window_start: float, h: float, starts: Vector, lengths: Vector
) -> list[tuple[int, Vector]]:
    """Weights of the power segments that overlap [window_start, window_start + h]."""
    at, b_power, _ = _thermal(p)
    result = []
    for j in np.nonzero((starts < window_start + h - 1e-9) & (starts + lengths > window_start + 1e-9))[0]:
        begin, end = max(starts[j], window_start), min(starts[j] + lengths[j], window_start + h)
        span = end - begin
        chain = np.zeros((4, 4))
        chain[:2, :2], chain[:2, 2], chain[2, 3] = at, b_power, 1.0
        piece = matrix_exponential(chain * span)[:2, 2:]  # response to power 1 and to power growing with slope 1
        onward = matrix_exponential(at * (window_start + h - end))
        constant, slope = onward @ piece[:, 0], onward @ piece[:, 1]
        at_begin = (begin - starts[j]) / lengths[j]
        right = constant * at_begin + slope / lengths[j]
        left = constant - right
        result.append((int(j), np.array([left[0], right[0], left[1], right[1]])))
    return result
