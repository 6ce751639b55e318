"""The process model simulated along recorded inputs, with the sensitivity of its outputs to everything unknown.

The static equations are those of :mod:`fsw_model.equations`; here their parameters are symbols. The linear blocks (16),
(17) and (18) are in modal form and exact for power and process torque that are linear within a step; the dead time is
any number of seconds from one step on.
"""

from __future__ import annotations

from functools import cache, lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from fsw_analysis.weld_signals import FloatArray
from fsw_control.units import RAD_PER_S_PER_RPM
from fsw_identification.weld_data import Segment
from fsw_model import STEP_S, ModelParameters
from fsw_model.equations import depth_mm, friction_torque_nm, power_kw, process_torque_nm

#: what may be identifiable; the rest of the model is the point of linearisation, the fast pole and the friction
CANDIDATES: tuple[str, ...] = (
    *("thermal_gain_c_per_kw", "copper_lag_s", "tool_lag_s", "dead_time_s"),
    *("depth_gain_mm_per_kn_s", "depth_zero_s", "depth_pole_slow_s", "softening_per_c", "motor_lag_s"),
    *("sliding_friction", "sticking_stress_pa", "contact_slope", "spindle_inertia_kgm2"),
)
OUTPUTS = ("depth_mm", "temperature_c", "torque_nm")
#: state at the beginning of a segment, and the power before it
START = ("creep_mm", "slow_mm", "copper_mode_kw", "tool_mode_kw", "motor_torque_nm", "power_before_kw")
N_STATES = 5
#: between two knots of a slow disturbance, which is linear in between [s]
KNOT_S = 10.0

_ALL = tuple(ModelParameters.model_fields)
_N_POWER = 2


def _ramped(x: Any, begin: Any, slope: Any, span_s: Any, lag_s: Any) -> Any:
    """First-order lag after ``span_s`` in which its input was ``begin + slope t``; exact."""
    behind = slope * lag_s
    return begin + slope * span_s - behind + (x - begin + behind) * ca.exp(-span_s / lag_s)


def _tool_c(p: Any, copper: Any, tool: Any) -> Any:
    """Delta T (16) of its two modes, each a lag of the power in kW."""
    return p.thermal_gain_c_per_kw * (p.copper_lag_s * copper - p.tool_lag_s * tool) / (p.copper_lag_s - p.tool_lag_s)


@cache
def _functions() -> tuple[ca.Function, ca.Function]:
    """Step and outputs, each with its Jacobian with respect to state, power, candidates and disturbances."""
    values = ca.SX.sym("p", len(_ALL))
    p: Any = SimpleNamespace(**dict(zip(_ALL, ca.vertsplit(values), strict=True)))
    candidates = ca.vertcat(*(getattr(p, name) for name in CANDIDATES))
    x = ca.SX.sym("x", N_STATES)
    creep, slow, copper, tool, motor = ca.vertsplit(x)
    older, newer = ca.SX.sym("older_kw", _N_POWER), ca.SX.sym("newer_kw", _N_POWER)
    force, speed, whole_s = ca.SX.sym("force_kn"), ca.SX.sym("speed_rpm"), ca.SX.sym("whole_s")
    disturbance = ca.SX.sym("disturbance", 2)  # kN and kW
    pole_s, fast_s, gain = p.depth_pole_slow_s, p.depth_pole_fast_s, p.depth_gain_mm_per_kn_s

    pushed = force - p.operating_force_kn + disturbance[0]
    slow_gain = gain * (p.depth_zero_s - pole_s) / (pole_s - fast_s) * pole_s
    fast = gain * (p.depth_zero_s - fast_s) / (fast_s - pole_s) * fast_s * pushed  # settled
    left = ca.exp(-STEP_S / pole_s)
    slow_end = left * slow + (1.0 - left) * slow_gain * pushed
    creep_end = creep + gain * STEP_S * pushed

    # power of the older step arrives first, for the part of a step by which the dead time exceeds whole steps
    part_s = p.dead_time_s - whole_s
    rest_s = STEP_S - part_s
    older_slope, newer_slope = (older[1] - older[0]) / STEP_S, (newer[1] - newer[0]) / STEP_S
    ends = []
    for mode, lag_s in ((copper, p.copper_lag_s), (tool, p.tool_lag_s)):
        mode = _ramped(mode, older[0] + older_slope * rest_s + disturbance[1], older_slope, part_s, lag_s)
        ends.append(_ramped(mode, newer[0] + disturbance[1], newer_slope, rest_s, lag_s))
    before = depth_mm(p, creep, slow, fast, _tool_c(p, copper, tool))
    after = depth_mm(p, creep_end, slow_end, fast, _tool_c(p, *ends))
    friction = friction_torque_nm(p, speed)
    static = [process_torque_nm(p, force, depth) + friction for depth in (before, after)]
    motor_end = _ramped(motor, static[0], (static[1] - static[0]) / STEP_S, STEP_S, p.motor_lag_s)
    power = [power_kw(torque - friction, speed) - p.operating_power_kw for torque in (motor, motor_end)]
    result = ca.vertcat(creep_end, slow_end, *ends, motor_end, *power)
    known = ca.vertcat(x, older, newer)
    step = ca.Function(
        "step",
        [known, disturbance, values, force, speed, whole_s],
        [result, ca.jacobian(result, known), ca.jacobian(result, candidates), ca.jacobian(result, disturbance)],
    )
    step = ca.Function("step", step.sx_in(), [ca.densify(one) for one in step(*step.sx_in())])

    acceleration = ca.SX.sym("acceleration_rpm_per_s")
    rise = _tool_c(p, copper, tool)
    shown = ca.vertcat(
        depth_mm(p, creep, slow, fast, rise),
        p.operating_temperature_c + rise,
        motor + p.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM * acceleration,
    )
    jacobians = [ca.densify(ca.jacobian(shown, x)), ca.densify(ca.jacobian(shown, candidates))]
    disturbed = [x, disturbance, values, force, acceleration]
    return step, ca.Function("outputs", disturbed, [shown, *jacobians])


