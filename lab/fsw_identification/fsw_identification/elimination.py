"""Least squares of one output of one segment; what is unknown at the knots is eliminated by orthogonal transformations.

The unknowns are values at the knots, each coupled to the next by the data between them and by the
random walk; and a few others, on which all samples may depend: the border. Nothing is squared
before the knots are gone: force against depth offset, or power against temperature offset, are
told apart so weakly, beside trends that hardly change, that normal equations lose all digits.
Every other knot is eliminated at a time, all of them in one call of LAPACK.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np

from fsw_analysis.weld_signals import FloatArray, IntArray
from fsw_identification.noise import Whitening
from fsw_identification.simulation import KNOT_TICKS, Walks

#: knots that were eliminated together, those beside them, and their rows
Level = tuple[IntArray, IntArray, FloatArray]
#: the states at two knots fit to so small a share of the noise
_STIFF = 1e-3


class Compressed(NamedTuple):
    """As many rows of least squares as there are unknowns, instead of one for each sample; in units of the noise."""

    rows: FloatArray  #: (k - 1, rows, 2 p + 1 + border): by knot, next knot, residual and border
    border: FloatArray  #: (1 + border, 1 + border): information of the rows without knots


@dataclass(frozen=True, slots=True)
class Eliminated:
    """What is left for the border."""

    border: (
        FloatArray  #: (1 + border, 1 + border): information; first row and column of the residuals
    )
    logdet: float  #: of the information of the knots
    levels: list[Level]

    @property
    def shape(self) -> tuple[int, int]:
        """(k, p): knots, and unknowns at each."""
        together, _, rows = self.levels[0]
        return 1 + max(int(at.max()) for at, _, _ in self.levels), rows.shape[1] // together.shape[
            1
        ]

    def values(self) -> FloatArray:
        """(k, p, 1 + border): at the knots, from the residuals and by each of the border; by back substitution."""
        width, (k, p) = len(self.border), self.shape
        values = np.zeros((k, p, width))
        for at, beside, rows in reversed(self.levels):
            n, m = at.shape[1] * p, beside.shape[1] * p
            known = rows[:, :, n : n + m] @ values[beside].reshape(len(at), m, width)
            values[at] = np.linalg.solve(rows[:, :, :n], rows[:, :, n + m :] - known).reshape(
                *at.shape, p, width
            )
        return values

    def variance(self, weights: FloatArray) -> float:
        """Of a weighted sum, (k, p), of the values at the knots; the border known."""
        left, squares = weights.copy(), 0.0
        for at, beside, rows in self.levels:
            n = at.shape[1] * weights.shape[1]
            solved = np.linalg.solve(rows[:, :, :n].swapaxes(1, 2), left[at].reshape(-1, n, 1))
            squares += float(np.sum(solved**2))
            others = (
                rows[:, :, n : n + beside.shape[1] * weights.shape[1]].swapaxes(1, 2) @ solved
            )[:, :, 0]
            np.subtract.at(left, beside, others.reshape(*beside.shape, weights.shape[1]))
        return squares


def knots(n_ticks: int) -> int:
    """How many knots a segment has."""
    return -(-n_ticks // KNOT_TICKS) + 1


def compress(
    walk: Walks, factor: FloatArray, columns: FloatArray, weights: FloatArray, white: Whitening
) -> Compressed:
    """Rows of the data.

    ``columns`` (n, 1 + border) are residuals and slopes by the border, ``factor`` (n,) multiplies
    what the knots add, ``weights`` (n,) belong to the whitened rows.

    Between two knots are the ticks after the one, up to the other: each with the sample before.
    """
    n, count, width = len(columns), knots(len(columns)) - 1, columns.shape[1]
    by_knots = np.hstack([walk.here, walk.ahead])
    used = np.flatnonzero(by_knots.any(axis=0))
    ticks = KNOT_TICKS * np.arange(count)[:, None] + np.arange(KNOT_TICKS + 1)
    at = np.minimum(ticks, n - 1)
    known = np.column_stack([factor, columns])[at]
    samples = np.concatenate([known[:, :, :1] * by_knots[:, used], known[:, :, 1:]], axis=2)
    scale = np.where(ticks < n, (np.sqrt(weights) * white.scale)[at], 0.0)
    stacked = scale[:, :, None] * samples
    if white.share.any():
        before = np.take_along_axis(
            samples, (white.before[at] - ticks[:, :1])[:, :, None].clip(0), axis=1
        )
        stacked -= (scale * white.share[at])[:, :, None] * before
    stacked[1:, 0] = 0.0  # belongs to the knots before
    triangles = _triangles(stacked)
    rows = np.zeros((count, used.size, by_knots.shape[1] + width))
    rows[:, :, used] = triangles[:, : used.size, : used.size]
    rows[:, :, by_knots.shape[1] :] = triangles[:, : used.size, used.size :]
    return Compressed(rows, _squares(triangles[:, used.size :, used.size :]))


def eliminate(
    data: Compressed, walk: Walks, noise: float, start: FloatArray, steps: FloatArray
) -> Eliminated:
    """Eliminate the knots.

    Parameters
    ----------
    data : Compressed
    walk : Walks
    noise : float
        Standard deviation of the samples.
    start, steps : (p,) arrays
        Standard deviations of the values at the first knot, and of what changes from knot to knot;
        0: nothing does.
    """
    p, width = walk.here.shape[1], data.border.shape[1]
    gains = np.abs(walk.here[0])
    tight = 1.0 / np.where(
        steps > 0.0, np.maximum(steps, 1e-300), _STIFF * noise / np.maximum(gains, 1e-12)
    )
    changes = np.hstack([-walk.before, walk.after, np.zeros((p, width))]) * tight[:, None]
    edges = np.concatenate(
        [data.rows / noise, np.broadcast_to(changes, (len(data.rows), *changes.shape))], axis=1
    )
    border, left = data.border / noise**2, np.arange(len(edges) + 1)
    levels: list[Level] = []
    while len(edges) > 1:
        both = edges[: len(edges) // 2 * 2]
        at, n = left[1 : len(both) : 2], both.shape[1]
        stacked = np.zeros(
            (at.size, 2 * n, 3 * p + width)
        )  # by the knot, the one before, the one after, border
        stacked[:, :n, :p], stacked[:, :n, p : 2 * p] = both[::2, :, p : 2 * p], both[::2, :, :p]
        stacked[:, n:, :p], stacked[:, n:, 2 * p : 3 * p] = (
            both[1::2, :, :p],
            both[1::2, :, p : 2 * p],
        )
        stacked[:, :n, 3 * p :], stacked[:, n:, 3 * p :] = (
            both[::2, :, 2 * p :],
            both[1::2, :, 2 * p :],
        )
        rows = _triangles(stacked)
        beside = np.column_stack([left[: len(both) : 2], left[2 : len(both) + 1 : 2]])
        levels.append((at[:, None], beside, rows[:, :p]))
        border += _squares(rows[:, 3 * p :, 3 * p :])
        edges = np.concatenate([rows[:, p : 3 * p, p:], edges[len(both) :]])
        left = np.concatenate([left[: len(both) + 1 : 2], left[len(both) + 1 :]])
    first = np.hstack([np.diag(1.0 / start), np.zeros((p, p + width))])
    rows = _triangles(np.concatenate([edges, first[None]], axis=1))
    levels.append((left[None], np.zeros((1, 0), dtype=int), rows[:, : 2 * p]))
    border += _squares(rows[:, 2 * p :, 2 * p :])
    logdet = sum(
        2.0 * float(np.log(np.abs(np.diagonal(of, axis1=1, axis2=2))).sum()) for _, _, of in levels
    )
    logdet += 2.0 * len(data.rows) * -float(np.log(tight).sum())
    return Eliminated(border, logdet, levels)


def _triangles(rows: FloatArray) -> FloatArray:
    """R of QR of each of a stack."""
    return np.asarray(cast("Any", np.linalg.qr(rows, mode="r")), dtype=np.float64)


def _squares(rows: FloatArray) -> FloatArray:
    """Information of rows, (any, rows, width)."""
    flat = rows.reshape(-1, rows.shape[2])
    return np.asarray(flat.T @ flat)
