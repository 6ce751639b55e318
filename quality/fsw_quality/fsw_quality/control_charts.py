"""Self-starting control charts over a series of welds, and a trend with its interval.

Each weld is compared with the accepted welds before it. Its distance from their mean, over their
spread, has Student's distribution; as a normal score it is independent of the earlier ones (C. P.
Quesenberry: SPC Q charts for start-up processes, J. Quality Technology 23, 1991). Shewhart and
CUSUM charts are of these scores (D. M. Hawkins: Self-starting CUSUM charts for location and scale,
The Statistician 36, 1987). Their limits follow from a probability of false signals by a Markov
chain (D. Brook, D. A. Evans: An approach to the probability distribution of CUSUM run length,
Biometrika 59, 1972).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import copysign, exp, nan, sqrt

import numpy as np
import scipy
from scipy.special import ndtr, ndtri, stdtr, stdtrit

from fsw_analysis.weld_signals import FloatArray

#: chosen: share of histories of so many stable welds with a false signal, in any chart of any
#: quantity
FALSE_SIGNALS, WELDS = 0.05, 200
#: chosen: what of each score the CUSUM leaves out, half of the shift that it detects soonest
SLACK = 0.5
#: values of the CUSUM that the Markov chain distinguishes; twice as many change its limit by 0.001
_CELLS = 200
#: chosen: welds before the first that is judged; of fewer, rounded values may all be equal but for
#: one
LEAST_WELDS = 5
#: spread below which values are equal but for rounding, as a share of their mean
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of the charts, in standard deviations."""

    shewhart: float
    cusum: float

    def quiet(self, welds: int) -> float:
        """Probability that one side's charts do not signal in so many stable welds."""
        quiet, transitions = np.ones(_CELLS), self._transitions(0.0)
        for _ in range(welds):
            quiet = transitions @ quiet
        return float(quiet[0])

    def run_length(self, shift: float = 0.0) -> float:
        """Mean number of welds until a chart signals a shift by so many sigma (ARL)."""
        sides = (
            np.linalg.solve(np.eye(_CELLS) - self._transitions(side), np.ones(_CELLS))[0]
            for side in (shift, -shift)
        )
        return float(1.0 / sum(1.0 / side for side in sides))

    def _transitions(self, shift: float) -> FloatArray:
        """Transition probabilities of the CUSUM between cells without a signal, (cells, cells)."""
        cells = np.arange(_CELLS)
        edge = self.cusum / (_CELLS - 0.5) * (cells - cells[:, None] + 0.5) + SLACK
        below: FloatArray = ndtr(np.minimum(edge, self.shewhart) - shift)
        return np.diff(below, axis=1, prepend=0.0)


@cache
def limits(quantities: int) -> Limits:
    """Limits with which any quantity signals falsely in ``FALSE_SIGNALS`` of ``WELDS`` welds.

    Shewhart and CUSUM have half of it each. The quantities count as independent: if they are not,
    it is less.
    """
    quiet = (1.0 - FALSE_SIGNALS) ** (0.5 / quantities)
    shewhart = -float(ndtri(1.0 - quiet ** (0.5 / WELDS)))
    cusum = scipy.optimize.brentq(
        lambda limit: Limits(shewhart, limit).quiet(WELDS) - quiet, 1.0, 50.0
    )
    return Limits(shewhart, float(cusum))


@dataclass(frozen=True, slots=True)
class Chart:
    """A quantity over the welds; arrays have shape (n,), NaN where something is not known."""

    values: FloatArray
    limits: Limits
    #: welds at which each chart signals: ``shewhart``, ``cusum``
    signals: dict[str, list[int]]
    scores: FloatArray  #: distance from the welds before, in standard deviations
    centre: FloatArray  #: mean of the welds before, of a skewed quantity that of its logarithms
    low: FloatArray  #: limits of the Shewhart chart, in the unit of the quantity
    high: FloatArray
    rise: FloatArray  #: CUSUM upwards and downwards, in standard deviations
    fall: FloatArray


@dataclass(slots=True)
class _Baseline:
    """Accepted welds so far (Welford's sums), and the CUSUM."""

    welds: int = 0
    mean: float = 0.0
    squares: float = 0.0
    rise: float = 0.0
    fall: float = 0.0

    def learn(self, value: float) -> None:
        self.welds += 1
        change = value - self.mean
        self.mean += change / self.welds
        self.squares += change * (value - self.mean)

    def spread(self, least: float) -> float:
        """Standard deviation of the next weld from the mean; zero if that cannot be said."""
        if self.welds < LEAST_WELDS:
            return 0.0
        sigma = max(sqrt(self.squares / (self.welds - 1)), least)
        return sigma * sqrt(1.0 + 1.0 / self.welds) if sigma > _ROUNDING * abs(self.mean) else 0.0

    def count(self, score: float) -> None:
        """Add a score to the CUSUM."""
        self.rise, self.fall = (
            max(0.0, self.rise + score - SLACK),
            max(0.0, self.fall - score - SLACK),
        )


