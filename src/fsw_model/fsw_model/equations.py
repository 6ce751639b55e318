"""The process of the paper, equations (16)-(27), written once, for numbers and CasADi symbols.

Everything else is derived from here and in :mod:`fsw_model.functions`: the numeric step, the
linearisation, the controller's prediction, generated C. ``p`` is a
:class:`~fsw_model.parameters.ModelParameters`; units are mm, kN, rpm, degC, kW, N m, s, but SI
inside (19)-(22). A state ``x`` has six entries, in the order of
``STATE_NAMES``: the three modes of (17), the two lags of (16), which the authors interpret as
copper and tool in series, and the motor torque of (18). The dead time of (16) is handled
separately, as the power of the steps that it spans.
"""

from __future__ import annotations

from math import ceil, exp, log2, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fsw_model.parameters import ModelParameters

#: Length of a step, paper (36).
STEP_S = 0.1
STATE_NAMES = ("creep_mm", "slow_mm", "fast_mm", "copper_c", "tool_c", "motor_torque_nm")
CREEP, SLOW, FAST, COPPER, TOOL, MOTOR = range(6)
N_STATES = len(STATE_NAMES)
#: power within a step: p0 + p1 (s/h) + p2 (s/h)^2 + p3 exp(-s / motor lag), s = 0 ... h
N_POWER = 4
#: terms of the exponential series: of a norm of at most 1/2 the next is below 1e-22
_SERIES = 18
#: the parabola of ``functions.step_function`` needs the solution in the middle and at the end of a
#: step
SPANS_S = {"half": 0.5 * STEP_S, "whole": STEP_S}

Matrix = NDArray[np.float64]
Value = Any  #: number, array or CasADi symbol


def depth_mm(p: ModelParameters, creep: Value, slow: Value, fast: Value, tool: Value) -> Value:
    """Shoulder depth z_SD (27) from the modes of (17) (Delta l) and the tool temperature (16)."""
    return (creep + slow + fast + p.operating_depth_mm) * (1.0 + p.softening_per_c * tool)


def process_torque_nm(p: ModelParameters, force_kn: Value, depth: Value) -> Value:
    """Spindle torque M_sp exerted by the tool on the copper, (19)-(22)."""
    depth_m = 1e-3 * depth
    radius_m = p.contact_radius_m + p.contact_slope * depth_m
    area_m2 = pi * radius_m**2  # (21)
    geometry_m3 = p.geometry_offset_m3 + p.geometry_factor * (
        radius_m**3 - p.contact_radius_m**3
    )  # (22)
    sigma_pa = 1e3 * force_kn / area_m2  # (20)
    return (p.sticking_stress_pa + p.sliding_friction * sigma_pa) * geometry_m3  # (19)


def friction_torque_nm(p: ModelParameters, speed_rpm: Value) -> Value:
    """Friction torque M_f of motor and transmission, measured in air, (8) = (23)."""
    return (
        p.friction_constant_nm
        + p.friction_linear_nm_per_rpm * speed_rpm
        + p.friction_quadratic_nm_per_rpm2 * speed_rpm**2
    )


def power_kw(torque_nm: Value, speed_rpm: Value) -> Value:
    """Power P (24) of a torque (motor less friction), for symbols, numbers or arrays."""
    return torque_nm * speed_rpm * (pi / 30000.0)


def depth_modes(p: ModelParameters) -> tuple[Matrix, Matrix]:
    """Partial fractions of (17): ``dx/dt = poles x + gains Delta F``, Delta l is the sum of x.

    Returns
    -------
    poles, gains : (3,) arrays
        In 1/s and mm/(kN s), in the order creep, slow, fast.
    """
    slow, fast = p.depth_pole_slow_s, p.depth_pole_fast_s
    gain_slow = p.depth_gain_mm_per_kn_s * (p.depth_zero_s - slow) / (slow - fast)
    gain_fast = p.depth_gain_mm_per_kn_s * (p.depth_zero_s - fast) / (fast - slow)
    return np.array([0.0, -1.0 / slow, -1.0 / fast]), np.array(
        [p.depth_gain_mm_per_kn_s, gain_slow, gain_fast]
    )


def thermal_block(p: ModelParameters) -> tuple[Matrix, Matrix]:
    """Lags of (16) in series, ``dx/dt = a x + b Delta P(t - dead time)``, x = (copper, tool).

    Returns
    -------
    a : (2, 2) array
    b : (2,) array
    """
    a = np.array([[-1.0 / p.copper_lag_s, 0.0], [1.0 / p.tool_lag_s, -1.0 / p.tool_lag_s]])
    return a, np.array([p.thermal_gain_c_per_kw / p.copper_lag_s, 0.0])


