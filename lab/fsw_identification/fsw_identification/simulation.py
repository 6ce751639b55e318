"""The model's outputs along recorded inputs, and the effect of unknown slow disturbances.

The static equations are those of :mod:`fsw_model.equations`. Each output follows from the inputs
and from the other outputs as measured and smoothed: depth (17), (27) from force and temperature;
torque (18)-(23) from force, speed and depth; temperature (16), (24) from the power of that torque,
behind the thermocouple's lag if there is one. Each is thus a linear response of parallel lags,
exact for inputs that are linear within a step. The fast pole of (17) is omitted: it is a hundred
times faster than a step.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy

from fsw_analysis.weld_signals import FloatArray
from fsw_control.units import RAD_PER_S_PER_RPM
from fsw_identification.weld_data import Segment
from fsw_model import STEP_S, ModelParameters
from fsw_model.equations import friction_torque_nm, power_kw, process_torque_nm

OUTPUTS = ("depth_mm", "temperature_c", "torque_nm")
DEPTH, TEMPERATURE, TORQUE = range(3)
#: candidates for estimation by output; the others are the operating point, the fast pole and the
#: friction
OF_TEMPERATURE = ("thermal_gain_c_per_kw", "copper_lag_s", "tool_lag_s", "dead_time_s")
OF_DEPTH = ("depth_gain_mm_per_kn_s", "depth_zero_s", "depth_pole_slow_s", "softening_per_c")
OF_TORQUE = (
    "motor_lag_s",
    "sliding_friction",
    "sticking_stress_pa",
    "contact_slope",
    "spindle_inertia_kgm2",
)
CANDIDATES: tuple[str, ...] = (*OF_TEMPERATURE, *OF_DEPTH, *OF_TORQUE)
#: parameters of each output; the temperature depends on ``OF_TORQUE`` through the power
DEPENDS = (OF_DEPTH, (*OF_TEMPERATURE, *OF_TORQUE), OF_TORQUE)
#: two temperature lags that are closer than this share are treated as this far apart
_APART = 1e-3
#: distance of the knots of a slow disturbance, which is linear in between
KNOT_TICKS = 100


class Response(NamedTuple):
    """Output over the ticks of a segment: ``factor (course + modes of the disturbed input)``."""

    course: FloatArray  #: (n,): from rest, along the recorded inputs
    #: (modes,): time constants [s] (infinite for an integrator) and gains of the lags between
    #: input and output
    lags_s: FloatArray
    gains: FloatArray
    factor: FloatArray  #: (n,)


class Knowledge(NamedTuple):
    """Inputs of an output from the other outputs, (n,) each."""

    rise_c: FloatArray  #: over the operating temperature, as a thermocouple shows it
    depth_mm: FloatArray  #: of the tool
    torque_nm: FloatArray  #: that acts in addition to the model's
    #: slow disturbance of the temperature, of which only a share is known to be real; that share
    #: is in ``rise_c``
    doubtful_c: FloatArray
    rate_c_per_s: FloatArray  #: at which that rises


def respond(
    output: int, p: ModelParameters, segment: Segment, known: Knowledge, lag_s: float = 0.0
) -> Response:
    """Response of one of ``OUTPUTS``; ``lag_s`` is the thermocouple's lag behind the tool."""
    none, ones = np.zeros(0), np.ones(segment.n_ticks)
    if output == DEPTH:
        pushed, pole_s = segment.force_kn - p.operating_force_kn, p.depth_pole_slow_s
        gains = p.depth_gain_mm_per_kn_s * np.array([1.0, p.depth_zero_s - pole_s])
        creep, slow = _filtered(STEP_S * pushed, 1.0), _lagged(pushed, pushed, pole_s)
        course = p.operating_depth_mm + gains[0] * creep + gains[1] * slow
        return Response(course, np.array([np.inf, pole_s]), gains, softened(p, known, lag_s))
    if output == TORQUE:
        course = _motor_nm(p, segment, known.depth_mm)
        course += p.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM * segment.acceleration_rpm_per_s
        return Response(course, none, none, ones)
    course = heated(p, *_power_kw(p, segment, known), lag_s)
    return Response(p.operating_temperature_c + course, *_thermal_modes(p, lag_s), ones)


def _power_kw(
    p: ModelParameters, segment: Segment, known: Knowledge
) -> tuple[FloatArray, FloatArray]:
    """Power (24) over the operating power at both ends of each step."""
    speed: Any = segment.speed_rpm
    torque = _motor_nm(p, segment, known.depth_mm)
    other = known.torque_nm - friction_torque_nm(p, speed)
    ends: Any = torque + other, np.append(torque[1:], torque[-1]) + other
    begin, end = (np.asarray(power_kw(torques, speed) - p.operating_power_kw) for torques in ends)
    return begin, end


