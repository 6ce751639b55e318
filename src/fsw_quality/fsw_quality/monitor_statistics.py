"""Statistics of the monitor: simple ones, each of a window of samples, and each with its source."""

from __future__ import annotations

from collections import deque
from math import sqrt
from typing import NamedTuple

import numpy as np

from fsw_analysis.weld_signals import FloatArray

#: a shorter delay explains nearly as well up to this ratio of variances (chosen); what rounding adds
_NEARLY, _ROUNDING = 1.5, 1e-12
#: lags of the autocorrelation that :func:`ljung_box` sums
LAGS = 20
#: order of the autoregression in :func:`harris_index`
_ORDER = 12
#: zero crossings of the autocorrelation, within half the window, that an oscillation needs: two periods
_CROSSINGS = 4


class Window(deque[float]):
    """The newest samples, at most ``size``."""

    def __init__(self, size: int) -> None:
        super().__init__(maxlen=size)

    @property
    def full(self) -> bool:
        """Whether as many samples have come as it holds."""
        return len(self) == self.maxlen

    def values(self, newest: int = 0) -> FloatArray:
        """The samples, oldest first; only the ``newest`` ones if that is given."""
        return np.array(self)[-newest:]


def noise_sigma(values: FloatArray) -> float:
    """Standard deviation of the white noise on a smooth signal, from second differences (von Neumann's idea).

    Their median is taken, so that spikes and steps do not count; 1.4826 makes it a standard deviation.
    """
    if values.size < 3:
        return 0.0
    second = np.abs(values[2:] - 2.0 * values[1:-1] + values[:-2])
    return 1.4826 * float(np.median(second)) / sqrt(6.0)


def robust_slope(values: FloatArray, step_s: float, span: int) -> float:
    """Slope per s: the median of the differences over ``span`` samples, so that a step in the window is no slope."""
    if values.size <= span:
        return 0.0
    return float(np.median(values[span:] - values[:-span])) / (span * step_s)


def gain_beside_slope(values: FloatArray, cause: FloatArray, gain: float, gain_error: float, noise: float) -> float:
    """Gain with which ``cause`` acts on values that have a slope, too, by least squares.

    The gain is known beforehand, with the standard error ``gain_error`` (ridge regression): where the cause does not
    move, or moves like a slope, the known gain stays. ``noise`` is that of a value.
    """
    n = values.size
    if n < 3:
        return gain
    time, moved = np.arange(n) - 0.5 * (n - 1), cause - cause.mean()
    rest = values - values.mean() - gain * moved
    squares = np.array([[time @ time, time @ moved], [time @ moved, moved @ moved + (noise / gain_error) ** 2]])
    return gain + float(np.linalg.solve(squares, np.array([time @ rest, moved @ rest]))[1])


def ljung_box(values: FloatArray) -> float:
    """Ljung and Box's Q per degree of freedom: about 1 for white noise (Biometrika 65, 1978, 297-303)."""
    n, centred = values.size, values - values.mean()
    power = float(centred @ centred)
    if power <= 0.0 or n <= LAGS + 1:
        return 1.0
    rho = np.array([float(centred[lag:] @ centred[:-lag]) for lag in range(1, LAGS + 1)]) / power
    return n * (n + 2.0) * float(np.sum(rho**2 / (n - np.arange(1, LAGS + 1)))) / LAGS


class Oscillation(NamedTuple):
    """Whether a signal swings: a regularity above 1 means that it does; its period [s] and its amplitude."""

    regularity: float
    period_s: float
    amplitude: float


def oscillation(values: FloatArray, step_s: float) -> Oscillation:
    """Regularity of the zero crossings of the autocorrelation (Thornhill, Huang, Zhang, J. Process Control 13, 2003).

    It is a third of the mean distance of the crossings over its standard deviation. White noise counts at lag 0 alone,
    which is left out, and so is a linear trend.
    """
    n = values.size
    time = np.arange(n) - 0.5 * (n - 1)
    centred = values - values.mean()
    centred = centred - time * (float(time @ centred) / float(time @ time))
    spectrum = np.fft.rfft(centred, 2 * n)
    correlation = np.fft.irfft(spectrum * np.conj(spectrum))[: n // 2]
    if correlation[0] <= 0.0:
        return Oscillation(0.0, 0.0, 0.0)
    crossings = np.flatnonzero(np.diff(np.signbit(correlation[1:])))
    if crossings.size < _CROSSINGS:
        return Oscillation(0.0, 0.0, 0.0)
    distances = np.diff(crossings[:11]).astype(np.float64)
    mean, deviation = float(distances.mean()), max(float(distances.std(ddof=1)), 0.5)
    # the first maximum after a whole period has the swinging part of the power, and no noise
    period = max(round(2.0 * mean), 1)
    power = max(float(correlation[min(period, correlation.size - 1)]), 0.0) / n
    return Oscillation(mean / (3.0 * deviation), period * step_s, sqrt(2.0 * power))


def harris_index(errors: FloatArray, delay: int) -> float:
    """Least attainable variance over the actual one, 0 to 1 (Harris, Can. J. Chem. Eng. 67, 1989, 856-861).

    The error is modelled as an autoregression (Yule-Walker); what enters within the ``delay`` samples of the process,
    no controller can take away.
    """
    n, centred = errors.size, errors - errors.mean()
    power = float(centred @ centred)
    if n <= 3 * _ORDER or power <= 0.0:
        return 1.0
    covariance = np.array([float(centred[lag:] @ centred[: n - lag]) for lag in range(_ORDER + 1)]) / n
    covariance[0] *= 1.0 + 1e-9
    lags = np.arange(_ORDER)
    weights = np.linalg.solve(covariance[np.abs(lags[:, None] - lags)], covariance[1:])
    impulse = np.zeros(delay)
    impulse[:1] = 1.0
    for i in range(1, delay):
        reach = min(i, _ORDER)
        impulse[i] = float(weights[:reach] @ impulse[i - 1 :: -1][:reach])
    innovation = max(float(covariance[0] - weights @ covariance[1:]), 0.0)
    return min(innovation * float(impulse @ impulse) / (power / n), 1.0)


def best_delay(given: FloatArray, followed: FloatArray, largest: int) -> int:
    """Samples by which ``followed`` is at least behind ``given``, but for an offset between them.

    The shortest delay that explains ``followed`` nearly as well as the best: on a ramp a delay is an offset, too.
    """
    variances = np.array(
        [np.var(followed[largest:] - given[largest - delay : given.size - delay]) for delay in range(largest + 1)]
    )
    return int(np.argmax(variances <= _NEARLY * variances.min() + _ROUNDING))
