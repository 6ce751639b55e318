"""The machine: rates of its drives from recorded welds, friction (23) from a run in air."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import log
from typing import NamedTuple

import numpy as np

from fsw_analysis.weld_signals import FloatArray, WeldSignals
from fsw_control.schema.models import InputError
from fsw_control.weld import TICK_S
from fsw_identification.weld_data import prepare
from fsw_model import ModelParameters

#: lags and dead times that a drive may have as well, so that neither passes for a rate
_LAGS_S, _DEAD_TICKS = np.geomspace(0.01, 2.0, 16), range(4)
#: of the largest move of a command; the last one is no limit
_SHARES = np.append(np.geomspace(0.01, 0.95, 24), 1.0)
#: times that the surroundings of the most likely lag and rate are looked at more closely
_ZOOMS = 3
#: errors below this share of the largest move do not matter
_HARMLESS = 1e-3
#: of the likelihood ratio of a rate: a chi-squared of one degree of freedom, at 0.1 %
_SIGNIFICANT = 10.8
#: what a rate leaves of the feedback may exceed its white part by this factor, and this share of
#: the largest move, for a drive that is not quite the model's
_WHITE, _UNLIKE = 2.0, 0.1
#: gains of feedback beyond these are no scale error
_GAINS = (0.5, 2.0)
#: standard deviation of white noise over the median magnitude of its changes
_OF_MEDIAN = 1.0 / (0.6745 * 2.0**0.5)
#: lowest rate of a drive's welds over the highest, if they agree
_AGREEING = 0.8
#: ticks that are used at most, and first ones, before which the drive may have been anywhere
_MOST_TICKS, _SETTLING_TICKS = 6000, 50
#: coefficients of (23)
_FRICTION = (
    "friction_constant_nm",
    "friction_linear_nm_per_rpm",
    "friction_quadratic_nm_per_rpm2",
)
#: settling time of the torque after a speed change, in motor lags
_SETTLED = 8.0
#: slower changes count as constant speed [rpm/s]
_STEADY_RPM_PER_S = 1.0
#: speeds closer than this count as one, and the number that the parabola requires [rpm]
_ONE_SPEED_RPM, _FEWEST_SPEEDS = 10.0, 3


class DriveRates(NamedTuple):
    """Rates that limit the drives; None: no limit shows."""

    force_kn_per_s: float | None = None
    speed_rpm_per_s: float | None = None
    unknown: tuple[str, ...] = ()  #: drives whose feedback the model of a drive does not explain

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on what stays unknown."""
        return tuple(
            f"{drive} drive: no one rate, lag, gain and offset explain its feedback; "
            "its rate stays unknown"
            for drive in self.unknown
        )


class _Fit(NamedTuple):
    """A drive that explains feedback best."""

    error: float  #: sum of squares
    step: float  #: largest of a tick
    gain: float  #: of the feedback
    lag_s: float
    dead: int


def drive_rates(welds: Sequence[WeldSignals]) -> DriveRates:
    """Rates that limit the drives in welds of one machine."""
    rates: dict[str, list[float | None]] = {"force": [], "speed": []}
    for weld in welds:
        if weld.drives is None:
            continue
        for drive, commands, acting in (
            ("force", weld.force_kn, weld.drives.force_kn),
            ("speed", weld.speed_rpm, weld.drives.speed_rpm),
        ):
            rates[drive].append(_rate(commands[:_MOST_TICKS], acting[:_MOST_TICKS]))
    common: dict[str, float | None] = {}
    unknown = []
    for drive, of_welds in rates.items():
        limits = [rate for rate in of_welds if rate is not None and np.isfinite(rate)]
        agree = not limits or min(limits) >= _AGREEING * max(limits)
        common[drive] = float(np.median(limits)) if limits and agree else None
        if not agree or len(limits) < sum(rate is not None for rate in of_welds):
            unknown.append(drive)
    return DriveRates(common["force"], common["speed"], tuple(unknown))


