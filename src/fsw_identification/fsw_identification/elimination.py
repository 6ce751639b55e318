"""Normal equations of one output of one segment; what is unknown at the knots is eliminated by banded factorisation.

The unknowns are values at the knots, each coupled to the next by the data between them and by the random walk; and a
few others, on which all samples may depend: the border.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from fsw_analysis.weld_signals import FloatArray
from fsw_identification.simulation import KNOT_TICKS, Walks

#: the states at two knots fit to so small a share of the noise
_STIFF = 1e-3


class Normal(NamedTuple):
    """Information of the data in units of the noise's, without priors; ``p`` unknowns at each of ``k`` knots."""

    diagonal: FloatArray  #: (k, p, p)
    beside: FloatArray  #: (k - 1, p, p): knot by the next one
    cross: FloatArray  #: (k, p, 1 + border): knots by residuals and border
    border: FloatArray  #: (1 + border, 1 + border): of residuals and border


class Eliminated(NamedTuple):
    """What is left for the border."""

    border: FloatArray  #: (1 + border, 1 + border): information; first row and column of the residuals
    values: FloatArray  #: (k, p, 1 + border): at the knots, from the residuals and by each of the border
    logdet: float  #: of the information of the knots
    factor: FloatArray  #: banded Cholesky factor of it


def knots(n_ticks: int) -> int:
    """How many knots a segment has."""
    return -(-n_ticks // KNOT_TICKS) + 1


def normal(walk: Walks, columns: FloatArray, weights: FloatArray) -> Normal:
    """Normal equations; ``columns`` (n, 1 + border) are residuals and slopes by the border."""
    count, p = knots(len(columns)), walk.here.shape[1]
    padded = np.zeros(((count - 1) * KNOT_TICKS, columns.shape[1]))
    padded[: len(columns)] = columns * (weights > 0.0)[:, None]
    weight = np.zeros(len(padded))
    weight[: len(columns)] = weights
    by_knot = weight.reshape(count - 1, KNOT_TICKS)

    def products(one: FloatArray, other: FloatArray) -> FloatArray:
        outer = (one[:, :, None] * other[:, None, :]).reshape(KNOT_TICKS, -1)
        return (by_knot @ outer).reshape(-1, p, p)

    diagonal, cross = np.zeros((count, p, p)), np.zeros((count, p, columns.shape[1]))
    diagonal[:-1] += products(walk.here, walk.here)
    diagonal[1:] += products(walk.ahead, walk.ahead)
    weighted = (padded * weight[:, None]).reshape(count - 1, KNOT_TICKS, -1)
    cross[:-1] += walk.here.T @ weighted
    cross[1:] += walk.ahead.T @ weighted
    return Normal(diagonal, products(walk.here, walk.ahead), cross, padded.T @ (padded * weight[:, None]))


def eliminate(data: Normal, walk: Walks, noise: float, start: FloatArray, steps: FloatArray) -> Eliminated:
    """Eliminate the knots.

    Parameters
    ----------
    data : Normal
    walk : Walks
    noise : float
        Standard deviation of the samples.
    start, steps : (p,) arrays
        Standard deviations of the values at the first knot, and of what changes from knot to knot; 0: nothing does.
    """
    count, p, width = data.cross.shape
    gains = np.abs(walk.here[0])
    precision = np.where(steps > 0.0, np.maximum(steps, 1e-300), _STIFF * noise / np.maximum(gains, 1e-12)) ** -2.0
    diagonal = data.diagonal / noise**2
    diagonal[0] += np.diag(start**-2.0)
    diagonal[:-1] += walk.before.T @ (precision[:, None] * walk.before)
    diagonal[1:] += walk.after.T @ (precision[:, None] * walk.after)
    beside = data.beside / noise**2 - walk.before.T @ (precision[:, None] * walk.after)
    band = np.zeros((2 * p, count * p))
    for i in range(p):
        for j in range(p):
            if i <= j:
                band[2 * p - 1 + i - j, j::p] = diagonal[:, i, j]
            band[p - 1 + i - j, p + j :: p] = beside[:, i, j]
    factor = cholesky_banded(band)
    cross = data.cross.reshape(count * p, width) / noise**2
    values = cho_solve_banded((factor, False), cross)
    logdet = 2.0 * float(np.log(factor[-1]).sum()) - (count - 1) * float(np.log(precision).sum())
    return Eliminated(data.border / noise**2 - cross.T @ values, values.reshape(count, p, width), logdet, factor)
