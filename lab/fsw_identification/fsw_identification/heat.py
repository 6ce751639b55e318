"""Heat into the copper beyond the spindle's power, from a recorded weld.

It is estimated by a Kalman smoother on the thermal model (16).

The heat is a random walk whose rate is one, too (a local linear trend, Harvey 1989): the canister
warms for minutes, and as the controller takes back as much power meanwhile, a walk without rate
takes the warming for a lack of gain, by a quarter. The model is the fast part of the copper's
response to the power: the slower part, which the weld's history makes, is in the heat, as it
comes again in the next weld of the type. Its lag is chosen; its gain, the tool's lag, the dead
time and the walks are those of the greatest likelihood: a weld shows how fast and when a power
heats, but a heat that wanders hides the settled gain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, solve_discrete_are
from scipy.optimize import minimize
from scipy.signal import lfilter, ss2tf

from fsw_analysis.weld_signals import FloatArray, WeldSignals
from fsw_control.schema.models import InputError
from fsw_control.units import RAD_PER_S_PER_RPM
from fsw_control.weld import TICK_S
from fsw_identification.weld_data import prepare
from fsw_model import ModelParameters
from fsw_model.equations import friction_torque_nm, matrix_exponential, thermal_block

#: standard deviations: of the thermocouple, and of the copper's own walk per tick [degC]
_NOISE_C, _COPPER_WALK_C = 0.1, 1e-3
#: lag of the fast part of the copper's response: the shorter, the more of the slower part is in
#: the heat; with a third of the controller's horizon the likelihood is near its greatest; chosen
FAST_LAG_S = 11.0
#: start of the search: gain of the fast part, and the walks of the heat and of its rate
_START_GAIN, _START_WALKS = 10.0, (0.15, 0.005)
#: the search begins without walk of the rate, with all of which it may end beside the optimum
_NO_WALK = 1e-6
_SEARCH_STEPS = 400
#: time until the filter has forgotten where it began
_SETTLED_S = 60.0


class HeatRecord(NamedTuple):
    """What tells the heat of a weld, by tick; from its longest part without long gaps."""

    first: int  #: tick of the weld at which it begins
    power_kw: FloatArray  #: deviation from the operating power
    rise_c: FloatArray  #: deviation from the operating temperature; NaN where there is no sample


class HeatWalk(NamedTuple):
    """Random walks, per root second."""

    heat_kw: float
    rate_kw_per_s: float  #: that of the heat's rate


class Heat(NamedTuple):
    """Heat by tick, with variances."""

    heat_kw: FloatArray
    variance_kw2: FloatArray


def heat_record(signals: WeldSignals, model: ModelParameters, drive_lag_s: float) -> HeatRecord:
    """Power and temperature of a weld; InputError if it lacks signals or is too short."""
    part = max(prepare(signals, drive_lag_s).segments, key=lambda segment: segment.n_ticks)
    inertia = model.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM * part.acceleration_rpm_per_s
    friction: FloatArray = friction_torque_nm(model, part.speed_rpm)  # type: ignore[arg-type,assignment]
    torque = part.measured[:, 2] - inertia - friction
    known = np.isfinite(torque)
    if not known.any():
        raise InputError(f"{signals.path}: no samples of the torque")
    rows = np.arange(part.n_ticks)
    torque = np.interp(rows, rows[known], torque[known])
    power = torque * RAD_PER_S_PER_RPM * part.speed_rpm * 1e-3 - model.operating_power_kw
    rise = part.measured[:, 1] - model.operating_temperature_c
    return HeatRecord(round(part.begin_s / TICK_S), power, rise)


def _matrices(model: ModelParameters) -> tuple[FloatArray, FloatArray]:
    """Transition of copper, tool, heat and its rate over a tick, and the input by the power."""
    a, b = thermal_block(model)
    chain = np.zeros((4, 4))
    chain[:2, :2], chain[:2, 2], chain[2, 3] = a, b, 1.0
    step = np.asarray(matrix_exponential(chain * TICK_S))
    return step, np.array([step[0, 2], step[1, 2], 0.0, 0.0])


def _arriving(record: HeatRecord, model: ModelParameters) -> FloatArray:
    """Mean power that arrives in the tick that ends at each row."""
    rows = np.arange(record.power_kw.size)
    ago = model.dead_time_s / TICK_S + 0.5
    return np.asarray(np.interp(rows - ago, rows, record.power_kw))


def _noises(walk: HeatWalk) -> FloatArray:
    heat, rate = (TICK_S * size**2 for size in walk)
    return np.diag([_COPPER_WALK_C**2, 0.0, heat, rate])


def smooth(record: HeatRecord, model: ModelParameters, walk: HeatWalk) -> Heat:
    """The heat at each tick (Rauch, Tung, Striebel)."""
    # Kalman filter forward, then backward the Rauch-Tung-Striebel recursion, which adds what later
    # samples say: the heat at a place is known better than any controller could know it in time.
    step, by_power = _matrices(model)
    arriving, noise = _arriving(record, model), _noises(walk)
    n, known = record.rise_c.size, np.isfinite(record.rise_c)
    first = record.rise_c[np.argmax(known)]
    x = np.array([first, first, first / model.thermal_gain_c_per_kw - record.power_kw[0], 0.0])
    p = np.diag([25.0, 1.0, 25.0, 0.01])
    after, before = np.empty((n, 4)), np.empty((n, 4))
    p_after, p_before = np.empty((n, 4, 4)), np.empty((n, 4, 4))
    for k in range(n):
        if k:
            x = step @ x + by_power * arriving[k]
            p = step @ p @ step.T + noise
        before[k], p_before[k] = x, p
        if known[k]:
            gain = p[:, 1] / (p[1, 1] + _NOISE_C**2)
            x = x + gain * (record.rise_c[k] - x[1])
            p = p - np.outer(gain, p[1])
        after[k], p_after[k] = x, p
    for k in range(n - 2, -1, -1):
        back = p_after[k] @ step.T @ np.linalg.inv(p_before[k + 1])
        after[k] += back @ (after[k + 1] - before[k + 1])
        p_after[k] += back @ (p_after[k + 1] - p_before[k + 1]) @ back.T
    return Heat(after[:, 2], p_after[:, 2, 2])


def _unlikelihood(
    record: HeatRecord, model: ModelParameters, walk: HeatWalk, shown: FloatArray
) -> float:
    """Negative logarithm of the likelihood of the temperatures, by the settled filter."""
    # With the stationary gain (Riccati equation) the innovations are the output of a constant
    # linear filter: two calls of lfilter, where the search would else repeat a loop over all ticks
    # of a weld hundreds of times.
    step, by_power = _matrices(model)
    seen = np.array([[0.0, 1.0, 0.0, 0.0]])
    covariance = solve_discrete_are(step.T, seen.T, _noises(walk), np.array([[_NOISE_C**2]]))
    variance = float(covariance[1, 1]) + _NOISE_C**2
    gain = covariance[:, 1:2] / variance
    # innovations by (power, temperature): x(k+1) = step (x + gain (y - x1)) + by_power u(k+1)
    closed = step @ (np.eye(4) - gain @ seen)
    inputs = np.column_stack([by_power, (step @ gain).ravel()])
    arriving = np.append(_arriving(record, model)[1:], 0.0)
    innovations = shown.copy()
    for column, signal in ((0, arriving), (1, shown)):
        numerator, denominator = ss2tf(closed, inputs, seen, np.zeros((1, 2)), input=column)
        innovations -= lfilter(numerator[0], denominator, signal)
    used = innovations[round(_SETTLED_S / TICK_S) :]
    return 0.5 * float(used.size * np.log(variance) + np.sum(used**2) / variance)


def _shown(record: HeatRecord) -> FloatArray:
    """Temperatures, interpolated where there is no sample."""
    known = np.flatnonzero(np.isfinite(record.rise_c))
    return np.interp(np.arange(record.rise_c.size), known, record.rise_c[known])


def _fit(
    records: Sequence[HeatRecord],
    model_of: Callable[..., ModelParameters],
    start: Sequence[float],
) -> tuple[ModelParameters, HeatWalk]:
    """The model's parameters, from where the search begins, and the walks: the likeliest ones."""
    shown = [_shown(record) for record in records]

    def cost(logarithms: FloatArray) -> float:
        *parameters, heat_kw, rate_kw_per_s = np.exp(logarithms).tolist()
        try:
            tried, walk = model_of(*parameters), HeatWalk(heat_kw, rate_kw_per_s)
            return sum(
                _unlikelihood(record, tried, walk, each)
                for record, each in zip(records, shown, strict=True)
            )
        except (InputError, LinAlgError):  # out of the model's range
            return float("inf")

    def search(tried: Callable[[FloatArray], float], start: FloatArray) -> FloatArray:
        options = {"maxfev": _SEARCH_STEPS, "xatol": 1e-3, "fatol": 0.1}
        return np.asarray(minimize(tried, start, method="Nelder-Mead", options=options).x)

    # Nelder-Mead, as there are few unknowns and no derivatives; logarithms keep them positive and
    # of similar size.
    heat_kw, rate_kw_per_s = _START_WALKS
    without = np.log(_NO_WALK)
    first = search(lambda x: cost(np.append(x, without)), np.log([*start, heat_kw]))
    *parameters, heat_kw, rate_kw_per_s = np.exp(
        search(cost, np.append(first, np.log(rate_kw_per_s)))
    ).tolist()
    return model_of(*parameters), HeatWalk(heat_kw, rate_kw_per_s)


def fit_fast(
    records: Sequence[HeatRecord], model: ModelParameters
) -> tuple[ModelParameters, HeatWalk]:
    """The model of the fast part of the copper, and the walks of the heat.

    Its lag is chosen; gain, dead time and lag of the tool are estimated. From where the search
    begins, the dead time is found if it is within a factor of about two.
    """

    def changed(gain: float, tool_lag_s: float, dead_time_s: float) -> ModelParameters:
        return model.changed(
            thermal_gain_c_per_kw=gain,
            copper_lag_s=FAST_LAG_S,
            tool_lag_s=tool_lag_s,
            dead_time_s=dead_time_s,
        )

    return _fit(records, changed, (_START_GAIN, model.tool_lag_s, model.dead_time_s))


def fit_walk(records: Sequence[HeatRecord], model: ModelParameters) -> HeatWalk:
    """The walks of the heat alone, with a given model."""
    return _fit(records, lambda: model, ())[1]
