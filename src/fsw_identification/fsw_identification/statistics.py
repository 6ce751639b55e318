"""Figures by which a fit is judged: share explained, whiteness of the residuals, correlation with the inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fsw_analysis.weld_signals import FloatArray, IntArray
from fsw_identification.weld_data import Segment

#: lags at which residuals are judged [ticks]
LAGS = 50
#: quantile of the normal distribution for bounds of 99 %
QUANTILE_99 = 2.576


def fit_percent(measured: Sequence[FloatArray], residuals: Sequence[FloatArray]) -> float:
    """Share of an output that a model explains, 100 (1 - |residual| / |measured - mean|) in percent (NRMSE)."""
    known = [np.isfinite(one) for one in residuals]
    of = np.concatenate([m[k] for m, k in zip(measured, known, strict=True)])
    rest = np.concatenate([r[k] for r, k in zip(residuals, known, strict=True)])
    spread = float(np.linalg.norm(of - of.mean())) if of.size else 0.0
    return 100.0 * (1.0 - float(np.linalg.norm(rest)) / spread) if spread > 0.0 else float("nan")


def correlation(first: Sequence[FloatArray], second: Sequence[FloatArray], lags: IntArray) -> tuple[FloatArray, int]:
    """Correlation of ``first[k + lag]`` with ``second[k]`` over all segments, and the number of pairs at lag 0.

    Missing samples (NaN) are left out.
    """
    mean_a, mean_b = (float(np.nanmean(np.concatenate(of))) for of in (first, second))
    products, counts = np.zeros(lags.size), np.zeros(lags.size)
    power_a, power_b, pairs = 0.0, 0.0, 0.0
    for one, other in zip(first, second, strict=True):
        known_a, known_b = np.isfinite(one), np.isfinite(other)
        a, b = np.where(known_a, one - mean_a, 0.0), np.where(known_b, other - mean_b, 0.0)
        power_a, power_b, pairs = (
            power_a + float(a @ a),
            power_b + float(b @ b),
            pairs + float((known_a & known_b).sum()),
        )
        for i, lag in enumerate(lags):
            low, high = max(0, -lag), min(a.size, b.size, a.size - lag)
            if high > low:
                products[i] += a[low + lag : high + lag] @ b[low:high]
                counts[i] += float((known_a[low + lag : high + lag] & known_b[low:high]).sum())
    n_first = sum(float(np.isfinite(one).sum()) for one in first)
    n_second = sum(float(np.isfinite(one).sum()) for one in second)
    scale = np.sqrt(power_a / max(n_first, 1.0) * power_b / max(n_second, 1.0))
    with np.errstate(all="ignore"):
        return np.nan_to_num(products / counts / scale), int(pairs)


def long_run_factor(residuals: Sequence[FloatArray]) -> float:
    """Variance of a mean of residuals over that of white noise; 1 unless they are clearly not white.

    The first lags of the autocorrelation whose size is beyond the bounds of 99 % count.
    """
    if sum(int(np.isfinite(one).sum()) for one in residuals) < 2 * LAGS:
        return 1.0
    found, n = correlation(residuals, residuals, np.arange(1, LAGS + 1))
    inside = np.abs(found) < QUANTILE_99 / np.sqrt(n)
    last = int(np.argmax(inside)) if inside.any() else LAGS
    return max(1.0, 1.0 + 2.0 * float(found[:last].sum()))


@dataclass(frozen=True, slots=True)
class Judgement:
    """What the residuals of a fit say.

    Attributes
    ----------
    fit_percent : tuple of 3 float
        NRMSE of each output.
    bound : float
        Size that a correlation of white noise exceeds at one lag in a hundred.
    auto : (3, LAGS) array
        Autocorrelation of each output's residuals, from lag 1 on.
    cross : (3, 2, 2 LAGS + 1) array
        Correlation of each output's residuals with the changes of force and speed, from lag -LAGS on.
    """

    fit_percent: tuple[float, ...]
    bound: float
    auto: FloatArray
    cross: FloatArray

    def outside(self, output: int) -> tuple[float, float]:
        """Shares of the lags of autocorrelation and cross-correlation that are beyond the bound; expected: 0.01.

        At lags up to 0 a controller that feeds the noise back correlates it with the inputs, which is no fault of the
        model: only inputs of the past count.
        """
        auto = np.abs(self.auto[output]) > self.bound
        cross = np.abs(self.cross[output, :, LAGS + 1 :]) > self.bound
        return float(auto.mean()), float(cross.mean())


def judge(segments: Sequence[Segment], residuals: Sequence[FloatArray]) -> Judgement:
    """Judge residuals, one (n, 3) array for each segment."""
    auto, cross = np.zeros((3, LAGS)), np.zeros((3, 2, 2 * LAGS + 1))
    both = np.arange(-LAGS, LAGS + 1)
    n = 1
    changes = [[np.diff(of, prepend=of[0]) for of in (one.force_kn, one.speed_rpm)] for one in segments]
    fits = []
    for output in range(3):
        own = [one[:, output] for one in residuals]
        fits.append(fit_percent([one.measured[:, output] for one in segments], own))
        if not any(np.isfinite(one).any() for one in own):
            continue
        auto[output], n = correlation(own, own, np.arange(1, LAGS + 1))
        for which in range(2):
            cross[output, which], _ = correlation(own, [one[which] for one in changes], both)
    return Judgement(tuple(fits), QUANTILE_99 / np.sqrt(max(n, 1)), auto, cross)
