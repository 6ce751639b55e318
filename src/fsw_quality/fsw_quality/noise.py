"""Noise of the residuals: how much, and over how long it is correlated, learnt at the begin of a weld.

Limits of white noise are too narrow for noise that is correlated: so many samples count as one. What follows from that
for a figure is its standard deviation, by which the figure is lessened. White noise lessens nothing.
"""

from __future__ import annotations

from math import exp, sqrt
from typing import NamedTuple

import numpy as np

from fsw_analysis.weld_signals import FloatArray
from fsw_control.weld import TICK_S

#: longest time of correlation that is told [s]: what is slower is a drift (chosen)
LONGEST_S = 5.0
#: noise is white unless second differences over three samples have so many times the power of those over one sample:
#: 1 if white, 1.7 for a correlation of a tick, 3 for a long one (chosen)
_COLOURED = 1.6
#: samples over which a change tells how long it is correlated; least time that is learnt from [s]
_FAR, _LEAST_S = 50, 15.0


class Noise(NamedTuple):
    """Noise of a value, a first-order Gauss-Markov process; no correlation: white, and how much is not told."""

    sigma: float = 0.0
    correlation_s: float = 0.0

    @property
    def autocorrelation(self) -> float:
        """From tick to tick: the share of the noise that is left."""
        return exp(-TICK_S / self.correlation_s) if self.correlation_s else 0.0

    @property
    def as_one(self) -> float:
        """How many samples count as one in a long mean."""
        return (1.0 + self.autocorrelation) / (1.0 - self.autocorrelation)

    def variance_of_mean(self, seconds: float) -> float:
        """Variance of a mean over a time that is long against the correlation."""
        return self.sigma**2 * 2.0 * self.correlation_s / seconds

    def share_of_mean(self, n: int) -> float:
        """Variance of the mean of ``n`` samples over that of a sample."""
        lags = np.arange(1, n)
        return (1.0 + 2.0 * float(np.sum((1.0 - lags / n) * self.autocorrelation**lags))) / n


WHITE = Noise()


def _second_power(kept: float | FloatArray) -> float | FloatArray:
    """Power of the second difference of samples next to which a share is kept, in variances of a sample."""
    return 6.0 - 8.0 * kept + 2.0 * kept**2


def _table() -> tuple[FloatArray, FloatArray]:
    times_s = np.linspace(TICK_S, LONGEST_S, 50)
    kept = np.exp(-TICK_S / times_s)
    return 2.0 * (1.0 - kept**_FAR) / _second_power(kept), times_s


_RATIOS, _TIMES_S = _table()


def _power(changes: FloatArray) -> float:
    """Variance of changes, from the median of their size, so that steps do not count, nor a slope."""
    return (1.4826 * float(np.median(np.abs(changes - np.median(changes))))) ** 2


def noise_of(values: FloatArray) -> Noise:
    """The noise on a slow signal, white unless it is plainly coloured.

    Second differences over one and three samples tell whether it is coloured, whatever else the signal does. How long
    it is correlated follows from the changes over five seconds: another swing in the signal makes that longer.
    """
    if values.size < round(_LEAST_S / TICK_S):
        return WHITE
    near = _power(values[2:] - 2.0 * values[1:-1] + values[:-2])
    if near <= 0.0 or _power(values[6:] - 2.0 * values[3:-3] + values[:-6]) < _COLOURED * near:
        return WHITE
    far = _power(values[_FAR:] - values[:-_FAR])
    correlation_s = float(np.interp(far / near, _RATIOS, _TIMES_S))
    return Noise(sqrt(near / float(_second_power(exp(-TICK_S / correlation_s)))), correlation_s)


class NoiseWatch:
    """The noise of a residual, from the begin of a weld."""

    def __init__(self) -> None:
        self._values: list[float] = []
        self.noise = WHITE

    def push(self, residual: float) -> None:
        """Take a residual, while it is learnt."""
        self._values.append(residual)

    def learn(self) -> None:
        """Look at what there is."""
        self.noise = noise_of(np.array(self._values))