def chart(
    values: FloatArray,
    charts: Limits,
    least: float = 0.0,
    skewed: bool = False,
    accepted: Sequence[bool] | None = None,
    groups: Sequence[object] | None = None,
) -> Chart | None:
    """Chart a quantity by weld; None if no weld has ``LEAST_WELDS`` others to be compared with.

    Parameters
    ----------
    values : FloatArray
        By weld; NaN where it is not known.
    charts : Limits
        Of the charts.
    least : float
        Smallest standard deviation that counts.
    skewed : bool
        Compare ``log(1 + value / least)``: of quantities that cannot be negative and have a long
        tail.
    accepted : sequence of bool, optional
        Which welds say what is normal, if their chart does not signal; all by default.
    groups : sequence, optional
        What each weld is compared within, e.g. its tool: a new one begins a new chart.
    """
    scaled = np.log1p(np.maximum(values, 0.0) / least) if skewed else values
    made = Chart(values, charts, {"shewhart": [], "cusum": []}, *np.full((6, values.size), np.nan))
    baselines: dict[object, _Baseline] = {}
    for i in np.flatnonzero(np.isfinite(values)).tolist():
        baseline = baselines.setdefault(groups[i] if groups is not None else None, _Baseline())
        value = float(scaled[i])
        signals = _judge(made, i, value, baseline, exp(-baseline.mean) if skewed else least)
        if not signals and (accepted is None or accepted[i]):
            baseline.learn(value)
    if skewed:
        for limit in (made.centre, made.low, made.high):
            limit[:] = least * np.expm1(np.minimum(limit, 700.0))
    return made if np.isfinite(made.scores).any() else None


def _judge(made: Chart, i: int, value: float, baseline: _Baseline, least: float) -> bool:
    """Note score, limits and CUSUM of a weld; returns whether a chart signals."""
    spread = baseline.spread(least)
    if not spread:
        return False
    freedom, off = baseline.welds - 1, (value - baseline.mean) / spread
    made.scores[i] = score = copysign(-float(ndtri(stdtr(freedom, -abs(off)))), off)
    half = -float(stdtrit(freedom, ndtr(-made.limits.shewhart))) * spread
    made.centre[i], made.low[i], made.high[i] = (
        baseline.mean,
        baseline.mean - half,
        baseline.mean + half,
    )
    if abs(score) > made.limits.shewhart:  # the CUSUM leaves it out: a single weld is no shift
        made.signals["shewhart"].append(i)
    else:
        baseline.count(score)
    made.rise[i], made.fall[i] = baseline.rise, baseline.fall
    if max(baseline.rise, baseline.fall) > made.limits.cusum:
        made.signals["cusum"].append(i)
    return any(at[-1:] == [i] for at in made.signals.values())


def correlation(
    made: Chart, quantities: int, groups: Sequence[object] | None = None
) -> tuple[float, bool]:
    """Correlation from weld to weld, and whether it is significant, so that no limit holds.

    The mean square of the differences over two welds is 1 + correlation times that over one (after
    J. von Neumann: Distribution of the ratio of the mean square successive difference to the
    variance, Ann. Math. Stat. 12, 1941). Differences hardly contain a shift or slow wear. Any of
    so many independent quantities is significant in ``FALSE_SIGNALS`` of histories at most.
    """
    by_group: dict[object, list[float]] = {}
    for i in np.flatnonzero(np.isfinite(made.scores)).tolist():
        by_group.setdefault(groups[i] if groups is not None else None, []).append(made.scores[i])
    scores = list(map(np.array, by_group.values()))
    squares = [
        np.concatenate([(entry[lag:] - entry[:-lag]) ** 2 for entry in scores]) for lag in (1, 2)
    ]
    if not squares[1].size or not squares[0].any():
        return nan, False
    ratio = float(squares[1].mean() / squares[0].mean())
    limit = exp(-sqrt(2.0 / squares[1].size) * float(ndtri(FALSE_SIGNALS / quantities)))
    return ratio - 1.0, ratio > limit


@dataclass(frozen=True, slots=True)
class Trend:
    """A straight line through a tool's welds, and when it reaches a limit."""

    per_weld: float
    interval: tuple[float, float]  #: of the slope, 95 %
    #: welds since the tool was new at which the limit is reached: soonest, expected, latest;
    #: infinite without a trend
    life: tuple[float, float, float]

    @property
    def significant(self) -> bool:
        """Whether the slope is one."""
        return self.interval[0] > 0.0 or self.interval[1] < 0.0


def trend(values: FloatArray, rise: float) -> Trend | None:
    """Least squares line through values by weld, and where it has risen by ``rise``.

    None with fewer than five.

    The interval of the slope is Student's; that of the life follows from it, from the middle of
    the welds on.
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
