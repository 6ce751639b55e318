"""Statistical process control over a series of welds: Shewhart, EWMA and CUSUM charts, and a trend with its interval.

Montgomery, Introduction to Statistical Quality Control: individuals with moving ranges (6.4), CUSUM (9.1), EWMA (9.2).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
import scipy

from fsw_analysis.weld_signals import FloatArray

#: welds whose spread is the normal one, at most; fewer of a short history
BASELINE = 20
#: chosen, as in Montgomery: weight and width of the EWMA, slack and limit of the CUSUM, in standard deviations
EWMA_WEIGHT, EWMA_WIDTH = 0.2, 2.86
CUSUM_SLACK, CUSUM_LIMIT = 0.5, 5.0
SHEWHART_WIDTH = 3.0


@dataclass(frozen=True, slots=True)
class Chart:
    """A quantity over the welds; arrays have shape (n,), NaN where it is not known."""

    values: FloatArray
    centre: float
    sigma: float
    ewma: FloatArray  #: NaN for the first welds, as ``high`` and ``low``
    high: FloatArray  #: CUSUM upwards, in standard deviations
    low: FloatArray
    #: welds at which each chart signals: ``shewhart``, ``ewma``, ``cusum``
    signals: dict[str, list[int]]


def chart(values: FloatArray, least_sigma: float = 0.0) -> Chart | None:
    """Charts of a quantity, whose normal mean and spread are those of the first welds.

    EWMA and CUSUM begin after those. Among them a weld signals only if it is off their own trend: a tool wears from the
    first weld on. None with fewer than five known values, or without any spread. ``least_sigma`` is the smallest spread
    that counts.
    """
    known = np.flatnonzero(np.isfinite(values))
    if known.size < 5:
        return None
    first = known[: max(5, min(BASELINE, known.size // 2))]
    normal = values[first]
    # the medians are not moved by a weld among the normal ones that is not
    centre = float(np.median(normal))
    sigma = max(float(np.median(np.abs(np.diff(normal)))) / 0.954, least_sigma)
    if sigma <= 0.0:
        return None
    scaled = (values - centre) / sigma
    line = scipy.stats.theilslopes(normal, first)  # as robust as the medians
    scaled[first] = (normal - line.intercept - line.slope * first) / sigma
    ewma, high, low = (np.full(values.size, np.nan) for _ in range(3))
    smooth = up = down = 0.0
    found: dict[str, list[int]] = {"shewhart": [], "ewma": [], "cusum": []}
    width = EWMA_WIDTH * sqrt(EWMA_WEIGHT / (2.0 - EWMA_WEIGHT))
    for i in known.tolist():
        z = float(scaled[i])
        if abs(z) > SHEWHART_WIDTH:
            found["shewhart"].append(i)
        if i <= first[-1]:
            continue
        smooth += EWMA_WEIGHT * (z - smooth)
        up, down = max(0.0, up + z - CUSUM_SLACK), max(0.0, down - z - CUSUM_SLACK)
        ewma[i], high[i], low[i] = centre + sigma * smooth, up, down
        if abs(smooth) > width:
            found["ewma"].append(i)
        if max(up, down) > CUSUM_LIMIT:
            found["cusum"].append(i)
    return Chart(values, centre, sigma, ewma, high, low, found)


@dataclass(frozen=True, slots=True)
class Trend:
    """A straight line through a tool's welds, and when it reaches a limit."""

    per_weld: float
    interval: tuple[float, float]  #: of the slope, 95 %
    #: welds since the tool was new at which the limit is reached: soonest, expected, latest; infinite without a trend
    life: tuple[float, float, float]

    @property
    def significant(self) -> bool:
        """Whether the slope is one."""
        return self.interval[0] > 0.0 or self.interval[1] < 0.0


def trend(values: FloatArray, rise: float) -> Trend | None:
    """Least squares line through values by weld, and where it has risen by ``rise``; None with fewer than five.

    The interval of the slope is Student's; that of the life follows from it, from the middle of the welds on.
    """
    known = np.flatnonzero(np.isfinite(values))
    if known.size < 5:
        return None
    line = scipy.stats.linregress(known.astype(np.float64), values[known])
    half = float(scipy.stats.t.ppf(0.975, known.size - 2)) * float(line.stderr)
    slope = float(line.slope)
    middle = float(known.mean())
    left = rise - slope * middle

    def reached(per_weld: float) -> float:
        return middle + left / per_weld if per_weld > 0.0 else float("inf")

    life = (reached(slope + half), reached(slope), reached(slope - half))
    return Trend(slope, (slope - half, slope + half), life)
