"""The physical limit as a program: exact on the model, within all limits, better than any controller."""

import numpy as np
import pytest

from fsw_control import Limits
from fsw_model import ProcessModel, nominal
from fsw_nmpc.yardstick import Goal, Yardstick


def goals(n, at, depth_mm=0.0, temperature_c=0.0):
    """Rest, then from tick ``at`` on other targets."""
    nothing = np.zeros(n)
    depth, temperature = np.full(n, 2.66), np.full(n, 850.0)
    rest = Goal(0, depth, temperature, nothing, nothing)
    after = np.arange(n) >= at
    return [rest, Goal(at, depth + depth_mm * after, temperature + temperature_c * after, nothing, nothing)]


@pytest.fixture(scope="module")
def answer():
    return Yardstick(nominal(), window_s=12.0).run(goals(130, 10, depth_mm=-0.1))


def test_the_answer_is_a_run_of_the_process(answer):
    assert answer.solved
    model = ProcessModel(nominal())
    state = model.equilibrium().state.copy()
    for k in range(130):
        outputs = model.outputs(state, float(answer.force_kn[k]), float(answer.speed_rpm[k]))
        target = 2.66 if k < 10 else 2.56
        assert outputs.depth_mm - target == pytest.approx(answer.depth_error_mm[k], abs=1e-6)
        assert outputs.temperature_c - 850.0 == pytest.approx(answer.temperature_error_c[k], abs=1e-4)
        model.step(state, float(answer.force_kn[k]), float(answer.speed_rpm[k]))


def test_limits_hold_and_nothing_is_known_before(answer):
    limits = Limits()
    assert np.abs(np.diff(answer.force_kn)).max() <= limits.force_step_kn + 1e-6
    assert np.abs(np.diff(answer.speed_rpm)).max() <= limits.speed_step_rpm + 1e-6
    assert np.ptp(answer.force_kn[:10]) < 1e-3 and np.abs(answer.depth_error_mm[:10]).max() < 1e-5


def test_it_is_the_optimum_that_is_documented(answer):
    iae = 0.1 * np.abs(answer.depth_error_mm).sum()
    assert iae == pytest.approx(0.177, abs=0.004)  # the same as for an output disturbance of +0.1 mm
    assert np.abs(answer.temperature_error_c).max() > 1.0


def test_a_bound_on_the_temperature_costs_depth(answer):
    bounded = Yardstick(nominal(), window_s=12.0, largest_temperature_error_c=0.15).run(goals(130, 10, depth_mm=-0.1))
    assert np.abs(bounded.temperature_error_c).max() <= 0.1501
    assert np.abs(bounded.depth_error_mm).sum() > 1.1 * np.abs(answer.depth_error_mm).sum()


def test_preview_begins_before_the_event():
    answer = Yardstick(nominal(), window_s=12.0, preview_s=3.0).run(goals(130, 40, depth_mm=-0.1))
    assert np.abs(np.diff(answer.force_kn[:40])).max() > 0.5


def test_goals_must_begin_at_the_first_tick():
    with pytest.raises(ValueError, match="tick 0"):
        Yardstick(nominal()).run(goals(20, 5)[1:])
