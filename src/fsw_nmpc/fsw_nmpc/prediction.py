"""The prediction as a CasADi expression, from the same tables and equations as the C kernel."""

from __future__ import annotations

import casadi as ca

from fsw_model import ModelParameters
from fsw_model.equations import process_power_kw, process_torque_nm
from fsw_nmpc.horizon import Horizon

#: Length of the vector that holds everything a prediction starts from, apart from the power history.
N_START = 11


def prediction_function(parameters: ModelParameters, horizon: Horizon) -> ca.Function:
    """CasADi function (moves, start (11,), history (2 n_history,)) -> (depth (n_out,), temperature (n_out,)).

    ``start`` holds the state (5), the applied force and speed, the force offset, the torque scale and the offsets of
    depth and temperature; ``history`` the power's left and right values, oldest first.
    """
    moves = ca.SX.sym("moves", 2 * horizon.n_blocks)
    start = ca.SX.sym("start", N_START)
    history = ca.SX.sym("history_kw", 2 * horizon.n_history)
    creep, slow, fast, thermal, temperature = ca.vertsplit(start[:5])
    force, speed = start[5], start[6]
    force_offset, scale, depth_offset, temperature_offset = start[7], start[8], start[9], start[10]
    segments: list[tuple[ca.SX, ca.SX]] = [(history[2 * j], history[2 * j + 1]) for j in range(horizon.n_history)]

    def contact_depth() -> ca.SX:
        return parameters.operating_depth_mm + creep + slow + fast + thermal

    def power() -> ca.SX:
        torque = process_torque_nm(parameters, force + force_offset, contact_depth())
        return process_power_kw(scale * torque, speed)

    depths: list[ca.SX] = []
    temperatures: list[ca.SX] = []
    interval = -1
    for k in range(len(horizon.step_length_s)):
        if horizon.step_interval[k] != interval:
            interval = int(horizon.step_interval[k])
            block = int(horizon.interval_block[interval])
            force, speed = force + moves[2 * block], speed + moves[2 * block + 1]
        gain, decay_slow, gain_slow, decay_fast, gain_fast, tt, tc, cc, const_t, const_c = horizon.modes[k].tolist()
        pushed = force + force_offset - parameters.operating_force_kn
        left = power()
        creep, slow = creep + gain * pushed, decay_slow * slow + gain_slow * pushed
        fast = decay_fast * fast + gain_fast * pushed
        thermal, temperature = tt * thermal + tc * temperature + const_t, cc * temperature + const_c
        for e in range(horizon.weight_start[k], horizon.weight_start[k + 1]):
            begin, end = segments[horizon.weight_segment[e]]
            w = horizon.weight[e].tolist()
            thermal, temperature = thermal + w[0] * begin + w[1] * end, temperature + w[2] * begin + w[3] * end
        segments.append((left, power()))
        if horizon.out_step[interval] == k:
            depths.append(contact_depth() + depth_offset)
            temperatures.append(temperature + temperature_offset)
    return ca.Function(
        "prediction",
        [moves, start, history],
        [ca.vertcat(*depths), ca.vertcat(*temperatures)],
        ["moves", "start", "history_kw"],
        ["depth_mm", "temperature_c"],
    )