def softened(p: ModelParameters, known: Knowledge, lag_s: float = 0.0) -> FloatArray:
    """Factor (27) of the depth; the tool leads a lagging thermocouple."""
    return 1.0 + p.softening_per_c * (known.rise_c + lag_s * known.rate_c_per_s)


def heated(
    p: ModelParameters, begin_kw: FloatArray, end_kw: FloatArray, lag_s: float = 0.0
) -> FloatArray:
    """Rise (16) after power that is linear within each step; constant before the first."""
    lags_s, gains = _thermal_modes(p, lag_s)
    return np.asarray(gains @ [_late(begin_kw, end_kw, one_s, p.dead_time_s) for one_s in lags_s])


def _thermal_modes(p: ModelParameters, lag_s: float) -> tuple[FloatArray, FloatArray]:
    """Time constants [s] and gains of (16) and the thermocouple's lag as parallel lags."""
    lags_s = np.array([p.copper_lag_s, p.tool_lag_s, lag_s][: 3 if lag_s > 0.0 else 2])
    if lag_s > 0.0:  # partial fractions need distinct lags
        for other_s in lags_s[:2]:
            if abs(lags_s[2] - other_s) < _APART * other_s:
                lags_s[2] = (1.0 + _APART) * other_s
    # 1 / prod(1 + s lag) in partial fractions: a mode's gain is its lag to the power n - 1 over
    # the product of its distances from the others; the diagonal leaves out the mode itself
    apart = lags_s[:, None] - lags_s + np.diag(np.ones(lags_s.size))
    return lags_s, np.asarray(
        p.thermal_gain_c_per_kw * lags_s ** (lags_s.size - 1) / apart.prod(axis=1)
    )


def as_shown(p: ModelParameters, lag_s: float) -> ModelParameters:
    """Parameters of (16) for the reading of a lagging thermocouple.

    Dead time and shorter lag are those with the least-squares step response to all three lags.
    """
    step = np.ones(round((p.dead_time_s + 10.0 * (p.tool_lag_s + lag_s)) / STEP_S))
    step[0] = 0.0
    expected = heated(p, step, step, lag_s)

    def changed(logs: FloatArray) -> ModelParameters:
        return p.changed(
            **dict(zip(("tool_lag_s", "dead_time_s"), map(float, np.exp(logs)), strict=True))
        )

    long_s, short_s = max(p.tool_lag_s, lag_s), min(p.tool_lag_s, lag_s)
    start = np.log(
        [long_s + short_s / 2.0, p.dead_time_s + short_s / 2.0]
    )  # Skogestad's half rule
    fitted = scipy.optimize.least_squares(
        lambda logs: heated(changed(logs), step, step) - expected, start
    )
    return changed(fitted.x)


def rising(
    p: ModelParameters, segment: Segment, known: Knowledge, lag_s: float, at_knots: FloatArray
) -> FloatArray:
    """Rate at which the shown temperature rises [°C/s], without drift of the sensor."""
    lags_s, gains = _thermal_modes(p, lag_s)
    power, heat = _power_kw(p, segment, known), at_knots.copy()
    heat[:, -1] = 0.0
    gains = -gains / lags_s  # their sum is 0: lags in series have no direct feedthrough
    course = gains @ [_late(*power, one_s, p.dead_time_s) for one_s in lags_s]
    response = Response(course, lags_s, gains, np.ones(segment.n_ticks))
    return shown(response, walks(response), heat)


def _motor_nm(p: ModelParameters, segment: Segment, depth_mm: FloatArray) -> FloatArray:
    """Motor torque (18) along recorded inputs, settled at the beginning."""
    force: Any = segment.force_kn
    speed: Any = segment.speed_rpm
    depths: Any = depth_mm, np.append(depth_mm[1:], depth_mm[-1])
    friction: Any = friction_torque_nm(p, speed)
    begin, end = (np.asarray(process_torque_nm(p, force, depth) + friction) for depth in depths)
    return np.asarray(begin[0] + _lagged(begin - begin[0], end - begin[0], p.motor_lag_s))


def _filtered(added: FloatArray, left: float) -> FloatArray:
    """x of x[k + 1] = left x[k] + added[k], from 0."""
    return np.asarray(scipy.signal.lfilter([0.0, 1.0], [1.0, -left], added))


def _ramped(begin: FloatArray, slope: FloatArray, span_s: float, lag_s: float) -> FloatArray:
    """Contribution of an input to a first-order lag within ``span_s``."""
    left = np.exp(-span_s / lag_s)
    return np.asarray(begin * (1.0 - left) + slope * (span_s - lag_s * (1.0 - left)))


