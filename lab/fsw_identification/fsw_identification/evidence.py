"""Choices by the evidence: size of the random walks, colour of the noise, thermocouple lag.

The evidence is the marginal likelihood with knots and border integrated out (MacKay 1992): it
rewards the fit and penalises freedom, so that a walk does not absorb what the model explains.
What the chosen colour of the noise leaves, the covariance of the estimate allows for (Newey and
West, Econometrica 1987).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from fsw_analysis.weld_signals import FloatArray
from fsw_identification.elimination import Eliminated
from fsw_identification.problem import STATE_PRIOR, WALK, WALKS_OF, Part, Problem
from fsw_identification.simulation import KNOT_TICKS, OUTPUTS, shown
from fsw_identification.statistics import autocorrelation_of

#: largest factor on the size of a walk per iteration
_WALK_STEP = 4.0
#: evidence that a disturbance has to add before its size may be e times the smallest
_PARSIMONY = 4.0
#: shortest and longest correlation time of the noise [s]
_CORRELATION_S = (0.02, 30.0)
#: lags of the scores' correlation that count, with weights decreasing linearly to 0; beyond it the
#: noise counts as a slow disturbance
_WINDOW_TICKS = KNOT_TICKS


def _evidence_of(problem: Problem, border: FloatArray, parts: Sequence[Eliminated]) -> float:
    """Minus twice the log evidence, up to a constant, at the parameters and best shifts."""
    # Laplace's approximation, exact here for the linear unknowns: the cost at the best shifts plus
    # the log determinants of everything that is integrated out (border and knots).
    n = 1 + len(problem.free)
    cost = border[0, 0] - border[n:, 0] @ np.linalg.solve(border[n:, n:], border[n:, 0])
    cost += 2.0 * np.log(problem.lag_deviation_s)
    cost += np.linalg.slogdet(problem.prior_covariance)[1]
    return float(cost + np.linalg.slogdet(border[1:, 1:])[1] + sum(part.logdet for part in parts))


def likely_walk(problem: Problem, parts: Sequence[Part]) -> FloatArray:
    """Sizes of the random walks with the largest evidence, by coordinate search."""
    best_walk: FloatArray = problem.walk.copy()

    def of_size(log_size: float, of_output: list[Part], at: tuple[int, int]) -> float:
        sizes = best_walk.copy()
        sizes[at] = np.exp(log_size)
        return (
            _evidence_of(problem, *problem.eliminate(of_output, True, sizes))
            + _PARSIMONY * log_size
        )

    # One walk after the other, by output, as the parts of other outputs do not depend on it;
    # a tenth of an e-fold is as near as the next linearisation needs.
    for output, which in enumerate(WALKS_OF):
        of_output = [part for part in parts if part.output == output]
        for at in ((i, walk) for walk in which for i in range(2)):
            bounds = np.clip(
                np.log(best_walk[at]) + np.log(_WALK_STEP) * np.array([-1, 1]),
                *np.log(WALK[::2, *at]),
            )
            best = scipy.optimize.minimize_scalar(
                of_size,
                args=(of_output, at),
                method="bounded",
                bounds=bounds,
                options={"xatol": 0.1},
            )
            best_walk[at] = np.exp(best.x)
    return best_walk


def take_likely_colour(problem: Problem, parts: Sequence[Part]) -> None:
    """Set the correlation of each output's noise to that with the largest evidence."""
    for output in range(len(OUTPUTS)):
        of_output = [part for part in parts if part.output == output]

        # A change of the correlation changes the whitening, and with it the noise and all columns
        # of the output: the compressed parts have to be made again for each trial.
        def take(log_s: float, output: int = output, of_output: list[Part] = of_output) -> float:
            problem.autocorrelation[output] = autocorrelation_of(np.exp(log_s))
            problem.take_noise(output)
            for part in of_output:
                problem.compress(part)
            return _evidence_of(problem, *problem.eliminate(of_output, True)) + of_samples(
                problem, output
            )

        bounds = np.log(_CORRELATION_S)
        take(
            scipy.optimize.minimize_scalar(
                take, method="bounded", bounds=bounds, options={"xatol": 0.1}
            ).x
        )


