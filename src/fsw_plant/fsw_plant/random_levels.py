"""A seeded random process for disturbances: levels that change at random times."""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, sqrt

import numpy as np

#: lag by which a level is approached, as a share of the mean time between changes
LAG = 0.2


class RandomLevels:
    """A continuous process of mean 0 and, once it is stationary, of standard deviation 1.

    Levels of a Laplace distribution are held for exponentially distributed times of mean
    ``mean_s`` and approached with a first-order lag of :data:`LAG` times that. Both tails are
    heavier than a Gauss-Markov process has, as those of published weld temperatures are (chosen).
    The lag leaves 1 / (1 + LAG) of the levels' variance; a Laplace distribution's is 2 scale^2.
    """

    def __init__(self, seed: Sequence[int], mean_s: float) -> None:
        self._draws, self._mean_s = np.random.default_rng(seed), mean_s
        self._scale = sqrt(0.5 * (1.0 + LAG))
        self._value = self._level = self._at_s = self._until_s = 0.0

    def at(self, since_s: float) -> float:
        """Value at a time since the start; times must not decrease."""
        while since_s >= self._until_s:
            self._follow(self._until_s)
            self._level = float(self._draws.laplace(0.0, self._scale))
            self._until_s += float(self._draws.exponential(self._mean_s))
        self._follow(since_s)
        return self._value

    def _follow(self, until_s: float) -> None:
        left = exp(-max(until_s - self._at_s, 0.0) / (LAG * self._mean_s))
        self._value = self._level + left * (self._value - self._level)
        self._at_s = until_s
