"""The clairvoyant optimum is one of the process, and its events follow each other."""

import numpy as np
import pytest

from controller_comparison import optimum as bounds
from controller_comparison.optimum import Clairvoyant
from fsw_control import Reference
from fsw_control.weld import DEPTH_MM, TEMPERATURE_C
from fsw_model import ProcessModel
from fsw_tuning.standard_cases import REST

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def clairvoyant():
    return Clairvoyant(window_s=20.0)


def test_courses_of_the_events_follow_each_other():
    courses = bounds.courses()
    assert courses["z up"] == (REST, Reference(DEPTH_MM + 0.2, TEMPERATURE_C))
    assert courses["T up"] == (courses["z up"][1], Reference(DEPTH_MM + 0.2, TEMPERATURE_C + 10.0))
    assert courses["T down"][1] == REST
    assert courses["dT"] == (
        REST,
        Reference(DEPTH_MM, TEMPERATURE_C + 5.0),
    )  # to show what it showed before


@pytest.mark.full
def test_clairvoyant_optimum_matches_the_process(clairvoyant):
    goal = Reference(DEPTH_MM + 0.1, TEMPERATURE_C + 2.0)
    best = clairvoyant.best(REST, goal, 100.0, 1.0)
    model = ProcessModel()
    held = model.equilibrium(DEPTH_MM, TEMPERATURE_C)
    state, force, speed = held.state.copy(), best.force_kn, best.speed_rpm
    for k in range(60):
        shown = model.outputs(state, force[k], speed[k])
        assert shown.depth_mm - goal.depth_mm == pytest.approx(best.depth_error_mm[k], abs=1e-6)
        assert shown.temperature_c - goal.temperature_c == pytest.approx(
            best.temperature_error_c[k], abs=1e-4
        )
        model.step(state, force[k], speed[k])
    moves = np.abs(np.diff(np.concatenate([[held.force_kn], force])))
    assert moves.max() <= 1.0 + 1e-6
    assert force.max() <= 95.0 + 1e-6 and speed.max() <= 500.0 + 1e-6
