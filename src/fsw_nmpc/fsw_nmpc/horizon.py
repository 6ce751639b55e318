"""The prediction horizon: grid (36), moves, model steps and the exact weights of the dead time.

Copper and tool at the end of a step are linear in the power that entered one dead time earlier. The power within a step
is ``P0 + P1 s/h + P2 exp(-s / motor lag)``, which is exact where the process torque is linear; the weights of these
three are computed once, exactly, for every step, whatever the dead time, also where a long step of the tail looks back
over many short ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fsw_model import STEP_S, ModelParameters
from fsw_model.equations import depth_modes, matrix_exponential, power_response, thermal_block

Vector = NDArray[np.float64]
Indices = NDArray[np.int32]


#: Blocks of moves: those of :func:`default_block_lengths`, or a move in every interval of the paper's grid.
BLOCKS = (20, 54)
#: No model step is longer than the dead time; with a shorter one the tail would take more steps than the library has.
LEAST_DEAD_TIME_S = 0.9


def paper_grid() -> tuple[float, ...]:
    """Grid of the paper (36): every 0.1 s up to 5 s, then 7, 10, 15 and 30 s."""
    return (*(round(0.1 * k, 1) for k in range(51)), 7.0, 10.0, 15.0, 30.0)


def default_block_lengths() -> tuple[int, ...]:
    """Lengths, in intervals, of 20 blocks: fine where the plan will be applied, coarse later."""
    return (*([1] * 6), 2, 2, 2, 2, 3, 3, 4, 5, 7, 14, 1, 1, 1, 1)


def horizon_of(parameters: ModelParameters, blocks: int) -> Horizon:
    """The paper's grid with 20 blocks of ramps, or with a move in every interval (54).

    With 20 blocks a move of the tail may be as large as the inputs can go in its interval; with 54, as in the paper, no
    larger than in one tick.

    Raises
    ------
    ValueError
        If ``blocks`` is neither, or the dead time is too short.
    """
    choices: dict[int, tuple[int, ...]] = {BLOCKS[0]: default_block_lengths(), BLOCKS[1]: (1,) * BLOCKS[1]}
    if blocks not in choices:
        raise ValueError(f"horizon: {blocks} blocks; known: {', '.join(map(str, choices))}")
    if parameters.dead_time_s < LEAST_DEAD_TIME_S:
        raise ValueError(
            f"model parameter 'dead_time_s' is {parameters.dead_time_s:g}: "
            f"the NMPC needs at least {LEAST_DEAD_TIME_S:g} s"
        )
    return make_horizon(parameters, block_lengths=choices[blocks], long_moves=blocks == BLOCKS[0])


@dataclass(frozen=True, slots=True)
class Horizon:
    """Grid, blocks and the tables that a prediction needs.

    Attributes
    ----------
    time_s : (n_out,) array
        Output points (the ends of the intervals).
    interval_block : (n_out,) int array
        Block of moves of each interval.
    interval_ticks : (n_out,) array
        Length of each interval.
    block_reach : (n_blocks,) array
        Largest move of a block's intervals in largest moves of a tick.
    step_length_s, step_interval : (n_steps,) arrays
        Model steps, none longer than ``longest_step_s``.
    out_step : (n_out,) int array
        Step whose end is the output point.
    depth_width, temperature_width : (n_out,) int arrays
        Leading variables (two per block) that an output depends on.
    modes : (n_steps, 10) array
        Per step: gain of creep; decay and gain of the slow mode; decay of the motor torque and its lag over the step's
        length; transition of (copper, tool): cc, tc, tt; their gains of a constant power.
    weight_start : (n_steps + 1,) int array
    weight_segment : (n,) int array
    weight : (n, 6) array
        Delayed power: segment (history first), weights of its three coefficients on copper, then on the tool.
    n_history : int
        Power segments before now, of 0.1 s each; the oldest one counts in part if the dead time is no whole number.
    """

    time_s: Vector
    interval_block: Indices
    interval_ticks: Vector
    block_reach: Vector
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
    long_moves: bool = False,
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
        Longest model step in the tail; never longer than the dead time.

    long_moves : bool
        Whether a move of a longer interval may be larger, in proportion.

    Raises
    ------
    ValueError
        If the grid and the blocks do not fit together.
    """
    grid = np.array(paper_grid() if grid_s is None else grid_s)
    lengths = default_block_lengths() if block_lengths is None else block_lengths
    if grid[0] != 0.0 or np.any(np.diff(grid) <= 0):
        raise ValueError("horizon grid: must begin at 0 and increase")
    if len(grid) > 2 and abs(grid[1] - STEP_S) > 1e-9:
        raise ValueError(f"horizon grid: the first interval must be one tick of {STEP_S} s")
    n_out = len(grid) - 1
    if sum(lengths) != n_out or min(lengths) < 1:
        raise ValueError(f"horizon blocks: lengths must be >= 1 and add up to {n_out} intervals, not {sum(lengths)}")
    longest_step_s = min(longest_step_s, parameters.dead_time_s)
    blocks = np.repeat(np.arange(len(lengths)), lengths).astype(np.int32)

    ticks = np.diff(grid) / STEP_S
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

    n_history = int(np.ceil(parameters.dead_time_s / STEP_S - 1e-9))
    starts = np.concatenate([-STEP_S * np.arange(n_history, 0, -1), ends - np.array(length)])
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
        interval_ticks=ticks,
        block_reach=np.array([ticks[blocks == b].min() for b in range(len(lengths))])
        if long_moves
        else np.ones(len(lengths)),
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


def _modes(p: ModelParameters, h: float) -> Vector:
    poles, gains = depth_modes(p)
    decay = np.exp(poles[1] * h)
    gain = (decay - 1.0) / poles[1] * gains[1]
    a, b = thermal_block(p)
    chain = np.zeros((3, 3))
    chain[:2, :2], chain[:2, 2] = a, b
    e = matrix_exponential(chain * h)
    motor = np.exp(-h / p.motor_lag_s)
    return np.array([gains[0] * h, decay, gain, motor, p.motor_lag_s / h, e[0, 0], e[1, 0], e[1, 1], e[0, 2], e[1, 2]])


def _delayed_weights(
    p: ModelParameters, window_start: float, h: float, starts: Vector, lengths: Vector
) -> list[tuple[int, Vector]]:
    """Weights of the power segments that overlap [window_start, window_start + h]."""
    a, _ = thermal_block(p)
    result = []
    for j in np.nonzero((starts < window_start + h - 1e-9) & (starts + lengths > window_start + 1e-9))[0]:
        begin, end = max(starts[j], window_start), min(starts[j] + lengths[j], window_start + h)
        response = power_response(p, float(lengths[j]), begin - starts[j], end - begin)[:, [0, 1, 3]]
        onward = matrix_exponential(a * (window_start + h - end))
        result.append((int(j), (onward @ response).ravel()))
    return result
