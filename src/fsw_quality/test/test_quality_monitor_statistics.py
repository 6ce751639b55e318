"""The statistics of the monitor, against signals whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from fsw_quality.monitor_statistics import (
    Window,
    best_delay,
    gain_beside_slope,
    harris_index,
    ljung_box,
    noise_sigma,
    oscillation,
    robust_slope,
)

RANDOM = np.random.default_rng(1)


def test_a_window_has_the_newest_samples_in_order() -> None:
    window = Window(3)
    for value in range(5):
        window.append(value)
        assert window.values().tolist() == list(range(max(0, value - 2), value + 1))
    assert window.full and window.values(2).tolist() == [3.0, 4.0]


def test_noise_is_found_beside_slopes_steps_and_spikes() -> None:
    values = 0.5 * RANDOM.standard_normal(2000) + np.arange(2000) * 0.01
    values[1000:] += 40.0
    values[::100] += 9.0
    assert noise_sigma(values) == pytest.approx(0.5, rel=0.15)
    assert noise_sigma(values[:2]) == 0.0


def test_a_step_is_no_slope() -> None:
    values = np.where(np.arange(60) > 30, 5.0, 0.0)
    assert robust_slope(values, 1.0, 15) == 0.0
    assert robust_slope(0.2 * np.arange(60), 0.5, 15) == pytest.approx(0.4)


def test_a_gain_is_found_beside_a_slope_and_is_the_known_one_where_nothing_tells_it() -> None:
    time, pulse = np.arange(75.0), np.where(np.arange(75) > 40, 0.2, 0.0)
    values = 1.1 * pulse + 2e-4 * time + 5.0
    assert gain_beside_slope(values, pulse, 1.0, 0.05, 0.001) == pytest.approx(1.1, abs=0.01)
    # a cause at rest, and one that moves like a slope
    assert gain_beside_slope(values, 0.0 * pulse, 0.95, 0.05, 0.001) == 0.95
    assert gain_beside_slope(2e-4 * time, 1e-4 * time, 1.0, 0.05, 0.001) == pytest.approx(1.0, abs=1e-6)
    assert gain_beside_slope(values[:2], pulse[:2], 0.9, 0.05, 0.001) == 0.9


def test_white_noise_is_white_and_what_follows_itself_is_not() -> None:
    white = RANDOM.standard_normal(300)
    followed = np.convolve(RANDOM.standard_normal(400), np.ones(5), "valid")[:300]
    assert ljung_box(white) < 2.0 < 8.0 < ljung_box(followed)
    assert ljung_box(np.ones(300)) == 1.0


@pytest.mark.parametrize("period", [12.0, 24.0])
def test_an_oscillation_has_its_period_and_amplitude(period: float) -> None:
    time = np.arange(240) * 0.5
    found = oscillation(2.0 * np.sin(2.0 * np.pi * time / period) + 0.5 * RANDOM.standard_normal(240), 0.5)
    assert found.regularity > 1.5 and found.period_s == pytest.approx(period, rel=0.1)
    assert found.amplitude == pytest.approx(2.0, rel=0.3)
    assert oscillation(RANDOM.standard_normal(240), 0.5).regularity < 1.5
    assert oscillation(np.zeros(240), 0.5).regularity == 0.0


def test_the_harris_index_is_one_at_the_least_variance_and_falls_with_a_slow_loop() -> None:
    noise = RANDOM.standard_normal(5000)
    best = noise[2:] + 0.8 * noise[1:-1] + 0.64 * noise[:-2]  # what enters within a dead time of three samples
    slow = np.zeros(5000)
    for k in range(1, 5000):
        slow[k] = 0.95 * slow[k - 1] + noise[k]
    assert harris_index(best, 3) > 0.9
    expected = (1.0 + 0.95**2 + 0.95**4) * (1.0 - 0.95**2)
    assert harris_index(slow, 3) == pytest.approx(expected, rel=0.25)


def test_a_delay_is_found() -> None:
    given = np.cumsum(RANDOM.standard_normal(300))
    assert best_delay(given[10:], given[4:-6], 15) == 6
    assert best_delay(given[10:], given[4:-6] + 3.0, 15) == 6, "whatever the offset of the load cell"


def test_an_offset_on_a_ramp_is_no_delay() -> None:
    ramp = 0.002 * np.arange(300.0)
    assert best_delay(ramp, ramp - 0.03 + 0.005 * RANDOM.standard_normal(300), 15) == 0
