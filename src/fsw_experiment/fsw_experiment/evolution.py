"""Minimises a function of some twenty variables that cannot be differentiated: evolution with an adapted covariance.

After Hansen, "The CMA Evolution Strategy: A Tutorial" (arXiv 1604.00772), without its boundary handling and restarts.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


def minimise(
    cost: Callable[[Vector], float],
    start: Vector,
    size: float,
    evaluations: int,
    seed: int = 1,
    progress: Callable[[float], None] | None = None,
) -> Vector:
    """Return the best point found.

    Parameters
    ----------
    cost : callable
        Function of a (n,) array; finite everywhere.
    start : (n,) array
    size : float
        Standard deviation of the first generation about ``start``, for every variable.
    evaluations : int
        Of ``cost``, rounded up to whole generations.
    seed : int
        The same seed finds the same point.
    progress : callable, optional
        Called with the share of the evaluations done, 0 to 1.

    Returns
    -------
    (n,) array
        ``start`` if nothing better was found.
    """
    n, random = len(start), np.random.default_rng(seed)
    many = 4 + 4 * int(math.log(n) + 1.0)
    weights = math.log(many // 2 + 0.5) - np.log(np.arange(1, many // 2 + 1))
    weights /= weights.sum()
    effective = 1.0 / float((weights**2).sum())
    path_share = (4.0 + effective / n) / (n + 4.0 + 2.0 * effective / n)
    size_share = (effective + 2.0) / (n + effective + 5.0)
    one_share = 2.0 / ((n + 1.3) ** 2 + effective)
    rank_share = min(1.0 - one_share, 2.0 * (effective - 2.0 + 1.0 / effective) / ((n + 2.0) ** 2 + effective))
    damping = 1.0 + 2.0 * max(0.0, math.sqrt((effective - 1.0) / (n + 1.0)) - 1.0) + size_share
    usual = math.sqrt(n) * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n))
    mean, covariance = start.copy(), np.eye(n)
    path, size_path = np.zeros(n), np.zeros(n)
    best, least, done = start, cost(start), 1
    while done < evaluations:
        variances, axes = np.linalg.eigh(covariance)
        deviations = np.sqrt(np.maximum(variances, 1e-20))
        steps = (random.standard_normal((many, n)) * deviations) @ axes.T
        costs = [cost(mean + size * step) for step in steps]
        done += many
        order = np.argsort(costs, kind="stable")
        if costs[order[0]] < least:
            least, best = costs[order[0]], mean + size * steps[order[0]]
        chosen = steps[order[: len(weights)]]
        move = weights @ chosen
        mean = mean + size * move
        size_path = (1.0 - size_share) * size_path
        size_path += math.sqrt(size_share * (2.0 - size_share) * effective) * (axes @ ((axes.T @ move) / deviations))
        length = float(np.linalg.norm(size_path))
        calm = length < (1.4 + 2.0 / (n + 1.0)) * usual * math.sqrt(1.0 - (1.0 - size_share) ** (2.0 * done / many))
        path = (1.0 - path_share) * path + calm * math.sqrt(path_share * (2.0 - path_share) * effective) * move
        covariance = (
            (1.0 - one_share - rank_share + (not calm) * one_share * path_share * (2.0 - path_share)) * covariance
            + one_share * np.outer(path, path)
            + rank_share * (chosen.T * weights) @ chosen
        )
        size *= math.exp(size_share / damping * (length / usual - 1.0))
        if progress is not None:
            progress(min(done / evaluations, 1.0))
    return best