def _lagged(begin: FloatArray, end: FloatArray, lag_s: float) -> FloatArray:
    """First-order lag, from 0, of an input that is linear within each step."""
    return _filtered(
        _ramped(begin, (end - begin) / STEP_S, STEP_S, lag_s), np.exp(-STEP_S / lag_s)
    )


def _late(begin: FloatArray, end: FloatArray, lag_s: float, dead_time_s: float) -> FloatArray:
    """As :func:`_lagged`, after a dead time of at least a step, settled before the first step."""
    whole = int(np.floor(dead_time_s / STEP_S + 1e-9))
    part_s = dead_time_s - whole * STEP_S
    rest_s, first = STEP_S - part_s, begin[0]
    slope = (end - begin) / STEP_S
    # of an arriving step, the end of the older one comes first
    older = _ramped(begin - first + slope * rest_s, slope, part_s, lag_s) * np.exp(-rest_s / lag_s)
    newer = _ramped(begin - first, slope, rest_s, lag_s)
    arriving = np.zeros(begin.size + 1)
    arriving[:-1] += newer
    arriving[1:] += older
    arriving = np.concatenate([np.zeros(whole), arriving])[: begin.size]
    return np.asarray(first + _filtered(arriving, np.exp(-STEP_S / lag_s)))


class Walks(NamedTuple):
    """Effect of the unknowns at the knots.

    In this order: states of the modes; then, for the disturbances of the input (if there are
    modes) and of the output, their trend per knot and their values.
    """

    here: FloatArray  #: (KNOT_TICKS + 1, p): on the ticks from a knot to the next
    ahead: FloatArray  #: (KNOT_TICKS + 1, p): on the same ticks, of the next
    #: (p, p): ``after`` times a knot's values is this times those of the knot before
    before: FloatArray
    after: FloatArray  #: (p, p)


def walks(response: Response) -> Walks:
    """Of a response; without modes only the output is disturbed."""
    # Between knots a disturbance is linear, so that its effect on a lag is known in closed form; a
    # knot each 10 s makes the unknowns a hundred times fewer than one per tick.
    n, size = KNOT_TICKS, response.gains.size
    count = 2 if size else 1
    columns = size + 2 * count
    share = np.arange(n + 1) / n
    here, ahead = np.zeros((n + 1, columns)), np.zeros((n + 1, columns))
    before, after = np.eye(columns), np.eye(columns)
    before[-count:, -2 * count : -count] = np.eye(count)
    here[:, -1], ahead[:, -1] = 1.0 - share, share
    for i, (lag_s, gain) in enumerate(zip(response.lags_s, response.gains, strict=True)):
        at_s, whole_s = STEP_S * np.arange(n + 1), STEP_S * n
        integrates = np.isinf(lag_s)
        left = np.ones(n + 1) if integrates else np.exp(-at_s / lag_s)
        level = at_s if integrates else 1.0 - left
        rising = at_s**2 / 2.0 / whole_s if integrates else (at_s - lag_s * (1.0 - left)) / whole_s
        here[:, i] = gain * left
        here[:, -2] += gain * (level - rising)
        ahead[:, -2] += gain * rising
        before[i, i], before[i, -2], after[i, -2] = left[-1], (level - rising)[-1], -rising[-1]
    return Walks(here, ahead, before, after)


def driven(walk: Walks, at_knots: FloatArray) -> FloatArray:
    """Values at the knots, with the states caused by the input's disturbance."""
    driven = at_knots.copy()
    for i in range(at_knots.shape[1] - 4):
        added = at_knots[:-1, -2] * walk.before[i, -2] - at_knots[1:, -2] * walk.after[i, -2]
        driven[:, i] = scipy.signal.lfilter(
            [1.0], [1.0, -walk.before[i, i]], np.append(at_knots[0, i], added)
        )
    return driven


def shown(response: Response, walk: Walks, at_knots: FloatArray) -> FloatArray:
    """Output for values at the knots, without shifts."""
    added = at_knots[:-1] @ walk.here[:-1].T + at_knots[1:] @ walk.ahead[:-1].T
    return np.asarray(response.factor * (response.course + added.ravel()[: response.course.size]))


def added(response: Response, walk: Walks, at_knots: FloatArray) -> FloatArray:
    """Effect of knot values on an output; the input's disturbance starts in equilibrium."""
    settled = at_knots.copy()
    settled[0, :-4] = settled[0, -2]
    course = shown(response, walk, driven(walk, settled)) - response.factor * response.course
    return np.asarray(course - course[0])
