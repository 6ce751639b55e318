"""Covariance of an estimate, robust to coloured noise (Newey and West, Econometrica 1987)."""

from __future__ import annotations

import numpy as np

from fsw_analysis.weld_signals import FloatArray
from fsw_identification.problem import Problem
from fsw_identification.simulation import KNOT_TICKS, shown

#: lags of the scores' correlation that count, with weights decreasing linearly to 0; beyond it the
#: noise counts as a slow disturbance
_WINDOW_TICKS = KNOT_TICKS


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
