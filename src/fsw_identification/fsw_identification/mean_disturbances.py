"""What the slow disturbances of a solved :class:`~fsw_identification.problem.Problem` are on the whole."""

from __future__ import annotations

import numpy as np

from fsw_analysis.weld_signals import FloatArray
from fsw_identification.problem import Problem
from fsw_identification.simulation import TEMPERATURE, TORQUE


def mean_disturbance(problem: Problem, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(2,): mean disturbances of force and power, and their standard deviations; ``covariance`` of the border."""
    parts = problem.linearised(problem.parameters, True)
    means, variances, by_border = np.zeros(2), np.zeros(2), np.zeros((2, len(covariance)))
    total = sum(segment.n_ticks for segment in problem.segments)
    for part, one in zip(parts, problem.eliminate(parts, True)[1], strict=True):
        if part.output != TORQUE:
            weights = np.zeros(part.at_knots.shape)
            weights[:, -2] = problem.segments[part.segment].n_ticks / total / len(weights)
            means[part.output] += float((weights * part.at_knots).sum())
            by_border[part.output] -= np.einsum("kp,kpb->b", weights, one.values[:, :, 1:])
            variances[part.output] += one.variance(weights)
    return means, np.sqrt(variances + np.einsum("ib,bc,ic->i", by_border, covariance, by_border))


def heat_and_offset(problem: Problem) -> float:
    """Correlation of heat and offset of the temperature: of their mean rises since the beginning."""
    parts = problem.linearised(problem.parameters, False)
    variances = np.zeros(3)
    for part, one in zip(parts, problem.eliminate(parts, False)[1], strict=True):
        if part.output == TEMPERATURE:
            both = np.zeros((2, *one.values.shape[:2]))
            for which, weights in enumerate(both):
                weights[:, which - 2] = 1.0 / len(weights)
                weights[0, which - 2] -= 1.0
            both[0] *= problem.parameters.thermal_gain_c_per_kw
            variances += [one.variance(weights) for weights in (*both, both.sum(axis=0))]
    heat, offset, together = variances
    return float((together - heat - offset) / (2.0 * np.sqrt(heat * offset)))
