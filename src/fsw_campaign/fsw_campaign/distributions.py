"""Distributions of a campaign's parameters, and points drawn from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp, isfinite, log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fsw_plant.place import Place

SAMPLERS = ("latin_hypercube", "sobol")
KINDS = ("uniform", "loguniform", "normal", "choice")
_NORMAL = ("mean", "deviation", "low", "high")


@dataclass(frozen=True, slots=True)
class Distribution:
    """Distribution of one parameter.

    Attributes
    ----------
    path : str
        Of the parameter in the scenario file, e.g. ``plant.model.copper_lag_s``.
    kind : str
        One of ``KINDS``; ``normal`` is truncated to [low, high].
    low, high : float
        Bounds of a number.
    mean, deviation : float
        Of the normal distribution before it is truncated.
    choices : tuple
        Equally likely values of ``choice``.
    """

    path: str
    kind: str
    low: float = 0.0
    high: float = 0.0
    mean: float = 0.0
    deviation: float = 0.0
    choices: tuple[Any, ...] = ()

    @property
    def extremes(self) -> tuple[Any, ...]:
        """Values that must all be allowed for the distribution to be: its bounds and middle, or all its choices."""
        return self.choices or (self.low, self.high, self.value(0.5))

    def value(self, share: float) -> Any:
        """Quantile of a share, 0 to 1."""
        if self.kind == "choice":
            return self.choices[min(int(share * len(self.choices)), len(self.choices) - 1)]
        if self.kind == "uniform":
            found = self.low + share * (self.high - self.low)
        elif self.kind == "loguniform":
            found = exp(log(self.low) + share * log(self.high / self.low))
        else:
            from scipy.special import ndtr, ndtri

            below, above = (float(ndtr((x - self.mean) / self.deviation)) for x in (self.low, self.high))
            found = self.mean + self.deviation * float(ndtri(below + share * (above - below)))
        return min(max(found, self.low), self.high)

    @classmethod
    def read(cls, path: str, entry: Any, at: Place) -> Distribution:
        """Read an entry of the campaign file; raises the place's error where it is not understood."""
        at.mapping(entry)
        kind, given = next(iter(entry.items()), ("", None))
        if len(entry) != 1 or kind not in KINDS:
            raise at.error(f"needs exactly one of {', '.join(KINDS)}, has {', '.join(map(str, entry)) or 'none'}")
        at = at.inside(kind)
        if kind == "choice":
            if (
                not isinstance(given, list)
                or not given
                or not all(isinstance(g, bool | int | float | str) for g in given)
            ):
                raise at.error(f"is {given!r}: give a list of values")
            if len({type(value) for value in given}) > 1:
                raise at.error("has values of several types; write all numbers with a decimal point or none")
            return cls(path, kind, choices=tuple(given))
        if kind == "normal":
            at.keys(at.mapping(given), _NORMAL, _NORMAL)
            numbers = [entry[kind][key] for key in _NORMAL]
        else:
            if not isinstance(given, list) or len(given) != 2:
                raise at.error(f"is {given!r}: give [low, high]")
            numbers = [0.0, 0.0, *given]
        if not all(isinstance(n, int | float) and not isinstance(n, bool) and isfinite(n) for n in numbers):
            raise at.error(f"is {given!r}: give finite numbers")
        mean, deviation, low, high = map(float, numbers)
        if not low < high:
            raise at.error(f"has low = {low:g}, which must be below high = {high:g}")
        if kind == "loguniform" and low <= 0.0:
            raise at.error(f"has low = {low:g}, which must be above 0")
        if kind == "normal" and not (deviation > 0.0 and low <= mean <= high):
            raise at.error("needs a deviation above 0 and a mean from low to high")
        return cls(path, kind, low, high, mean, deviation)


def draw(distributions: Sequence[Distribution], count: int, seed: int, sampler: str) -> NDArray[np.float64]:
    """Shares of all parameters, a row per weld.

    Rows depend on the arguments alone; the first rows of a Sobol sequence do not depend on ``count``.

    Returns
    -------
    (count, len(distributions)) array
        0 to 1, to be put into :meth:`Distribution.value`.
    """
    from scipy.stats import qmc  # heavy to import

    if not distributions:
        return np.zeros((count, 0))
    kind = {"latin_hypercube": qmc.LatinHypercube, "sobol": qmc.Sobol}[sampler]
    made = kind(len(distributions), seed=np.random.default_rng(seed))
    if sampler == "sobol":  # a power of two, for scipy warns of an unbalanced sequence otherwise
        return np.asarray(made.random_base2(max(count - 1, 0).bit_length())[:count])
    return np.asarray(made.random(count))


def weld_seed(seed: int, index: int) -> int:
    """Seed of the sensor noise of a weld."""
    return int(np.random.SeedSequence([seed, index]).generate_state(1)[0])


def values(distributions: Sequence[Distribution], shares: Sequence[float]) -> Mapping[str, Any]:
    """Values by path of one row of :func:`draw`."""
    return {one.path: one.value(share) for one, share in zip(distributions, shares, strict=True)}
