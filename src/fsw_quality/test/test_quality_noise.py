"""Noise of the residuals: its size and the time over which it is correlated, and what that makes unsure."""

from __future__ import annotations

import numpy as np
import pytest

from fsw_control.units import KW_PER_NM_RPM
from fsw_control.weld import SPEED_RPM
from fsw_model import nominal
from fsw_quality.noise import LONGEST_S, WHITE, Noise, noise_of
from fsw_quality.residuals import GainEstimate, ModelResiduals
from fsw_test_support.watched_weld import noise


def disturbed(seed: int, correlation_s: float, n: int = 900) -> np.ndarray:
    """Noise of standard deviation 0.5 on a ramp with a step and a slow swing."""
    time_s = 0.1 * np.arange(n)
    slow = 0.02 * time_s + 5.0 * (time_s > 40.0) + 0.3 * np.sin(2.0 * np.pi * time_s / 30.0)
    return slow + 0.5 * noise(np.random.default_rng(seed), n, correlation_s)


def test_white_noise_is_white_whatever_the_signal_does() -> None:
    assert all(noise_of(disturbed(seed, 0.0)) is WHITE for seed in range(20))
    assert noise_of(np.zeros(900)) is WHITE
    assert noise_of(disturbed(0, 5.0, 100)) is WHITE  # too few to tell


@pytest.mark.parametrize("correlation_s", [0.3, 1.0, 5.0])
def test_time_of_correlation_and_size_are_told(correlation_s: float) -> None:
    found = [noise_of(disturbed(seed, correlation_s)) for seed in range(20)]
    assert all(0.0 < one.correlation_s <= LONGEST_S for one in found)
    assert 0.6 * correlation_s < np.median([one.correlation_s for one in found]) < 2.0 * correlation_s
    assert 0.4 < np.median([one.sigma for one in found]) < 0.8


def test_means_of_correlated_noise_scatter_as_told() -> None:
    values = noise(np.random.default_rng(7), 400_000, 2.0)
    told = Noise(1.0, 2.0)
    for n in (5, 20):
        assert values.reshape(-1, n).mean(axis=1).var() == pytest.approx(told.share_of_mean(n), rel=0.05)
    minute = values[: values.size // 600 * 600].reshape(-1, 600).mean(axis=1)
    assert minute.var() == pytest.approx(told.variance_of_mean(60.0), rel=0.2)
    assert told.as_one == pytest.approx(2.0 * 2.0 / 0.1, rel=0.01)
    assert WHITE.share_of_mean(5) == pytest.approx(0.2) and WHITE.as_one == 1.0


def test_noise_of_the_torque_seems_to_heat_as_told() -> None:
    residuals = ModelResiduals(nominal())
    residuals.step(2.66, 1100.0, 816.4, 78.4, SPEED_RPM)
    told = residuals.heated_c(Noise(2.0, 5.0))
    assert residuals.heated_c(WHITE) == 0.0
    copper = tool = 0.0
    aa, ab, ap, ba, bb, bp = residuals._thermal
    seen = []
    for torque_nm in (2.0 * noise(np.random.default_rng(8), 60_000, 5.0)).tolist():
        power_kw = torque_nm * SPEED_RPM * KW_PER_NM_RPM
        copper, tool = aa * copper + ab * tool + ap * power_kw, ba * copper + bb * tool + bp * power_kw
        seen.append(tool)
    assert told == pytest.approx(float(np.std(seen)), rel=0.2)


def test_a_gain_is_less_sure_by_correlated_noise_and_not_told_from_noise_alone() -> None:
    random = np.random.default_rng(9)
    swing = np.sin(2.0 * np.pi * np.arange(900) / 300.0)
    sure, unsure, nothing = (GainEstimate((0.0,), 0.5, 0.1, 40.0) for _ in range(3))
    unsure.noisy(100.0, 0.3)
    nothing.noisy(100.0, 1.0)
    for response, measured in zip(swing.tolist(), (swing + 0.1 * noise(random, 900)).tolist(), strict=True):
        for one in (sure, unsure, nothing):
            one.step(response, measured)
    assert unsure.estimate().gain == sure.estimate().gain
    assert unsure.estimate().error > 3.0 * sure.estimate().error
    assert sure.estimate().excited and not nothing.estimate().excited