@lru_cache(maxsize=8)
def _mapped(n_ticks: int) -> ca.Function:
    """The outputs of all ticks at once."""
    return _functions()[1].map(n_ticks)


class Course(NamedTuple):
    """The model's prediction for a segment of n ticks."""

    outputs: FloatArray  #: (n, 3): in the order of ``OUTPUTS``
    by_candidate: FloatArray  #: (n, 3, len(CANDIDATES)): derivatives by the parameters
    #: (n, 3, m): derivatives by ``START``, by the knots of the disturbances of force [kN], then of power [kW], and by
    #: ``added``
    by_nuisance: FloatArray


def knots(n_ticks: int) -> int:
    """How many knots each slow disturbance has in a segment."""
    return max(2, round(n_ticks * STEP_S / KNOT_S) + 1)


def hats(n_ticks: int) -> FloatArray:
    """Weight of each knot at each tick, (n_ticks, knots)."""
    n = knots(n_ticks)
    position = np.linspace(0.0, n - 1.0, n_ticks)
    return np.maximum(0.0, 1.0 - np.abs(position[:, None] - np.arange(n)))


class _Step:
    """The step function with its results, without copies: ``run`` reads and writes the arrays that are here."""

    def __init__(self, values: FloatArray, whole_s: float) -> None:
        step, _ = _functions()
        self.known, self.disturbance = np.zeros(N_STATES + 2 * _N_POWER), np.zeros(2)
        self.force, self.speed = np.zeros(1), np.zeros(1)
        self.result = np.zeros(N_STATES + _N_POWER)
        self.by_known, self.by_candidate, self.by_disturbance = (
            np.zeros((self.result.size, n), order="F") for n in (self.known.size, len(CANDIDATES), 2)
        )
        arguments = (self.known, self.disturbance, values, self.force, self.speed, np.array([whole_s]))
        results = (self.result, self.by_known.T, self.by_candidate.T, self.by_disturbance.T)
        buffer: Any
        buffer, self.run = step.buffer()
        for i, argument in enumerate(arguments):
            buffer.set_arg(i, argument.data)
        for i, result in enumerate(results):
            buffer.set_res(i, result.data)
        self._kept = buffer, arguments  # they have to live as long as what is run


