"""Heat into the copper beyond the spindle's power, from a recorded weld.

It is estimated by a Kalman smoother on the thermal model (16).

The heat is a random walk, that is a Gaussian process. The model is the fast part of the copper's
response to the power: the slower part, which the weld's history makes, is in the heat, as it
comes again in the next weld of the type. Its lag is chosen; its gain, the tool's lag, the dead
time and the walk are those of the greatest likelihood: a weld shows how fast and when a power
heats, but a heat that wanders hides the settled gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, solve_discrete_are
from scipy.optimize import minimize, minimize_scalar
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
#: start of the search: gain of the fast part, and the walk of the heat per root second
_START_GAIN, _START_WALK = 10.0, 0.15
_WALK_LOGARITHMS = (np.log(1e-3), np.log(3.0))
_SEARCH_STEPS = 400
#: time until the filter has forgotten where it began
_SETTLED_S = 60.0


class HeatRecord(NamedTuple):
    """What tells the heat of a weld, by tick; from its longest part without long gaps."""

    first: int  #: tick of the weld at which it begins
    power_kw: FloatArray  #: deviation from the operating power
    rise_c: FloatArray  #: deviation from the operating temperature; NaN where there is no sample


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
    """Transition of copper, tool and heat over a tick, and the input by the power."""
    a, b = thermal_block(model)
    chain = np.zeros((3, 3))
    chain[:2, :2], chain[:2, 2] = a, b
    step = np.asarray(matrix_exponential(chain * TICK_S))
    return step, np.array([step[0, 2], step[1, 2], 0.0])


def _arriving(record: HeatRecord, model: ModelParameters) -> FloatArray:
    """Mean power that arrives in the tick that ends at each row."""
    rows = np.arange(record.power_kw.size)
    ago = model.dead_time_s / TICK_S + 0.5
    return np.asarray(np.interp(rows - ago, rows, record.power_kw))


def _noises(walk_kw: float) -> FloatArray:
    return np.diag([_COPPER_WALK_C**2, 0.0, walk_kw**2 * TICK_S])


def smooth(record: HeatRecord, model: ModelParameters, walk_kw: float) -> Heat:
    """The heat at each tick (Rauch, Tung, Striebel); ``walk_kw``: random walk per root second."""
    step, by_power = _matrices(model)
    arriving, noise = _arriving(record, model), _noises(walk_kw)
    n, known = record.rise_c.size, np.isfinite(record.rise_c)
    first = record.rise_c[np.argmax(known)]
    x = np.array([first, first, first / model.thermal_gain_c_per_kw - record.power_kw[0]])
    p = np.diag([25.0, 1.0, 25.0])
    after, before = np.empty((n, 3)), np.empty((n, 3))
    p_after, p_before = np.empty((n, 3, 3)), np.empty((n, 3, 3))
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
    record: HeatRecord, model: ModelParameters, walk_kw: float, shown: FloatArray
) -> float:
    """Negative logarithm of the likelihood of the temperatures, by the settled filter."""
    step, by_power = _matrices(model)
    seen = np.array([[0.0, 1.0, 0.0]])
    covariance = solve_discrete_are(step.T, seen.T, _noises(walk_kw), np.array([[_NOISE_C**2]]))
    variance = float(covariance[1, 1]) + _NOISE_C**2
    gain = covariance[:, 1:2] / variance
    # innovations by (power, temperature): x(k+1) = step (x + gain (y - x1)) + by_power u(k+1)
    closed = step @ (np.eye(3) - gain @ seen)
    inputs = np.column_stack([by_power, (step @ gain).ravel()])
    arriving = np.append(_arriving(record, model)[1:], 0.0)
    innovations = shown.copy()
    for column, signal in ((0, arriving), (1, shown)):
        numerator, denominator = ss2tf(closed, inputs, seen, np.zeros((1, 2)), input=column)
        innovations -= lfilter(numerator[0], denominator, signal)
    used = innovations[round(_SETTLED_S / TICK_S) :]
    return 0.5 * float(used.size * np.log(variance) + np.sum(used**2) / variance)


def fit_fast(
    records: Sequence[HeatRecord], model: ModelParameters
) -> tuple[ModelParameters, float]:
    """The model of the fast part of the copper, and the walk of the heat [kW per root second].

    Its lag is chosen; gain, dead time and lag of the tool are estimated. From where the search
    begins, the dead time is found if it is within a factor of about two.
    """
    rows = [np.arange(record.rise_c.size) for record in records]
    shown = [
        np.interp(row, row[np.isfinite(record.rise_c)], record.rise_c[np.isfinite(record.rise_c)])
        for row, record in zip(rows, records, strict=True)
    ]

    def changed(logarithms: FloatArray) -> ModelParameters:
        gain, tool_lag_s, dead_time_s, _ = np.exp(logarithms).tolist()
        return model.changed(
            thermal_gain_c_per_kw=gain,
            copper_lag_s=FAST_LAG_S,
            tool_lag_s=tool_lag_s,
            dead_time_s=dead_time_s,
        )

    def cost(logarithms: FloatArray) -> float:
        try:
            tried, walk_kw = changed(logarithms), float(np.exp(logarithms[3]))
            return sum(
                map(_unlikelihood, records, [tried] * len(rows), [walk_kw] * len(rows), shown)
            )
        except (InputError, LinAlgError):  # out of the model's range
            return float("inf")

    start = np.log([_START_GAIN, model.tool_lag_s, model.dead_time_s, _START_WALK])
    options = {"maxfev": _SEARCH_STEPS, "xatol": 1e-3, "fatol": 0.1}
    found = minimize(cost, start, method="Nelder-Mead", options=options)
    return changed(found.x), float(np.exp(found.x[3]))


def fit_walk(records: Sequence[HeatRecord], model: ModelParameters) -> float:
    """The walk of the heat alone, with a given model [kW per root second]."""
    shown = [
        np.interp(
            np.arange(record.rise_c.size),
            np.flatnonzero(np.isfinite(record.rise_c)),
            record.rise_c[np.isfinite(record.rise_c)],
        )
        for record in records
    ]

    def cost(logarithm: float) -> float:
        walk_kw = float(np.exp(logarithm))
        return sum(
            _unlikelihood(record, model, walk_kw, each)
            for record, each in zip(records, shown, strict=True)
        )

    found = minimize_scalar(cost, bounds=_WALK_LOGARITHMS, method="bounded")
    return float(np.exp(found.x))
