"""What the estimator makes of jumps, of another torque and of another heat."""

import pytest

from fsw_control import Command, Measurement
from fsw_model import ProcessModel, nominal
from fsw_nmpc.estimator import Estimator, EstimatorTuning


def follow(factors, depth_jump_mm=0.0, temperature_jump_c=0.0, seconds=40.0, tuning=None, start_c=850.0):
    """Estimator after a run at rest on a process with factors on its parameters; the outputs jump half way."""
    model = ProcessModel(nominal().scaled(**factors))
    at = model.equilibrium(2.66, start_c)
    state, command = at.state.copy(), Command(at.force_kn, at.speed_rpm)
    estimator = Estimator(nominal(), tuning)
    ticks = round(10 * seconds)
    for k in range(ticks):
        outputs = model.outputs(state, command.force_kn, command.speed_rpm)
        jumped = k >= ticks // 2
        measurement = Measurement(
            0.1 * k,
            outputs.depth_mm + depth_jump_mm * jumped,
            outputs.motor_torque_nm,
            outputs.temperature_c + temperature_jump_c * jumped,
        )
        if k == 0:
            assert estimator.start(measurement, command)
        else:
            assert estimator.step(measurement, command)
        model.step(state, command.force_kn, command.speed_rpm)
    return estimator


def test_a_jump_of_the_depth_shown_is_no_change_of_the_contact():
    values = follow({}, depth_jump_mm=0.1).disturbances()
    assert values["depth [mm]"] == pytest.approx(0.1, abs=0.004)
    assert values["axial_force [kN]"] == pytest.approx(0.0, abs=0.05)
    assert values["torque scale [1]"] == pytest.approx(1.0, abs=1e-3)


def test_a_jump_is_found_within_a_tick_with_the_excess_and_slower_without():
    def seen(tuning):
        estimator = follow({}, depth_jump_mm=0.1, seconds=4.0, tuning=tuning)
        return estimator.depth_offset_mm

    assert seen(EstimatorTuning()) > 0.095
    assert seen(EstimatorTuning(jump_sigmas=0.0)) > 0.03  # works without, too


def test_a_jump_of_the_temperature_is_an_offset():
    values = follow({}, temperature_jump_c=-5.0).disturbances()
    assert values["temperature [degC]"] == pytest.approx(-5.0, abs=0.3)
    assert values["heat scale [1]"] == pytest.approx(1.0, abs=0.01)


def test_another_torque_is_a_scale_of_the_torque():
    values = follow({"friction_coefficient": 1.1}).disturbances()
    assert values["torque scale [1]"] == pytest.approx(1.0985, abs=3e-3)
    assert values["depth [mm]"] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(("factor", "start_c"), [(1.2, 850.0), (0.8, 760.0)])
def test_another_thermal_gain_is_a_scale_of_the_heat(factor, start_c):
    estimator = follow({"thermal_gain_c_per_kw": factor}, start_c=start_c)
    values = estimator.disturbances()
    assert values["heat scale [1]"] == pytest.approx(factor, rel=3e-3)
    assert values["temperature [degC]"] == pytest.approx(0.0, abs=0.05)
