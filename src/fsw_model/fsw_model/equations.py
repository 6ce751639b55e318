"""The process of the paper, equations (16)-(27), written once in CasADi.

Everything else is derived from here: the numeric step, the linearisation, the controller's
prediction, generated C. ``p`` is a :class:`~fsw_model.parameters.ModelParameters`; units are mm,
kN, rpm, degC, kW, N m, s, but SI inside (19)-(22). A state ``x`` has six entries, in the order of
``STATE_NAMES``: the three modes of (17), the two lags of (16), which the authors interpret as
copper and tool in series, and the motor torque of (18). The dead time of (16) is handled
separately, as the power of the steps that it spans.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, exp, pi
from types import SimpleNamespace
from typing import Any, cast

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from fsw_model.parameters import ModelParameters, nominal

#: Length of a step, paper (36).
STEP_S = 0.1
STATE_NAMES = ("creep_mm", "slow_mm", "fast_mm", "copper_c", "tool_c", "motor_torque_nm")
CREEP, SLOW, FAST, COPPER, TOOL, MOTOR = range(6)
N_STATES = len(STATE_NAMES)
#: power within a step: p0 + p1 (s/h) + p2 (s/h)^2 + p3 exp(-s / motor lag), s = 0 ... h
N_POWER = 4
#: the parabola of ``step_function`` needs the solution in the middle and at the end of a step
_SPANS_S = {"half": 0.5 * STEP_S, "whole": STEP_S}

Matrix = NDArray[np.float64]


def depth_mm(p: ModelParameters, creep: ca.SX, slow: ca.SX, fast: ca.SX, tool: ca.SX) -> ca.SX:
    """Shoulder depth z_SD (27) from the modes of (17) (Delta l) and the tool temperature (16)."""
    return (creep + slow + fast + p.operating_depth_mm) * (1.0 + p.softening_per_c * tool)


def process_torque_nm(p: ModelParameters, force_kn: ca.SX, depth: ca.SX) -> ca.SX:
    """Spindle torque M_sp exerted by the tool on the copper, (19)-(22)."""
    depth_m = 1e-3 * depth
    radius_m = p.contact_radius_m + p.contact_slope * depth_m
    area_m2 = pi * radius_m**2  # (21)
    geometry_m3 = p.geometry_offset_m3 + p.geometry_factor * (
        radius_m**3 - p.contact_radius_m**3
    )  # (22)
    sigma_pa = 1e3 * force_kn / area_m2  # (20)
    return (p.sticking_stress_pa + p.sliding_friction * sigma_pa) * geometry_m3  # (19)


def friction_torque_nm(p: ModelParameters, speed_rpm: ca.SX) -> ca.SX:
    """Friction torque M_f of motor and transmission, measured in air, (8) = (23)."""
    return (
        p.friction_constant_nm
        + p.friction_linear_nm_per_rpm * speed_rpm
        + p.friction_quadratic_nm_per_rpm2 * speed_rpm**2
    )


def power_kw(torque_nm: Any, speed_rpm: Any) -> Any:
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


def matrix_exponential(m: Matrix) -> Matrix:
    """Matrix exponential, by scipy (scaling and squaring with Pade approximants)."""
    from scipy.linalg import expm  # heavy to import, needed once per model

    return np.asarray(expm(m), dtype=np.float64)


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
    for name, span_s in _SPANS_S.items():
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
        for name, span_s in _SPANS_S.items()
        for part, matrix in zip(
            ("kept", "older", "newer"), thermal_step(p, overlap_s, span_s), strict=True
        )
    }


def output_function(p: ModelParameters) -> ca.Function:
    """CasADi function (x, force_kn, speed_rpm) -> outputs of the process."""
    return _outputs(p)


def _outputs(p: ModelParameters, *more: ca.SX) -> ca.Function:
    x = ca.SX.sym("x", N_STATES)
    force, speed = ca.SX.sym("force_kn"), ca.SX.sym("speed_rpm")
    depth = depth_mm(p, x[CREEP], x[SLOW], x[FAST], x[TOOL])
    friction = friction_torque_nm(p, speed)
    outputs = {
        "depth_mm": depth,
        "temperature_c": p.operating_temperature_c + x[TOOL],  # (26)
        "copper_temperature_c": p.operating_temperature_c + x[COPPER],
        "motor_torque_nm": x[MOTOR],
        "process_torque_nm": process_torque_nm(p, force, depth),
        "friction_torque_nm": friction,
        "power_kw": power_kw(x[MOTOR] - friction, speed),
    }
    names = ["x", "force_kn", "speed_rpm", *(["numbers"] * len(more))]
    return ca.Function(
        "process_outputs", [x, force, speed, *more], list(outputs.values()), names, list(outputs)
    )


def dynamics_function(p: ModelParameters) -> ca.Function:
    """CasADi function (x, arriving_kw, force_kn, speed_rpm) -> dx/dt; the power is delayed."""
    x = ca.SX.sym("x", N_STATES)
    arriving, force, speed = (
        ca.SX.sym("arriving_kw"),
        ca.SX.sym("force_kn"),
        ca.SX.sym("speed_rpm"),
    )
    poles, gains = depth_modes(p)
    a, b = thermal_block(p)
    depth = depth_mm(p, x[CREEP], x[SLOW], x[FAST], x[TOOL])
    modes = ca.DM(poles) * x[:3] + ca.DM(gains) * (force - p.operating_force_kn)  # (17), (25)
    thermal = ca.DM(a) @ x[COPPER : TOOL + 1] + ca.DM(b) * arriving  # (16)
    static = process_torque_nm(p, force, depth) + friction_torque_nm(p, speed)
    motor = (static - x[MOTOR]) / p.motor_lag_s  # (18)
    names = ["x", "arriving_kw", "force_kn", "speed_rpm"]
    return ca.Function(
        "dynamics",
        [x, arriving, force, speed],
        [ca.vertcat(modes, thermal, motor)],
        names,
        ["dx_dt"],
    )


def step_function(p: ModelParameters) -> ca.Function:
    """CasADi function (x, older power (4), newer power (4), force, speed) -> next step.

    The results are (x next, power (4), depth). ``older`` and ``newer`` are the powers of the two
    past steps that arrive during this one (``thermal_step``); the returned power goes to the end
    of that queue. The dead time is at least a step, so the temperature within the step is known
    beforehand, and the step is explicit. The linear blocks are exact. In (18) only the process
    torque is approximated, by the parabola through its values at start, middle and end; the depth
    jump that settles with the fast pole is separated from it and passed through (18) exactly, to
    first order in the jump.
    """
    matrices = {name: ca.sparsify(ca.DM(m)) for name, m in thermal_numbers(p).items()}
    numbers = mode_numbers(p) | matrices
    x = ca.SX.sym("x", N_STATES)
    older, newer = ca.SX.sym("older_kw", N_POWER), ca.SX.sym("newer_kw", N_POWER)
    force, speed = ca.SX.sym("force_kn"), ca.SX.sym("speed_rpm")
    warm = _warmed(numbers, x, older, newer)
    x_next, power, depth = _stepped(p, numbers, x, warm, force, speed)
    names = ["x", "older_kw", "newer_kw", "force_kn", "speed_rpm"]
    return ca.Function(
        "process_step",
        [x, older, newer, force, speed],
        [x_next, power, depth],
        names,
        ["x_next", "power_kw", "depth_mm"],
    )


def _warmed(numbers: Mapping[str, Any], x: ca.SX, older: ca.SX, newer: ca.SX) -> ca.SX:
    """Tool in the middle of a step, copper and tool at its end, by (16)."""

    def later(name: str) -> ca.SX:
        kept = numbers[f"kept_{name}"] @ ca.vertcat(x[COPPER], x[TOOL])
        return kept + numbers[f"older_{name}"] @ older + numbers[f"newer_{name}"] @ newer

    return ca.vertcat(later("half")[1], later("whole"))


def numbers_of(p: ModelParameters) -> Matrix:
    """The parameters' values for :func:`general_functions`, as a vector."""
    parts = [p.model_dump().values(), mode_numbers(p).values()]
    flat = [number for part in parts for number in part]
    return np.concatenate([flat, *(m.ravel() for m in thermal_numbers(p).values())])


