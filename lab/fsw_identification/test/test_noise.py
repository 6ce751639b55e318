"""Noise that is correlated in time: whitening, gaps, shifts that are looked for in it."""

import numpy as np
import pytest

from fsw_analysis.weld_signals import FloatArray
from fsw_identification import disturbed
from fsw_identification.simulation import KNOT_TICKS
from fsw_identification.statistics import autocorrelation_of, correlation_s, whitening

N = 200 * KNOT_TICKS


def coloured(left: float, n: int = N, seed: int = 1) -> FloatArray:
    """Gauss-Markov noise, whose innovations have the standard deviation 1."""
    fresh, noise = np.random.default_rng(seed).standard_normal(n), np.zeros(n)
    noise[0] = fresh[0] / np.sqrt(1.0 - left**2)
    for k in range(1, n):
        noise[k] = left * noise[k - 1] + fresh[k]
    return noise


@pytest.mark.parametrize("left", [0.0, 0.5, 0.98])
def test_whitened_noise_is_white_with_gaps_too(left: float) -> None:
    known = np.random.default_rng(2).random(N) < 0.6
    known[150:380] = False  # beyond two knots
    noise = np.where(known, coloured(left), np.nan)
    white = whitening(known, left).of(noise)
    assert (np.isfinite(white) == known).all()
    assert np.nanstd(white) == pytest.approx(1.0, rel=0.03)
    assert abs(np.nanmean(white[1:] * white[:-1])) < 0.05


def test_whitening_does_not_cross_a_knot() -> None:
    known = np.random.default_rng(3).random(N) < 0.3
    white = whitening(known, 0.9)
    at = np.flatnonzero(white.share)
    assert at.size > 0.9 * 0.3 * N and known[white.before[at]].all()
    assert ((at - 1) // KNOT_TICKS * KNOT_TICKS <= white.before[at]).all() and (
        white.before[at] < at
    ).all()


def test_whitening_leaves_white_noise_unchanged() -> None:
    noise = coloured(0.0, 300)
    np.testing.assert_array_equal(whitening(np.ones(300, dtype=bool), 0.0).of(noise), noise)
    assert correlation_s(
        np.array([0.0, autocorrelation_of(1.0), autocorrelation_of(5.0)])
    ) == pytest.approx([0.0, 1.0, 5.0])


def test_coloured_noise_is_not_taken_for_a_disturbance() -> None:
    """Its swings are one as long as it is taken for white."""
    left = np.array([autocorrelation_of(1.0), autocorrelation_of(5.0), 0.0])
    noise = np.column_stack([coloured(share, 60 * KNOT_TICKS, i) for i, share in enumerate(left)])
    known = np.ones(len(noise), dtype=bool)
    white = np.column_stack(
        [whitening(known, share).of(column) for share, column in zip(left, noise.T, strict=True)]
    )
    assert disturbed.shift_sizes(white, left).max() < disturbed.SHIFT
    assert not disturbed.disturbed_windows(white, np.ones(3)).any()
    taken_for_white = disturbed.shift_sizes(noise / noise.std(axis=0), np.zeros(3))
    assert taken_for_white[:, 0].max() > disturbed.SHIFT


def test_shift_size_in_white_noise_is_a_difference_of_means() -> None:
    noise = np.random.default_rng(5).standard_normal((400, 3))
    noise[200:, 0] += 1.5
    sizes = disturbed.shift_sizes(noise, np.zeros(3))
    expected = abs(noise[150:180, 1].mean() - noise[120:150, 1].mean()) / np.sqrt(2.0 / 30.0)
    assert sizes[149, 1] == pytest.approx(expected, rel=1e-9)
    assert abs(int(sizes[:, 0].argmax()) - 199) < 5