def simulate(
    p: ModelParameters,
    segment: Segment,
    nuisance: FloatArray,
    shapes: FloatArray | None = None,
    added: Any = (),
    shows: Any = True,
) -> Course:
    """Simulate a segment along its recorded inputs.

    Parameters
    ----------
    p : ModelParameters
    segment : Segment
    nuisance : (m,) array
        ``START`` of the segment, and its knots of the disturbances of force [kN], then of power [kW].
    shapes : (n, s) array, optional
        Time courses of torques that the copper exerts in addition to the model's: they are measured, and they heat.
    added : (s,) array
        Sizes of the courses [N m].
    shows : (s,) array of bool
        Whether a course appears in the measured torque; otherwise it only heats.
    """
    n, n_candidates = segment.n_ticks, len(CANDIDATES)
    added = np.asarray(added, dtype=float)
    shapes = np.zeros((n, 0)) if shapes is None else shapes
    shown_shapes = shapes * shows
    values = np.array([getattr(p, name) for name in _ALL])
    disturbance = hats(n) @ nuisance[len(START) :].reshape(2, -1).T
    states, slopes = _states(p, values, segment, nuisance, disturbance, shapes, shapes @ added)
    before = np.maximum(np.arange(n) - 1, 0)
    shown, by_state, direct = _mapped(n)(
        states.T, disturbance[before].T, np.tile(values[:, None], n), segment.force_kn[before][None],
        segment.acceleration_rpm_per_s[None],
    )  # fmt: skip
    outputs = shown.full().T
    outputs[:, 2] += shown_shapes @ added
    total = by_state.full().reshape(3, n, N_STATES).transpose(1, 0, 2) @ slopes
    total[:, :, :n_candidates] += direct.full().reshape(3, n, n_candidates).transpose(1, 0, 2)
    total[:, 2, total.shape[2] - shapes.shape[1] :] += shown_shapes
    return Course(outputs, total[:, :, :n_candidates], total[:, :, n_candidates:])


def _states(
    p: ModelParameters,
    values: FloatArray,
    segment: Segment,
    nuisance: FloatArray,
    disturbance: FloatArray,
    shapes: FloatArray,
    torque_nm: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """States (n, N_STATES) and their derivatives (n, N_STATES, columns of all unknowns of the segment)."""
    n, n_candidates = segment.n_ticks, len(CANDIDATES)
    weights = hats(n)
    n_knots = weights.shape[1]
    n_columns = n_candidates + nuisance.size + shapes.shape[1]
    of_force, of_power = n_candidates + len(START), n_candidates + len(START) + n_knots
    kw_per_nm = 1e-3 * RAD_PER_S_PER_RPM * segment.speed_rpm  # (24)
    heat_kw = kw_per_nm[:, None] * shapes
    whole = int(np.floor(p.dead_time_s / STEP_S + 1e-9))
    step = _Step(values, whole * STEP_S)
    # power of the steps, those before the segment first; its derivatives are those by the power before
    power = np.full((n + whole + 1, _N_POWER), nuisance[5])
    power_slopes = np.zeros((n + whole + 1, _N_POWER, n_columns))
    power_slopes[: whole + 1, :, n_candidates + 5] = 1.0
    states, slopes = np.zeros((n, N_STATES)), np.zeros((n, N_STATES, n_columns))
    states[0] = nuisance[:N_STATES]
    slopes[0, :, n_candidates : n_candidates + N_STATES] = np.eye(N_STATES)
    older, newer = slice(N_STATES, N_STATES + _N_POWER), slice(N_STATES + _N_POWER, None)
    chained = np.empty((step.known.size, n_columns))
    knot_of = np.minimum((np.linspace(0.0, n_knots - 1.0, n)).astype(int), n_knots - 2)
    for k, i in enumerate(knot_of[:-1]):
        step.known[:N_STATES], step.known[older], step.known[newer] = states[k], power[k], power[k + 1]
        step.disturbance[:] = disturbance[k]
        step.force[0], step.speed[0] = segment.force_kn[k], segment.speed_rpm[k]
        step.run()
        chained[:N_STATES], chained[older], chained[newer] = slopes[k], power_slopes[k], power_slopes[k + 1]
        ahead = step.by_known @ chained
        ahead[:, :n_candidates] += step.by_candidate
        for which, begin in enumerate((of_force + i, of_power + i)):
            ahead[:, begin : begin + 2] += step.by_disturbance[:, which, None] * weights[k, i : i + 2]
        states[k + 1] = step.result[:N_STATES]
        power[k + whole + 1] = step.result[N_STATES:] + kw_per_nm[k] * torque_nm[k]
        slopes[k + 1], power_slopes[k + whole + 1] = ahead[:N_STATES], ahead[N_STATES:]
        power_slopes[k + whole + 1, :, n_columns - shapes.shape[1] :] += heat_kw[k]
    return states, slopes