def general_functions() -> tuple[ca.Function, ...]:
    """Temperatures after a step, by two models; the step; outputs.

    The last argument of each is :func:`numbers_of`. The temperatures are (tool in the middle,
    copper and tool at the end): by (16), from the powers of two past steps, or by the tool's lag
    alone, from another model's copper at start and end as the tool meets it. That includes the
    dead time and is linear within the step, which the lag follows exactly; the copper in ``x`` is
    not changed. The step also gives its mean power.
    """
    p = nominal()
    vector = ca.SX.sym("numbers", len(numbers_of(p)))
    entries = iter(ca.vertsplit(vector))
    fields = cast(
        ModelParameters, SimpleNamespace(**dict(zip(p.model_dump(), entries, strict=False)))
    )
    numbers: dict[str, Any] = dict(zip(mode_numbers(p), entries, strict=False))
    for name, matrix in thermal_numbers(p).items():
        rows, columns = matrix.shape
        numbers[name] = ca.vertcat(
            *(ca.horzcat(*(next(entries) for _ in range(columns))) for _ in range(rows))
        )
    x, warm = ca.SX.sym("x", N_STATES), ca.SX.sym("warm_c", 3)
    past, copper = [ca.SX.sym(name, N_POWER) for name in ("older", "newer")], ca.SX.sym("met_c", 2)
    inputs = [ca.SX.sym("force_kn"), ca.SX.sym("speed_rpm")]
    rate, lag = (copper[1] - copper[0]) / STEP_S, fields.tool_lag_s
    behind = x[TOOL] - copper[0] + rate * lag
    middle, end = (
        copper[0] + rate * (span_s - lag) + behind * ca.exp(-span_s / lag)
        for span_s in _SPANS_S.values()
    )
    x_next, power, depth = _stepped(fields, numbers, x, warm, *inputs)
    faded = fields.motor_lag_s / STEP_S * (1.0 - numbers["motor_kept"])
    mean = (
        fields.operating_power_kw + power[0] + power[1] / 2.0 + power[2] / 3.0 + power[3] * faded
    )
    parts: dict[str, tuple[list[ca.SX], list[ca.SX]]] = {
        "process_heat": ([x, *past], [_warmed(numbers, x, *past)]),
        "process_met": ([x, copper], [ca.vertcat(middle, x[COPPER], end)]),
        "process_step": ([x, warm, *inputs], [x_next, power, depth, mean]),
    }
    made = (ca.Function(name, [*ins, vector], ca.cse(outs)) for name, (ins, outs) in parts.items())
    return (*made, _outputs(fields, vector))