def outputs(p: ModelParameters, x: Value, force_kn: Value, speed_rpm: Value) -> dict[str, Value]:
    """Outputs of the process by name, in a state and under its inputs."""
    depth = depth_mm(p, x[CREEP], x[SLOW], x[FAST], x[TOOL])
    friction = friction_torque_nm(p, speed_rpm)
    return {
        "depth_mm": depth,
        "temperature_c": p.operating_temperature_c + x[TOOL],  # (26)
        "copper_temperature_c": p.operating_temperature_c + x[COPPER],
        "motor_torque_nm": x[MOTOR],
        "process_torque_nm": process_torque_nm(p, force_kn, depth),
        "friction_torque_nm": friction,
        "power_kw": power_kw(x[MOTOR] - friction, speed_rpm),
    }


def matrix_exponential(m: Matrix) -> Matrix:
    """Matrix exponential of a small matrix, by scaling and squaring of its power series.

    Without SciPy, whose import takes longer than everything else before a weld.
    """
    squarings = max(0, ceil(log2(max(1e-9, float(np.abs(m).sum(axis=0).max())))) + 1)
    term = total = np.eye(len(m))
    for power in range(1, _SERIES):
        term = term @ m / (power * 2.0**squarings)
        total = total + term
    for _ in range(squarings):
        total = total @ total
    return total


def power_response(p: ModelParameters, step_s: float, begin_s: float, span_s: float) -> Matrix:
    """Response of (copper, tool) from rest to the part [begin, begin + span] of a step's power.

    Exact for the four functions that make up the power within a step (``N_POWER``): the state is
    extended by them, so that a single matrix exponential gives all integrals (Van Loan 1978).

    Returns
    -------
    (2, 4) array
    """
    a, b = thermal_block(p)
    u = begin_s / step_s
    start = np.array([1.0, u, u * u, exp(-begin_s / p.motor_lag_s)])
    m = np.zeros((2 + N_POWER, 2 + N_POWER))
    m[:2, :2] = a
    m[3, 2], m[4, 3], m[5, 5] = 1.0 / step_s, 2.0 / step_s, -1.0 / p.motor_lag_s
    response = np.empty((2, N_POWER))
    for i in range(N_POWER):
        m[:2, 2:] = 0.0
        m[:2, 2 + i] = b
        response[:, i] = matrix_exponential(m * span_s)[:2, 2:] @ start
    return response


def thermal_step(
    p: ModelParameters, overlap_s: float, span_s: float
) -> tuple[Matrix, Matrix, Matrix]:
    """Exact step of (copper, tool) over ``span_s``, at most one step.

    If the dead time is not a whole number of steps, the power that arrives meanwhile comes from
    two past steps.

    Parameters
    ----------
    p : ModelParameters
    overlap_s : float
        How long power of the older of the two steps still arrives; the whole step if the dead
        time is a whole number of steps.
    span_s : float

    Returns
    -------
    phi : (2, 2), older : (2, 4), newer : (2, 4) arrays
    """
    a, _ = thermal_block(p)
    phi = matrix_exponential(a * span_s)
    rest_s = span_s - overlap_s
    if rest_s < 1e-9:
        return phi, power_response(p, STEP_S, STEP_S - overlap_s, span_s), np.zeros((2, N_POWER))
    older = matrix_exponential(a * rest_s) @ power_response(
        p, STEP_S, STEP_S - overlap_s, overlap_s
    )
    return phi, older, power_response(p, STEP_S, 0.0, rest_s)


def delay_steps(p: ModelParameters) -> int:
    """Number of steps that the dead time spans, rounded up."""
    return ceil(p.dead_time_s / STEP_S - 1e-9)


def mode_numbers(p: ModelParameters) -> dict[str, float]:
    """Coefficients of a step by name: exact solutions of (17) and (18) over half and whole."""
    poles, gains = depth_modes(p)
    lag = p.motor_lag_s
    numbers = {
        "settled_mm_per_kn": -gains[2] / poles[2],
        "fast_kept": exp(poles[2] * STEP_S),
        "motor_kept": exp(-STEP_S / lag),
        "motor_lag_steps": lag / STEP_S,
        "jump_ratio": lag / p.depth_pole_fast_s - 1.0,
    }
    for name, span_s in SPANS_S.items():
        kept = exp(poles[1] * span_s)
        numbers |= {
            f"creep_{name}": gains[0] * span_s,
            f"slow_kept_{name}": kept,
            f"slow_{name}": (kept - 1.0) / poles[1] * gains[1],
        }
    return numbers


def thermal_numbers(p: ModelParameters) -> dict[str, Matrix]:
    """Coefficients of (16) with its dead time: ``thermal_step`` over half and whole step."""
    overlap_s = STEP_S - (delay_steps(p) * STEP_S - p.dead_time_s)
    return {
        f"{part}_{name}": matrix
        for name, span_s in SPANS_S.items()
        for part, matrix in zip(
            ("kept", "older", "newer"), thermal_step(p, overlap_s, span_s), strict=True
        )
    }


def numbers_of(p: ModelParameters) -> Matrix:
    """The parameters' values for :func:`general_functions`, as a vector."""
    parts = [p.model_dump().values(), mode_numbers(p).values()]
    flat = [number for part in parts for number in part]
    return np.concatenate([flat, *(m.ravel() for m in thermal_numbers(p).values())])
