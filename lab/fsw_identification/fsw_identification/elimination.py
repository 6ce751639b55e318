"""Least squares of an output of a segment, with the unknowns at the knots eliminated by QR.

The unknowns are values at the knots, each coupled to the next by the data in between and by the
random walk, and a few others on which all samples may depend: the border. This is a square-root
information smoother (Bierman 1977): nothing is squared before the knots are gone, as force and
depth offset, or power and temperature offset, differ so weakly, beside trends that hardly change,
that normal equations would lose all digits. Every other knot is eliminated at a time (cyclic
reduction), all in a single call of LAPACK.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np

from fsw_analysis.weld_signals import FloatArray, IntArray
from fsw_identification.simulation import KNOT_TICKS, Walks
from fsw_identification.statistics import Whitening

#: knots eliminated together, their neighbours, and their rows
Level = tuple[IntArray, IntArray, FloatArray]
#: states at two knots are tied together to this small a share of the noise
_STIFF = 1e-3


class Compressed(NamedTuple):
    """Triangular rows that replace one row per sample, in units of the noise."""

    rows: FloatArray  #: (k - 1, rows, 2 p + 1 + border): by knot, next knot, residual and border
    border: FloatArray  #: (1 + border, 1 + border): information of the rows without knots


@dataclass(frozen=True, slots=True)
class Eliminated:
    """What remains for the border."""

    #: (1 + border, 1 + border): information; first row and column belong to the residuals
    border: FloatArray
    logdet: float  #: log determinant of the knots' information
    levels: list[Level]

    @property
    def shape(self) -> tuple[int, int]:
        """(k, p): number of knots, and of unknowns at each."""
        together, _, rows = self.levels[0]
        return 1 + max(int(at.max()) for at, _, _ in self.levels), rows.shape[1] // together.shape[
            1
        ]

    def values(self) -> FloatArray:
        """(k, p, 1 + border): knots by residuals and border, from back substitution."""
        width, (k, p) = len(self.border), self.shape
        values = np.zeros((k, p, width))
        # from the last level back: the rows of a knot give it from its neighbours, which are knots
        # of later levels and known by then
        for at, beside, rows in reversed(self.levels):
            n, m = at.shape[1] * p, beside.shape[1] * p
            known = rows[:, :, n : n + m] @ values[beside].reshape(len(at), m, width)
            values[at] = np.linalg.solve(rows[:, :, :n], rows[:, :, n + m :] - known).reshape(
                *at.shape, p, width
            )
        return values

    def variance(self, weights: FloatArray) -> float:
        """Variance of a weighted sum, (k, p), of the values at the knots, for a given border."""
        left, squares = weights.copy(), 0.0
        for at, beside, rows in self.levels:
            n = at.shape[1] * weights.shape[1]
            # forward substitution with R': the variance is the squared norm of R'^-1 w
            solved = np.linalg.solve(rows[:, :, :n].swapaxes(1, 2), left[at].reshape(-1, n, 1))
            squares += float(np.sum(solved**2))
            others = (
                rows[:, :, n : n + beside.shape[1] * weights.shape[1]].swapaxes(1, 2) @ solved
            )[:, :, 0]
            np.subtract.at(left, beside, others.reshape(*beside.shape, weights.shape[1]))
        return squares


def knots(n_ticks: int) -> int:
    """Number of knots of a segment."""
    return -(-n_ticks // KNOT_TICKS) + 1


def compress(
    walk: Walks, factor: FloatArray, columns: FloatArray, weights: FloatArray, white: Whitening
) -> Compressed:
    """Compress the data between each two knots by QR into as many rows as there are unknowns.

    ``columns`` (n, 1 + border) are residuals and slopes by the border, ``factor`` (n,) scales the
    knots' contribution, ``weights`` (n,) apply to the whitened rows.

    An interval contains the ticks after one knot up to the next, each with its previous sample.
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
        # whitening: each row less its prediction from the sample before
        stacked -= (scale * white.share[at])[:, :, None] * before
    stacked[1:, 0] = 0.0  # belongs to the previous interval
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
        Standard deviations of the values at the first knot, and of their change per knot; 0: no
        change.
    """
    p, width = walk.here.shape[1], data.border.shape[1]
    # The random walk is one more set of rows: after x[k+1] - before x[k] ~ N(0, steps^2).
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
    # Cyclic reduction: QR with the knot's own columns first leaves p rows that define it (kept for
    # back substitution), and rows that couple its neighbours and the border.
    while len(edges) > 1:
        both = edges[: len(edges) // 2 * 2]
        at, n = left[1 : len(both) : 2], both.shape[1]
        # columns: the knot, the one before, the one after, border
        stacked = np.zeros((at.size, 2 * n, 3 * p + width))
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
    # the last two knots, closed by the prior of the first one
    first = np.hstack([np.diag(1.0 / start), np.zeros((p, p + width))])
    rows = _triangles(np.concatenate([edges, first[None]], axis=1))
    levels.append((left[None], np.zeros((1, 0), dtype=int), rows[:, : 2 * p]))
    border += _squares(rows[:, 2 * p :, 2 * p :])
    logdet = sum(
        2.0 * float(np.log(np.abs(np.diagonal(of, axis1=1, axis2=2))).sum()) for _, _, of in levels
    )
    # the walk's rows were scaled by 1 / steps; their density has that factor, too
    logdet += 2.0 * len(data.rows) * -float(np.log(tight).sum())
    return Eliminated(border, logdet, levels)


def _triangles(rows: FloatArray) -> FloatArray:
    """R of the QR factorisation of each matrix of a stack."""
    return np.asarray(cast("Any", np.linalg.qr(rows, mode="r")), dtype=np.float64)


def _squares(rows: FloatArray) -> FloatArray:
    """Information matrix of rows, (any, rows, width)."""
    flat = rows.reshape(-1, rows.shape[2])
    return np.asarray(flat.T @ flat)
