"""Correlated sensor noise: a first-order Gauss-Markov process n' = a n + e, white if a is 0.

Whitening subtracts from each sample its prediction from the previous one, in units of e, like the
rows of the least-squares problem.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fsw_analysis.weld_signals import FloatArray, IntArray
from fsw_control.weld import TICK_S
from fsw_identification.simulation import KNOT_TICKS

#: noise with a shorter correlation time counts as white [s]
WHITE_S = 0.05


class Whitening(NamedTuple):
    """Whitening of an output's samples: ``scale (sample - share previous sample)``, (n,) each."""

    before: IntArray  #: tick of the previous sample
    share: FloatArray
    scale: FloatArray

    def of(self, values: FloatArray) -> FloatArray:
        """Whitened values."""
        return np.asarray(self.scale * (values - self.share * values[self.before]))


def whitening(known: NDArray[np.bool_], autocorrelation: float) -> Whitening:
    """Whitening of ``known`` samples whose noise has this ``autocorrelation`` per tick.

    The previous sample may be several ticks ago, but not beyond a knot: it then counts as missing.
    """
    at = np.arange(known.size)
    last = np.maximum.accumulate(np.where(known, at, -1))
    before = np.concatenate([[-1], last[:-1]])
    none = before < (at - 1) // KNOT_TICKS * KNOT_TICKS
    none[:1] = True
    before = np.where(none, at, before)
    share = np.where(none, 0.0, autocorrelation ** (at - before))
    return Whitening(before, share, np.sqrt((1.0 - autocorrelation**2) / (1.0 - share**2)))


def autocorrelation_of(correlation_s: float) -> float:
    """Autocorrelation from tick to tick."""
    return float(np.exp(-TICK_S / correlation_s))


def correlation_s(autocorrelation: FloatArray) -> FloatArray:
    """Time for the autocorrelation to decay to 1/e; 0 for white noise."""
    return np.asarray([-TICK_S / np.log(one) if one > 0.0 else 0.0 for one in autocorrelation])
