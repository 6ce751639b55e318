"""How jumps are worked off by the shaped corridor."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_nmpc.corridor import Corridor
from fsw_nmpc.horizon import paper_grid
from fsw_nmpc.shape import Shape, ShapedPath
from fsw_nmpc.tuning import Tuning

TIME_S = np.array(paper_grid()[1:])
SHAPE = Shape(acceleration=0.9, slow_speed=0.4, time_s=7.0, top_speed=2.5, ramp_speed=0.5, pass_speed=0.5)


def run(shape, set_points, disturbances=None):
    """Centre of the corridor, tick by tick, and the corridor seen ahead at every tick."""
    path = ShapedPath(TIME_S, shape)
    now, ahead = [], []
    for k, set_point in enumerate(set_points):
        ahead.append(path.step(set_point, 0.0 if disturbances is None else disturbances[k], 0.1).copy())
        now.append(path.distance)
    return np.array(now), np.array(ahead)


@given(jump=st.floats(-60.0, 60.0).filter(lambda value: abs(value) > 0.1))
def test_a_jump_is_worked_off_within_speed_and_acceleration(jump):
    now, _ = run(SHAPE, [0.0] + [jump] * 700)
    speed = np.diff(now[1:]) / 0.1
    assert now[1] == pytest.approx(-jump + np.sign(jump) * 0.05)  # what may pass at once has passed
    assert np.abs(speed).max() <= SHAPE.speed_for(jump) + 1e-9
    under_way = np.abs(now[2:-1]) > 0.1  # the very last ticks stop it
    assert np.abs(np.diff(speed))[under_way].max(initial=0.0) <= 1.5 * 0.1 * SHAPE.acceleration
    assert now[-1] == 0.0
    assert (np.sign(jump) * now[1:]).max() <= 0.01 * abs(jump) + 0.02  # no overshoot to speak of


def test_a_slow_ramp_is_followed_at_once():
    slope = 0.9 * SHAPE.ramp_speed
    now, ahead = run(SHAPE, slope * 0.1 * np.arange(200))
    assert not now.any() and not ahead.any()


def test_what_is_planned_is_what_happens():
    now, ahead = run(SHAPE, [0.0] + [10.0] * 60)
    for k in (1, 10, 30):
        np.testing.assert_allclose(ahead[k][:20], now[k + 1 : k + 21], atol=1e-12)


def test_after_the_dead_time_only():
    late = Shape(0.9, 0.4, 7.0, 2.5, 0.5, 0.5, delay_s=2.8)
    now, ahead = run(late, [0.0] + [10.0] * 200)
    begun = 1 + 28
    assert (now[1:begun] == now[1]).all() and now[begun + 1] > now[1]
    np.testing.assert_allclose(ahead[1][:40], now[2:42], atol=1e-12)
    assert now[-1] == 0.0


def test_disturbances_may_be_worked_off_faster_than_set_points():
    hasty = Shape(0.9, 0.2, 12.0, 2.5, 0.5, 0.5, haste=2.0)
    jump = np.array([0.0] + [-6.0] * 200)
    by_set_point, _ = run(hasty, jump)
    by_disturbance, _ = run(hasty, np.zeros(201), -jump)
    assert np.abs(by_disturbance).sum() < 0.85 * np.abs(by_set_point).sum()


def test_missed_ticks_do_not_stop_the_way():
    one, other = ShapedPath(TIME_S, SHAPE), ShapedPath(TIME_S, SHAPE)
    for path in (one, other):
        path.step(0.0, 0.0, 0.1)
        path.step(10.0, 0.0, 0.1)
    for _ in range(10):
        one.step(10.0, 0.0, 0.1)
    for _ in range(5):
        other.step(10.0, 0.0, 0.2)
    assert other.distance == pytest.approx(one.distance, abs=1e-9)


def test_another_corridor_goes_on_without_a_jump():
    tuning = Tuning()
    first = Corridor(TIME_S, 5.0, 0.02, "shaped", tuning.temperature_shape)
    for set_point in [850.0] + [860.0] * 50:
        first.bands(set_point, 850.0, 0.1)
    second = Corridor(TIME_S, 5.0, 0.02, "shaped", tuning.temperature_shape)
    second.follow(first)
    expected = first.bands(860.0, 850.0, 0.1)
    for mine, its in zip(second.bands(860.0, 850.0, 0.1), expected, strict=True):
        np.testing.assert_allclose(mine, its, atol=1e-9)


@pytest.mark.parametrize("kind", ["shaped", "continuing", "recentred"])
def test_every_corridor_begins_at_the_output_and_ends_at_the_set_point(kind):
    corridor = Corridor(TIME_S, 5.0, 0.02, kind, Tuning().temperature_shape)
    low, high = corridor.bands(852.0, 849.0, 0.1)
    assert (high > low).all() and high[-1] - low[-1] == pytest.approx(0.04, abs=1e-3)
    assert 849.0 - 0.1 < 0.5 * (low + high)[0] < 849.3
    assert 0.5 * (low + high)[-1] == pytest.approx(852.0, abs=0.02)


def test_a_shape_without_speed_is_refused():
    with pytest.raises(ValueError, match="depth_top_speed"):
        Tuning(depth_top_speed=0.0)