def evidence(problem: Problem) -> float:
    """Minus twice the log evidence at the last solution, up to a constant."""
    parts = problem.linearised(problem.parameters, True)
    total = _evidence_of(problem, *problem.eliminate(parts, True))
    # a lagging thermocouple is another state
    total += sum(
        2.0 * float(np.log(STATE_PRIOR[p.output][: p.response.gains.size]).sum()) for p in parts
    )
    return total + sum(of_samples(problem, output) for output in range(len(OUTPUTS)))


def of_samples(problem: Problem, output: int) -> float:
    """Contribution of an output's sample density to minus twice the log evidence."""
    total = 0.0
    for i, weights in enumerate(problem.weights):
        scale = problem.whitening(i, output).scale[weights[:, output] > 0.0]
        total += 2.0 * float(np.log(problem.noise[output] / scale).sum())
    return total


def likely_colour(problem: Problem) -> FloatArray:
    """(3,): most likely autocorrelation of the noise at a solution, which is not changed."""
    trial = problem.variant(
        autocorrelation=problem.autocorrelation.copy(), noise=problem.noise.copy()
    )
    take_likely_colour(trial, trial.linearised(trial.parameters, True))
    return trial.autocorrelation


def likely_lag(problem: Problem) -> tuple[float, float]:
    """Thermocouple lag suggested by the depth, and its standard deviation.

    Computed at a solution without lag, which is not changed.
    """
    # A single Gauss-Newton step from lag 0, which decides whether a full solution is tried.
    border, _ = problem.variant(lagged=True).eliminate(
        problem.linearised(problem.parameters, True), True
    )
    covariance = np.linalg.inv(border[1:, 1:])
    return float(covariance[-1] @ border[1:, 0]), float(np.sqrt(covariance[-1, -1]))


def long_run_covariance(problem: Problem) -> FloatArray:
    """(border, border): covariance of free parameters, shifts, share and lag at a solution.

    The information of the samples is replaced by the long-run variance of their scores (slopes
    after elimination of the knots, times residuals): the sandwich estimator. The prior's stays.
    """
    parts = problem.linearised(problem.parameters, True)
    border, eliminated = problem.eliminate(parts, True)
    inverse = np.linalg.inv(border[1:, 1:])
    scores = border[1:, 1:].copy()
    for part, unknowns in zip(parts, eliminated, strict=True):
        by_knots = unknowns.values()[:, :, 1:]
        response = part.response._replace(course=np.zeros(len(part.columns)))
        slopes = [
            column - shown(response, part.walk, by_knots[:, :, i])
            for i, column in enumerate(part.columns.T[1:])
        ]
        i, output = part.segment, part.output
        scale = np.sqrt(problem.weights[i][:, output]) / problem.noise[output]
        rows = (
            np.column_stack([problem.whitening(i, output).of(slope) for slope in slopes])
            * scale[:, None]
        )
        residuals = np.nan_to_num(problem.whitened[i][:, output]) * scale
        # For white noise both terms cancel in the mean: the covariance is the inverse.
        scores += _long_run(rows * residuals[:, None]) - rows.T @ rows
    return np.asarray(inverse @ scores @ inverse)


def _long_run(scores: FloatArray) -> FloatArray:
    """(n, any): sum of lagged products with Bartlett weights, as sums over a moving window."""
    # The sum over all windows of (window sum) (window sum)' counts a pair at distance d in
    # window - d windows: exactly Bartlett's weights, without a loop over the lags.
    padded = np.pad(scores, ((_WINDOW_TICKS, _WINDOW_TICKS - 1), (0, 0)))
    sums = np.cumsum(padded, axis=0)
    moving = sums[_WINDOW_TICKS:] - sums[:-_WINDOW_TICKS]
    return np.asarray(moving.T @ moving / _WINDOW_TICKS)
