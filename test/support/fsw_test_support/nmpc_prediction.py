"""The prediction as a CasADi expression, from the same tables and equations as the C kernel."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from fsw_model import ModelParameters
from fsw_model.equations import depth_modes, friction_torque_nm, power_kw, process_torque_nm
from fsw_nmpc.horizon import Horizon
from fsw_nmpc.library import State, Vector

#: Length of the vector that holds everything a prediction starts from, apart from the drifts and
#: the power history.
N_START = 14


def n_start(horizon: Horizon) -> int:
    """Length of the ``start`` of :func:`prediction_function`."""
    return N_START + 2 * horizon.n_out


def start_vector(start: Any, horizon: Horizon) -> Vector:
    """The ``start`` of :func:`prediction_function`, shape (n_start(horizon),)."""
    s = start
    x, estimated = list(s.x), (State.FORCE, State.HEAT, State.SCALE)
    offsets = [x[i] for i in (*estimated, State.DEPTH_OFFSET, State.TEMP_OFFSET)]
    offsets += [s.speed_offset_rpm, x[State.DEPTH_GAIN]]
    drifts = [float(s.drift[q][i]) for q in range(2) for i in range(horizon.n_out)]
    return np.array([*x[:5], s.force_kn, s.speed_rpm, *offsets, *drifts])


def prediction_function(parameters: ModelParameters, horizon: Horizon) -> ca.Function:
    """CasADi function (moves, start (n_start,), history (3 n_history,)) -> (depth (n_out,), temperature (n_out,)).

    ``start`` holds the state (5), the applied force and speed, the offsets of force and heat, the
    torque scale, the offsets of depth, temperature and speed, the factor on the gain of the depth,
    and how far the offsets of depth and temperature drift until each output point;
    ``history`` the power's coefficients, oldest first.
    """
    p = parameters
    moves = ca.SX.sym("moves", 2 * horizon.n_blocks)
    start = ca.SX.sym("start", n_start(horizon))
    history = ca.SX.sym("history_kw", 3 * horizon.n_history)
    creep, slow, copper, tool, motor = ca.vertsplit(start[:5])
    force, speed = start[5], start[6]
    force_offset, heat_offset, scale, depth_offset, temperature_offset, *others = ca.vertsplit(
        start[7:N_START]
    )
    speed_offset, depth_gain = others
    depth_drift, temperature_drift = ca.vertsplit(start[N_START:], horizon.n_out)
    segments = [history[3 * j : 3 * j + 3] for j in range(horizon.n_history)]
    poles, gains = depth_modes(p)
    fast_gain = -depth_gain * gains[2] / poles[2]

    depths: list[ca.SX] = []
    temperatures: list[ca.SX] = []
    interval = -1
    for k in range(len(horizon.step_length_s)):
        if horizon.step_interval[k] != interval:
            interval = int(horizon.step_interval[k])
            block = int(horizon.interval_block[interval])
            force, speed = force + moves[2 * block], speed + moves[2 * block + 1]
        creep_gain, decay, gain, motor_decay, lag, cc, tc, tt, heat_copper, heat_tool = (
            horizon.modes[k].tolist()
        )
        acting = force + force_offset
        pushed = acting - p.operating_force_kn
        settled = p.operating_depth_mm + fast_gain * pushed
        depth = (settled + creep + slow) * (1.0 + p.softening_per_c * tool)
        left = scale * process_torque_nm(p, acting, depth)
        creep, slow = (
            creep + depth_gain * creep_gain * pushed,
            decay * slow + depth_gain * gain * pushed,
        )
        copper, tool = (
            cc * copper + heat_copper * heat_offset,
            tc * copper + tt * tool + heat_tool * heat_offset,
        )
        for e in range(horizon.weight_start[k], horizon.weight_start[k + 1]):
            arriving = ca.DM(horizon.weight[e].reshape(2, 3)) @ segments[horizon.weight_segment[e]]
            copper, tool = copper + arriving[0], tool + arriving[1]
        depth = (settled + creep + slow) * (1.0 + p.softening_per_c * tool)
        rise = scale * process_torque_nm(p, acting, depth) - left
        begin = left - lag * rise
        turning = speed + speed_offset
        friction = friction_torque_nm(p, turning)
        rest = motor - friction - begin
        segments.append(
            power_kw(ca.vertcat(begin, rise, rest), turning)
            - ca.DM([p.operating_power_kw, 0.0, 0.0])
        )
        motor = begin + rise + friction + motor_decay * rest
        if horizon.out_step[interval] == k:
            depths.append(depth + depth_offset + depth_drift[len(depths)])
            shown = p.operating_temperature_c + tool + temperature_offset
            temperatures.append(shown + temperature_drift[len(temperatures)])
    return ca.Function(
        "prediction",
        [moves, start, history],
        [ca.vertcat(*depths), ca.vertcat(*temperatures)],
        ["moves", "start", "history_kw"],
        ["depth_mm", "temperature_c"],
    )