def _stepped(
    p: ModelParameters,
    numbers: Mapping[str, Any],
    x: ca.SX,
    warm: ca.SX,
    force: ca.SX,
    speed: ca.SX,
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """State and depth after a step, and power in it.

    ``numbers`` are :func:`mode_numbers`; ``warm`` is the tool in the middle, then copper and tool
    at the end.
    """
    creep, slow, fast, _, tool, motor = ca.vertsplit(x)
    pushed = force - p.operating_force_kn  # (25)
    settled = numbers["settled_mm_per_kn"] * pushed  # steady state of the fast mode

    def later(name: str, tool_then: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Modes creep and slow, and the depth after the fast mode has settled."""
        slow_then = numbers[f"slow_kept_{name}"] * slow + numbers[f"slow_{name}"] * pushed
        creep_then = creep + numbers[f"creep_{name}"] * pushed
        return creep_then, slow_then, depth_mm(p, creep_then, slow_then, settled, tool_then)

    *_, depth_middle = later("half", warm[0])
    creep_end, slow_end, depth_end = later("whole", warm[2])
    depth_start = depth_mm(p, creep, slow, settled, tool)
    start, middle, end = (
        process_torque_nm(p, force, d) for d in (depth_start, depth_middle, depth_end)
    )
    friction = friction_torque_nm(p, speed)

    # (18): motor torque = q0 + q1 (s/h) + q2 (s/h)^2 + rest exp(-s / lag)
    lag = numbers["motor_lag_steps"]
    q2 = 2.0 * start - 4.0 * middle + 2.0 * end
    q1 = -3.0 * start + 4.0 * middle - end - 2.0 * lag * q2
    q0 = start + friction - lag * q1
    depth_symbol = ca.SX.sym("depth")
    by_depth = ca.substitute(
        ca.gradient(process_torque_nm(p, force, depth_symbol), depth_symbol),
        depth_symbol,
        depth_start,
    )
    jump = by_depth * (1.0 + p.softening_per_c * tool) * (fast - settled)
    rest = motor - q0 + jump / numbers["jump_ratio"]
    motor_end = q0 + q1 + q2 + rest * numbers["motor_kept"]
    fast_end = settled + (fast - settled) * numbers["fast_kept"]
    power = power_kw(ca.vertcat(q0 - friction, q1, q2, rest), speed)
    power[0] -= p.operating_power_kw  # (24)
    return (
        ca.vertcat(creep_end, slow_end, fast_end, warm[1:], motor_end),
        power,
        depth_end,
    )