def _rate(commands: FloatArray, acting: FloatArray) -> float | None:
    """Most likely rate of a drive, if it is significantly more likely than none; NaN: unexplained.

    A drive follows its command after a dead time, limited in rate, through a first-order lag, and
    its feedback has a gain, an offset and white errors: the likelihood falls with the sum of their
    squares. A slow drive also "explains" feedback that sticks or jumps, but leaves errors that are
    not white, much larger than their changes from tick to tick.
    """
    known = np.isfinite(commands) & np.isfinite(acting)
    commands, acting = commands[known], acting[known]
    largest = float(np.abs(np.diff(commands)).max(initial=0.0))
    if largest == 0.0 or commands.size <= 2 * _SETTLING_TICKS:
        return None
    if np.ptp(acting) == 0.0:
        return np.nan
    steps = _SHARES * largest
    limited, unlimited = (_closest(commands, acting, of) for of in (steps, steps[-1:]))
    harmless = commands.size * (_HARMLESS * largest) ** 2
    ratio = commands.size * log((unlimited.error + harmless) / (limited.error + harmless))
    left = _left(commands, acting, limited)
    white = _OF_MEDIAN * float(np.median(np.abs(np.diff(left))))
    if float(np.std(left)) > np.hypot(_WHITE * white, _UNLIKE * largest):
        return np.nan
    if ratio <= _SIGNIFICANT:
        return None
    believable = limited.step > steps[1] and _GAINS[0] < limited.gain < _GAINS[1]
    return limited.step / TICK_S if believable else np.nan


def _closest(commands: FloatArray, acting: FloatArray, steps: FloatArray) -> _Fit:
    """The drive with the least errors, by dead time, and more closely by lag and largest step."""
    lags_s = _LAGS_S
    tried = {ticks: _errors(commands, acting, ticks, lags_s, steps) for ticks in _DEAD_TICKS}
    dead = min(tried, key=lambda ticks: tried[ticks][0].min())
    for zoom in range(_ZOOMS + 1):
        errors, gains = _errors(commands, acting, dead, lags_s, steps) if zoom else tried[dead]
        i, k = np.unravel_index(np.argmin(errors), errors.shape)
        error, gain = float(errors[i, k]), float(gains[i, k])
        fit = _Fit(error, float(steps[k]), gain, float(lags_s[i]), dead)
        lags_s, steps = _around(lags_s, int(i)), _around(steps, int(k))
    return fit


def _around(grid: FloatArray, k: int) -> FloatArray:
    """A finer grid between the neighbours of a value."""
    low, high = grid[max(k - 1, 0)], grid[min(k + 1, grid.size - 1)]
    return np.geomspace(low, high, 9) if high > low else grid


def _positions(
    commands: FloatArray, dead: int, lags_s: FloatArray, steps: FloatArray
) -> Iterator[FloatArray]:
    """Positions of drives from the end of settling on, by lag and largest step of a tick."""
    left = np.exp(-TICK_S / lags_s)[:, None]
    setpoint = np.full(steps.shape, commands[0])
    position = np.full((left.size, steps.size), commands[0])
    for k in range(commands.size - 1):
        setpoint = setpoint + np.clip(commands[max(k - dead, 0)] - setpoint, -steps, steps)
        position = setpoint + (position - setpoint) * left
        if k + 1 >= _SETTLING_TICKS:
            yield position


def _errors(
    commands: FloatArray, acting: FloatArray, dead: int, lags_s: FloatArray, steps: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Sum of the squared errors of a drive's feedback with its best gain and offset; the gain."""
    # Gain and offset are linear: the least squares over them follow from three sums, so that all
    # lags and rates of the grid are simulated together, tick by tick, and nothing else is kept.
    around, acting = commands.mean(), acting[_SETTLING_TICKS:]
    acting = acting - acting.mean()  # as the offset, so that only the gain is left
    total, squares, products = np.zeros((3, lags_s.size, steps.size))
    for position, at in zip(_positions(commands, dead, lags_s, steps), acting, strict=True):
        moved = position - around
        total += moved
        squares += moved**2
        products += moved * at
    squares -= total**2 / acting.size
    gains = np.divide(products, squares, out=np.zeros_like(squares), where=squares > 0.0)
    return np.maximum(acting @ acting - gains * products, 0.0), gains


def _left(commands: FloatArray, acting: FloatArray, fit: _Fit) -> FloatArray:
    """Errors that a drive leaves of its feedback, without their mean."""
    positions = _positions(commands, fit.dead, np.array([fit.lag_s]), np.array([fit.step]))
    left = acting[_SETTLING_TICKS:] - fit.gain * np.array([float(of[0, 0]) for of in positions])
    return np.asarray(left - left.mean())


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
    return start.changed(**dict(zip(_FRICTION, values, strict=True))), dict(
        zip(_FRICTION, deviations, strict=True)
    )
