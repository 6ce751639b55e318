"""Distributions of a campaign's parameters, and points drawn from them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PositiveFloat, model_validator

from fsw_control.schema.models import Many, Model

Sampler = Literal["latin_hypercube", "sobol"]
_Pair = Annotated[Many[float], Field(min_length=2, max_length=2)]


class Normal(Model):
    """A normal distribution, truncated to [low, high]."""

    mean: float
    """before it is truncated"""
    deviation: PositiveFloat
    """before it is truncated"""
    low: float
    high: float

    @model_validator(mode="after")
    def _check_mean(self) -> Normal:
        if not self.low <= self.mean <= self.high:
            raise ValueError("needs a mean from low to high")
        return self


class Distribution(Model):
    """Distribution of one parameter: exactly one of these."""

    uniform: _Pair | None = None
    """`[low, high]`"""
    loguniform: _Pair | None = None
    """`[low, high]`, uniform in the logarithm"""
    normal: Normal | None = None
    choice: Annotated[Many[bool | int | float | str], Field(min_length=1)] | None = None
    """equally likely values"""

    @model_validator(mode="after")
    def _check(self) -> Distribution:
        if len(given := [name for name, value in self if value is not None]) != 1:
            has = ", ".join(given) or "none"
            raise ValueError(
                f"needs exactly one of {', '.join(Distribution.model_fields)}, has {has}"
            )
        if self.choice:
            if len({type(value) for value in self.choice}) > 1:
                raise ValueError(
                    "has values of several types; write all numbers with a decimal point or none"
                )
            return self
        low, high = self.bounds
        if not low < high:
            raise ValueError(f"has low = {low:g}, which must be below high = {high:g}")
        if self.loguniform and low <= 0.0:
            raise ValueError(f"has low = {low:g}, which must be above 0")
        return self

    @property
    def kind(self) -> str:
        """Which of them it is."""
        return next(name for name, value in self if value is not None)

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of a number."""
        if self.normal:
            return self.normal.low, self.normal.high
        low, high = self.uniform or self.loguniform or (0.0, 0.0)
        return low, high

    @property
    def extremes(self) -> tuple[Any, ...]:
        """Values that must all be valid.

        The bounds and the middle of the distribution, or all its choices.
        """
        return self.choice or (*self.bounds, self.value(0.5))

    def value(self, share: float) -> Any:
        """Quantile of a share, 0 to 1."""
        if self.choice:
            return self.choice[min(int(share * len(self.choice)), len(self.choice) - 1)]
        low, high = self.bounds
        return min(max(float(self._continuous.ppf(share)), low), high)

    @cached_property
    def _continuous(self) -> Any:
        from scipy import stats  # heavy to import

        low, high = self.bounds
        if self.loguniform:
            return stats.loguniform(low, high)
        if self.normal is None:
            return stats.uniform(low, high - low)
        mean, deviation = self.normal.mean, self.normal.deviation
        return stats.truncnorm(
            (low - mean) / deviation, (high - mean) / deviation, mean, deviation
        )


def draw(parameters: int, count: int, seed: int, sampler: str) -> NDArray[np.float64]:
    """Shares of all parameters, 0 to 1, for :meth:`Distribution.value`.

    A row per weld, a column per parameter.

    Rows depend on the arguments alone; the first rows of a Sobol sequence do not depend on
    ``count``.
    """
    from scipy.stats import qmc  # heavy to import

    if not parameters:
        return np.zeros((count, 0))
    kind = {"latin_hypercube": qmc.LatinHypercube, "sobol": qmc.Sobol}[sampler]
    made = kind(parameters, seed=np.random.default_rng(seed))
    if sampler == "sobol":  # a power of two, for scipy warns of an unbalanced sequence otherwise
        return np.asarray(made.random_base2(max(count - 1, 0).bit_length())[:count])
    return np.asarray(made.random(count))


def weld_seed(seed: int, index: int) -> int:
    """Seed of the sensor noise of a weld."""
    return int(np.random.SeedSequence([seed, index]).generate_state(1)[0])


def values(distributions: Mapping[str, Distribution], shares: Iterable[float]) -> dict[str, Any]:
    """Values by path of one row of :func:`draw`."""
    return {
        path: distribution.value(share)
        for (path, distribution), share in zip(distributions.items(), shares, strict=True)
    }
