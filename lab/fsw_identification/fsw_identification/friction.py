"""Friction of motor and transmission (23), from a run in air."""

from __future__ import annotations

import numpy as np

from fsw_analysis.weld_signals import WeldSignals
from fsw_control.schema.models import InputError
from fsw_control.weld import TICK_S
from fsw_identification.weld_data import prepare
from fsw_model import ModelParameters

_NAMES = ("friction_constant_nm", "friction_linear_nm_per_rpm", "friction_quadratic_nm_per_rpm2")
#: settling time of the torque after a speed change, in motor lags
_SETTLED = 8.0
#: slower changes count as constant speed [rpm/s]
_STEADY_RPM_PER_S = 1.0
#: speeds closer than this count as one, and the number that the parabola requires [rpm]
_ONE_SPEED_RPM, _FEWEST_SPEEDS = 10.0, 3


def from_air(
    signals: WeldSignals, start: ModelParameters, drive_lag_s: float
) -> tuple[ModelParameters, dict[str, float]]:
    """Coefficients of (23) by least squares over the ticks at constant speed.

    Parameters
    ----------
    signals : WeldSignals
        Of a run in air, at three or more speeds.
    start : ModelParameters
        The rest of the model.
    drive_lag_s : float

    Returns
    -------
    model : ModelParameters
    deviations : dict of str to float
        Standard deviations of the three coefficients.

    Raises
    ------
    InputError
        If the run has too few speeds.
    """
    wait = round(_SETTLED * start.motor_lag_s / TICK_S)
    speeds, torques = [], []
    for segment in prepare(signals, drive_lag_s, in_air=True).segments:
        moving = np.abs(segment.acceleration_rpm_per_s) > _STEADY_RPM_PER_S
        settled = ~(np.convolve(moving, np.ones(wait + 1))[: moving.size] > 0.0)
        settled &= np.isfinite(segment.measured[:, 2])
        speeds.append(segment.speed_rpm[settled])
        torques.append(segment.measured[settled, 2])
    speed, torque = np.concatenate(speeds), np.concatenate(torques)
    distinct = 1 + int((np.diff(np.sort(speed)) > _ONE_SPEED_RPM).sum()) if speed.size else 0
    if distinct < _FEWEST_SPEEDS:
        raise InputError(
            f"{signals.path}: friction (23) needs a run in air at {_FEWEST_SPEEDS} or more "
            "constant speeds, "
            f"{_ONE_SPEED_RPM:g} rpm or more apart; it has {distinct}"
        )
    # Least squares, as (23) is linear in its coefficients; at constant speed neither inertia nor
    # the motor's lag adds to the torque.
    fitted, covariance = np.polyfit(speed, torque, 2, cov=True)
    values, deviations = map(float, fitted[::-1]), map(float, np.sqrt(np.diag(covariance))[::-1])
    return start.changed(**dict(zip(_NAMES, values, strict=True))), dict(
        zip(_NAMES, deviations, strict=True)
    )
