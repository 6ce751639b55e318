"""The problem of a tick cut into a stage per block of moves, for solvers that use the structure of stages.

The prediction is that of the C kernel, term by term. A stage begins at a block's first interval
and has the block's moves as inputs, so blocked moves need no constraint. The dead time is cut by
superposition: what past power, heat and the present temperatures do is known beforehand and enters
as parameters. States hold what the power from now on does to copper and tool, one dead time early,
and the tool's values of that kind that have not arrived yet.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from fsw_model import ModelParameters
from fsw_model.equations import (
    depth_modes,
    friction_torque_nm,
    matrix_exponential,
    power_kw,
    power_response,
    process_torque_nm,
    thermal_block,
)
from fsw_nmpc.library import Library, State, Vector
from fsw_test_support.nmpc_ipopt import input_bounds, largest_moves, move_squares, squares

#: sizes of creep, slow mode, copper, tool, motor torque, force and speed, in which states are
#: counted
_SIZES = (0.1, 0.1, 10.0, 10.0, 100.0, 1.0, 3.0)
_TOOL = 3
#: indices of force and speed in a state; the last state has only these
INPUTS = (5, 6)
#: parameters of every stage: offset of the force, factor on the torque, offset of the speed,
#: factor on the depth's gain
_N_SHARED = 4
_SOON_S = 1e-9


@dataclass(frozen=True, slots=True)
class Stage:
    """Functions (x, u, p) of a stage. States are scaled, inputs are moves in largest moves.

    Attributes
    ----------
    step : ca.Function
        State of the next stage.
    outputs : ca.Function
        Depths (mm) and tool temperatures (deviation, degC) at the ends of the stage's intervals,
        where moves affect them.
    depth_points, tool_points : (n,) arrays of int
        Which of the horizon's output points these are.
    steps : (n,) array of int
        The model steps, for the known part of the tool's temperature.
    """

    step: ca.Function
    outputs: ca.Function
    depth_points: NDArray[np.int64]
    tool_points: NDArray[np.int64]
    steps: NDArray[np.int64]

    @property
    def n_states(self) -> int:
        """Length of x."""
        return int(self.step.size1_in(0))

    @property
    def n_parameters(self) -> int:
        """Length of p."""
        return int(self.step.size1_in(2))


@dataclass(frozen=True, slots=True)
class StageData:
    """Numbers of a problem for one stage.

    Attributes
    ----------
    parameter : (n_parameters,) array
    goal, weight : (n_outputs,) arrays
        Targets of the outputs, and the weights of half their squared distances.
    low, high : (n_outputs,) arrays
        Dead-bands of the outputs.
    move_weight : (2,) array
        Weights of half the squared inputs.
    input_low, input_high : (2,) arrays
        Bounds of force and speed at the end of the stage, in the states' units.
    """

    parameter: Vector
    goal: Vector
    weight: Vector
    low: Vector
    high: Vector
    move_weight: Vector
    input_low: Vector
    input_high: Vector


class Stages:
    """Functions of all stages of a horizon, and the numbers that a problem gives them."""

    def __init__(self, library: Library, parameters: ModelParameters) -> None:
        self._p, self._h, self._tuning = parameters, library.horizon, library.state.tuning
        self._largest = np.outer(self._h.block_reach, largest_moves(self._tuning))
        self._responses: dict[tuple[float, float], ca.DM] = {}
        horizon = self._h
        self._ends_s = np.cumsum(horizon.step_length_s)
        self._sent_s = self._ends_s - parameters.dead_time_s  #: when the power left that arrives
        blocks = horizon.interval_block[horizon.step_interval]
        self.stages = [
            self._stage(np.flatnonzero(blocks == block)) for block in range(horizon.n_blocks)
        ]

    def start(self, problem: Any) -> Vector:
        """State of the first stage, scaled."""
        s = problem.start
        x = np.array([s.x[0], s.x[1], 0.0, 0.0, s.x[4], s.force_kn, s.speed_rpm])
        return x / _SIZES

    def data(self, problem: Any) -> list[StageData]:
        """Numbers of a problem for every stage."""
        h, tuning, s, n = self._h, self._tuning, problem.start, self._h.n_out
        shared = [s.x[State.FORCE], s.x[State.SCALE], s.speed_offset_rpm, s.x[State.DEPTH_GAIN]]
        heat = s.x[State.HEAT] + np.array(list(s.heat_ahead_kw[0 : len(self._ends_s)]))
        known = self._known_tool @ [s.x[2], s.x[3], *s.history[0 : 3 * h.n_history], *heat]
        shown = (
            s.x[State.DEPTH_OFFSET],
            self._p.operating_temperature_c + s.x[State.TEMP_OFFSET],
        )
        off = [np.array(list(s.drift[q][0:n])) + shown[q] for q in (0, 1)]
        bands = [
            [np.array(list(side[q][0:n])) - off[q] for q in (0, 1)]
            for side in (problem.low, problem.high)
        ]
        now = np.array([s.force_kn, s.speed_rpm])
        input_low, input_high = (
            (side.reshape(-1, 2) + now) / [_SIZES[i] for i in INPUTS]
            for side in input_bounds(problem, tuning, h)
        )
        length = h.block_sizes[:, None] / h.block_reach[:, None]
        move_weight = length * self._largest**2 * move_squares(tuning)

        def of(stage: Stage, pair: Any) -> Vector:
            return np.concatenate([pair[0][stage.depth_points], pair[1][stage.tool_points]])

        middle = [0.5 * (below + above) for below, above in zip(*bands, strict=True)]
        weight = [np.full(n, square) for square in squares(tuning)]
        return [
            StageData(
                parameter=np.concatenate([shared, known[[stage.steps[0], *(stage.steps + 1)]]]),
                goal=of(stage, middle),
                weight=of(stage, weight),
                low=of(stage, bands[0]),
                high=of(stage, bands[1]),
                move_weight=move_weight[block],
                input_low=input_low[block],
                input_high=input_high[block],
            )
            for block, stage in enumerate(self.stages)
        ]

    def inputs(self, moves: Vector) -> Vector:
        """Moves (2 n_blocks,) as inputs of the stages, shape (n_blocks, 2)."""
        return moves.reshape(-1, 2) / self._largest

    def moves(self, inputs: Vector) -> Vector:
        """Inputs of the stages (n_blocks, 2) as moves (2 n_blocks,)."""
        return (inputs * self._largest).ravel()

    def rolled_out(self, start: Vector, inputs: Vector, data: list[StageData]) -> list[Vector]:
        """States of all stages and the last one, that follow from inputs (n_blocks, 2)."""
        states = [start]
        for stage, u, of_stage in zip(self.stages, inputs, data, strict=True):
            states.append(stage.step(states[-1], u, of_stage.parameter).full().ravel())
        return states

    @cached_property
    def _known_tool(self) -> Vector:
        """Tool at the start and at the ends of all steps, by copper, tool, past power and heat, if no power came from now on."""
        h, steps = self._h, len(self._ends_s)
        copper, tool = np.eye(2, 2 + 3 * h.n_history + steps)
        rows = [tool]
        for k in range(steps):
            cc, tc, tt, heat_copper, heat_tool = h.modes[k, 5:]
            copper, tool = cc * copper, tc * copper + tt * tool
            copper[2 + 3 * h.n_history + k] += heat_copper
            tool[2 + 3 * h.n_history + k] += heat_tool
            for e in range(h.weight_start[k], h.weight_start[k + 1]):
                if (segment := h.weight_segment[e]) < h.n_history:
                    place = slice(2 + 3 * segment, 5 + 3 * segment)
                    copper[place] += h.weight[e, :3]
                    tool[place] += h.weight[e, 3:]
            rows.append(tool)
        return np.array(rows)

    def _sent_in(self, step: int) -> NDArray[np.int64]:
        """Steps at whose end arrives what is sent within ``step``."""
        end_s = self._ends_s[step]
        begin_s = end_s - self._h.step_length_s[step]
        sent = (self._sent_s > begin_s + _SOON_S) & (self._sent_s <= end_s + _SOON_S)
        return np.flatnonzero(sent)

    def _warmed(
        self, copper: ca.SX, tool: ca.SX, power: ca.SX, length_s: float, span_s: float
    ) -> ca.SX:
        """Copper and tool after ``span_s`` of a step with this power."""
        key = round(length_s, 9), round(span_s, 9)
        if key not in self._responses:
            kept = matrix_exponential(thermal_block(self._p)[0] * span_s)
            response = power_response(self._p, length_s, 0.0, span_s)[:, [0, 1, 3]]
            self._responses[key] = ca.DM(np.hstack([kept, response]))
        return self._responses[key] @ ca.vertcat(copper, tool, power)

    def _waiting(self, step: int) -> list[int]:
        """Steps whose tool temperature is computed before ``step`` begins, and still needed."""
        begin_s = self._ends_s[step] - self._h.step_length_s[step]
        sent = (self._sent_s > _SOON_S) & (self._sent_s <= begin_s + _SOON_S)
        return [int(k) for k in np.flatnonzero(sent) if k >= step - 1]

    def _stage(self, steps: NDArray[np.int64]) -> Stage:
        """The functions of a block, from the equations of ``nmpc_prediction``."""
        p, h = self._p, self._h
        first, last = int(steps[0]), int(steps[-1])
        here = self._waiting(first)
        sizes = ca.DM([*_SIZES, *[_SIZES[_TOOL]] * len(here)])
        x, u = ca.SX.sym("x", sizes.size1()), ca.SX.sym("u", 2)
        parameter = ca.SX.sym("p", _N_SHARED + len(steps) + 1)
        values = ca.vertsplit(x * sizes)
        creep, slow, copper, tool, motor, force, speed = values[: len(_SIZES)]
        arrived = dict(zip(here, values[len(_SIZES) :], strict=True))
        force_offset, scale, speed_offset, gain = ca.vertsplit(parameter[:_N_SHARED])
        known = parameter[_N_SHARED:]
        poles, gains = depth_modes(p)
        fast_gain = -gain * gains[2] / poles[2]
        moves = u * ca.DM(self._largest[h.interval_block[h.step_interval[first]]])
        depths, tools, depth_points, tool_points = [], [], [], []
        interval = -1
        for i, k in enumerate(map(int, steps)):
            if h.step_interval[k] != interval:
                interval = int(h.step_interval[k])
                force, speed = force + moves[0], speed + moves[1]
            creep_gain, decay, slow_gain, motor_decay, lag = h.modes[k, :5].tolist()
            acting = force + force_offset
            pushed = acting - p.operating_force_kn
            settled = p.operating_depth_mm + fast_gain * pushed
            tool_c = [known[i + end] + arrived.get(k - 1 + end, 0.0) for end in (0, 1)]
            depth = (settled + creep + slow) * (1.0 + p.softening_per_c * tool_c[0])
            left = scale * process_torque_nm(p, acting, depth)
            creep, slow = (
                creep + gain * creep_gain * pushed,
                decay * slow + gain * slow_gain * pushed,
            )
            depth = (settled + creep + slow) * (1.0 + p.softening_per_c * tool_c[1])
            rise = scale * process_torque_nm(p, acting, depth) - left
            begin = left - lag * rise
            turning = speed + speed_offset
            friction = friction_torque_nm(p, turning)
            rest = motor - friction - begin
            power = power_kw(ca.vertcat(begin, rise, rest), turning)
            power[0] -= p.operating_power_kw
            motor = begin + rise + friction + motor_decay * rest
            begin_s, length_s = self._ends_s[k] - h.step_length_s[k], float(h.step_length_s[k])
            for later in self._sent_in(k):
                arrived[later] = self._warmed(
                    copper, tool, power, length_s, self._sent_s[later] - begin_s
                )[1]
            copper, tool = ca.vertsplit(self._warmed(copper, tool, power, length_s, length_s))
            if h.out_step[interval] == k:
                depths.append(depth)
                depth_points.append(interval)
                if h.temperature_width[interval] > 0:
                    tools.append(tool_c[1])
                    tool_points.append(interval)
        if last + 1 == len(self._ends_s):
            after = ca.vertcat(force, speed) / ca.DM([_SIZES[i] for i in INPUTS])
        else:
            waiting = [arrived[k] for k in self._waiting(last + 1)]
            after = ca.vertcat(creep, slow, copper, tool, motor, force, speed, *waiting)
            after /= ca.DM([*_SIZES, *[_SIZES[_TOOL]] * len(waiting)])
        arguments = [x, u, parameter]
        return Stage(
            ca.Function("step", arguments, [after]),
            ca.Function("outputs", arguments, [ca.vertcat(*depths, *tools)]),
            np.array(depth_points, dtype=np.int64),
            np.array(tool_points, dtype=np.int64),
            steps,
        )
