"""Elimination of the knots against dense algebra, and where normal equations break down."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import LinAlgError, cho_factor

from fsw_analysis.weld_signals import FloatArray
from fsw_identification.elimination import Eliminated, compress, eliminate, knots
from fsw_identification.simulation import KNOT_TICKS, Response, Walks, walks
from fsw_identification.statistics import Whitening, whitening

NOISE = 0.3
#: lags and gains of depth, temperature and torque
MODES = {
    "depth": ([np.inf, 14.7], [1.6e-3, 2.4e-2]),
    "temperature": ([30.5, 1.2], [18.8, -0.7]),
    "torque": ([], []),
}


class Case(NamedTuple):
    walk: Walks
    factor: FloatArray
    columns: FloatArray
    weights: FloatArray
    start: FloatArray
    steps: FloatArray
    white: Whitening

    def eliminated(self) -> Eliminated:
        data = compress(self.walk, self.factor, self.columns, self.weights, self.white)
        return eliminate(data, self.walk, NOISE, self.start, self.steps)

    def rows(self) -> tuple[FloatArray, FloatArray]:
        """Dense rows of all knots, and of residual and border, in units of their standard deviations."""
        n, p = len(self.columns), self.walk.here.shape[1]
        k, width = knots(n), self.columns.shape[1]
        by_knots = np.zeros((n, k, p))
        for tick in range(n):
            i = max(tick - 1, 0) // KNOT_TICKS
            for at, share in ((tick, 1.0), (self.white.before[tick], -self.white.share[tick])):
                j, gain = at - i * KNOT_TICKS, self.white.scale[tick] * share * self.factor[at]
                by_knots[tick, i] += gain * self.walk.here[j]
                by_knots[tick, i + 1] += gain * self.walk.ahead[j]
        stiff = 1e-3 * NOISE / np.maximum(np.abs(self.walk.here[0]), 1e-12)
        tight = 1.0 / np.where(self.steps > 0.0, self.steps, stiff)
        changes = np.zeros((k - 1, p, k, p))
        for i in range(k - 1):
            changes[i, :, i], changes[i, :, i + 1] = -self.walk.before, self.walk.after
        first = np.zeros((p, k, p))
        first[:, 0] = np.diag(1.0 / self.start)
        root = np.sqrt(self.weights)[:, None] / NOISE
        ours = [
            root * by_knots.reshape(n, -1),
            (tight[:, None, None] * changes).reshape(-1, k * p),
        ]
        ours.append(first.reshape(p, -1))
        others = np.vstack(
            [
                root * np.column_stack([self.white.of(column) for column in self.columns.T]),
                np.zeros((k * p, width)),
            ]
        )
        return np.vstack(ours), others


def case(
    output: str,
    n: int,
    seed: int,
    scales: tuple[float, float] = (-1.0, 1.0),
    width: int = 3,
    left: float = 0.0,
) -> Case:
    """Random data.

    Powers of ten of the priors within ``scales``, and noise of this autocorrelation.
    """
    generator = np.random.default_rng(seed)
    lags_s, gains = (np.array(numbers) for numbers in MODES[output])
    factor = generator.uniform(0.8, 1.2, n)
    walk = walks(Response(np.zeros(n), lags_s, gains, factor))
    start, steps = 10.0 ** generator.uniform(*scales, (2, walk.here.shape[1]))
    steps[: gains.size] = 0.0
    weights = generator.integers(0, 3, n) / 2.0
    white = whitening(generator.random(n) < 0.9, left)
    return Case(walk, factor, generator.standard_normal((n, width)), weights, start, steps, white)


@settings(deadline=None)
@given(
    output=st.sampled_from(sorted(MODES)),
    n=st.integers(1, 9 * KNOT_TICKS),
    seed=st.integers(0, 2**32 - 1),
    width=st.integers(1, 8),
    left=st.sampled_from([0.0, 0.3, 0.98]),
)
def test_elimination_matches_dense_least_squares(
    output: str, n: int, seed: int, width: int, left: float
) -> None:
    problem = case(output, n, seed, width=width, left=left)
    eliminated, (rows, others) = problem.eliminated(), problem.rows()
    triangle = np.linalg.qr(rows)[1]
    values, *_ = np.linalg.lstsq(rows, others, rcond=None)
    left = others - rows @ values
    np.testing.assert_allclose(eliminated.border, left.T @ left, rtol=1e-7, atol=1e-7)
    k, p = eliminated.shape
    deviations = np.sqrt((np.linalg.inv(triangle) ** 2).sum(axis=1)).reshape(k, p)
    np.testing.assert_allclose(
        (eliminated.values() - values.reshape(k, p, -1)) / deviations[:, :, None], 0.0, atol=1e-5
    )
    stiff = -np.log(
        np.where(
            problem.steps > 0.0,
            problem.steps,
            1e-3 * NOISE / np.abs(problem.walk.here[0]).clip(1e-12),
        )
    )
    expected = 2.0 * np.log(np.abs(np.diag(triangle))).sum() - 2.0 * (knots(n) - 1) * stiff.sum()
    assert eliminated.logdet == pytest.approx(expected, abs=1e-5)
    weights = np.random.default_rng(seed).standard_normal((k, p))
    variance = np.sum(np.linalg.solve(triangle.T, weights.ravel()) ** 2)
    assert eliminated.variance(weights) == pytest.approx(variance, rel=1e-4)


@pytest.mark.parametrize("output", ["depth", "temperature"])
def test_elimination_stays_positive_definite_for_priors_of_any_size(output: str) -> None:
    """Twelve powers of ten between what may change.

    Normal equations are not positive definite there any more.
    """
    broken = 0
    for seed in range(20):
        problem = case(output, 12 * KNOT_TICKS, seed, (-7.0, 5.0))
        rows, others = problem.rows()
        try:
            cho_factor(rows.T @ rows)
        except LinAlgError:
            broken += 1
        eliminated = problem.eliminated()
        scale = np.linalg.norm(rows, axis=0)
        values, *_ = np.linalg.lstsq(rows / scale, others, rcond=1e-16)
        left = others - rows / scale @ values
        np.testing.assert_allclose(eliminated.border, left.T @ left, rtol=1e-3, atol=1e-2)
        assert np.isfinite(eliminated.logdet) and np.isfinite(eliminated.values()).all()
        assert np.linalg.eigvalsh(eliminated.border).min() > 0.0
    assert broken > 0


def test_infinite_data_give_an_infinite_cost() -> None:
    problem = case("depth", 3 * KNOT_TICKS, 0)
    problem.columns[5, 0], problem.weights[5] = np.inf, 1.0
    assert not np.isfinite(problem.eliminated().border).all()
