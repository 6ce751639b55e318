"""Figures of a fit's quality, and the colour of the noise that its intervals allow for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fsw_analysis.weld_signals import FloatArray, IntArray
from fsw_control.weld import TICK_S
from fsw_identification.simulation import KNOT_TICKS
from fsw_identification.weld_data import Segment

#: lags at which residuals are tested [ticks]
LAGS = 50
#: correlation of two estimates above which they are reported as identifiable only together
CORRELATED = 0.9
#: normal quantile for bounds of 99 %
_QUANTILE = 2.576
#: sum of the autocorrelations over all ``LAGS``, in standard deviations, above which residuals are
#: not white: a slow component that no single lag shows
SLOW = 3.0

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
    return np.asarray([-TICK_S / np.log(auto) if auto > 0.0 else 0.0 for auto in autocorrelation])


def fit_percent(measured: Sequence[FloatArray], residuals: Sequence[FloatArray]) -> float:
    """Share of an output that a model explains, 100 (1 - |residual| / |measured - mean|) [%]."""
    everything = np.column_stack([np.concatenate(measured), np.concatenate(residuals)])
    shown, rest = everything[np.isfinite(everything[:, 1])].T
    spread = float(np.linalg.norm(shown - shown.mean())) if shown.size else 0.0
    return 100.0 * (1.0 - float(np.linalg.norm(rest)) / spread) if spread > 0.0 else float("nan")


def correlation(
    first: Sequence[FloatArray], second: Sequence[FloatArray], lags: IntArray
) -> tuple[FloatArray, int]:
    """Correlation of ``first[k + lag]`` with ``second[k]`` over all segments; pairs at lag 0.

    Missing samples (NaN) are left out.
    """
    whole = [np.concatenate(columns) for columns in (first, second)]
    means, scale = (
        [float(np.nanmean(column)) for column in whole],
        np.prod([np.nanstd(column) for column in whole]),
    )
    products, counts, pairs = np.zeros(lags.size), np.zeros(lags.size), 0
    for left, right in zip(first, second, strict=True):
        known = [np.isfinite(column) for column in (left, right)]
        a, b = (
            np.nan_to_num(column - mean) for column, mean in zip((left, right), means, strict=True)
        )
        # all lags at once; the same with the masks counts the pairs of each lag
        inside = np.abs(lags) < a.size
        at = lags[inside] + a.size - 1
        products[inside] += scipy.signal.correlate(a, b)[at]
        counts[inside] += np.rint(
            scipy.signal.correlate(known[0].astype(float), known[1].astype(float))
        )[at]
        pairs += int((known[0] & known[1]).sum())
    with np.errstate(all="ignore"):
        return np.nan_to_num(products / counts / scale), pairs


def long_run_factor(residuals: Sequence[FloatArray]) -> float:
    """Variance of a mean of residuals relative to white noise; 1 unless they are clearly coloured.

    The first lags of the autocorrelation that exceed the 99 % bounds count; all lags if their sum
    exceeds its own.
    """
    if sum(int(np.isfinite(part).sum()) for part in residuals) < 2 * LAGS:
        return 1.0
    lagged, n = correlation(residuals, residuals, np.arange(1, LAGS + 1))
    # Var(mean) = sigma^2 / n (1 + 2 sum of the autocorrelations). Those of white noise are not
    # exactly 0 when estimated, so that only those that stand out count.
    inside = np.abs(lagged) < _QUANTILE / np.sqrt(n)
    last = int(np.argmax(inside)) if inside.any() else LAGS
    together = lagged.sum() if lagged.sum() > SLOW * np.sqrt(LAGS / n) else 0.0
    return 1.0 + 2.0 * max(0.0, float(lagged[:last].sum()), float(together))


@dataclass(frozen=True, slots=True)
class Judgement:
    """Statistics of the residuals of a fit."""

    fit_percent: tuple[float, ...]  #: NRMSE of each output
    bound: float  #: size that a correlation of white noise exceeds at one lag in a hundred
    #: (3, LAGS): autocorrelation of each output's whitened residuals, from lag 1 on
    auto: FloatArray
    #: (3, 2, 2 LAGS + 1): correlation of the whitened residuals with the changes of force and
    #: speed, from lag -LAGS on
    cross: FloatArray

    def outside(self, output: int) -> tuple[float, float]:
        """Shares of auto- and cross-correlation lags beyond the bound; expected: 0.01.

        At lags up to 0 a controller that feeds the noise back correlates it with the inputs, which
        is no fault of the model: only inputs of the past count.
        """
        auto = np.abs(self.auto[output]) > self.bound
        cross = np.abs(self.cross[output, :, LAGS + 1 :]) > self.bound
        return float(auto.mean()), float(cross.mean())

    def together(self, output: int) -> float:
        """Sum of the autocorrelations, in standard deviations of that of white noise."""
        return float(self.auto[output].sum() / np.sqrt(LAGS) / (self.bound / _QUANTILE))


def judge(
    segments: Sequence[Segment], residuals: Sequence[FloatArray], whitened: Sequence[FloatArray]
) -> Judgement:
    """Test residuals, an (n, 3) array per segment, against the assumed noise (whitened)."""
    auto, cross, n, fits = np.zeros((3, LAGS)), np.zeros((3, 2, 2 * LAGS + 1)), 1, []
    changes = [
        [np.diff(column, prepend=column[0]) for column in (segment.force_kn, segment.speed_rpm)]
        for segment in segments
    ]
    for output in range(3):
        left = [part[:, output] for part in residuals]
        fits.append(fit_percent([segment.measured[:, output] for segment in segments], left))
        own = [part[:, output] for part in whitened]
        if any(np.isfinite(part).any() for part in own):
            auto[output], n = correlation(own, own, np.arange(1, LAGS + 1))
            for which in range(2):
                inputs = [pair[which] for pair in changes]
                cross[output, which], _ = correlation(own, inputs, np.arange(-LAGS, LAGS + 1))
    return Judgement(tuple(fits), _QUANTILE / np.sqrt(max(n, 1)), auto, cross)
