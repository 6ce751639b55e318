"""The published numbers that the model must reproduce."""

from math import pi

import numpy as np
import pytest

from fsw_model import ProcessModel, nominal


@pytest.fixture(scope="module")
def model():
    return ProcessModel()


@pytest.fixture(scope="module")
def point(model):
    return model.equilibrium(2.66, 850.0)


def test_contact_of_shoulder(model, point):
    p = model.parameters
    area_m2 = p.contact_area_m2(2.66)
    assert area_m2 == pytest.approx(3.366e-3, abs=0.5e-6)
    sigma_pa = 78.4e3 / area_m2
    assert sigma_pa == pytest.approx(23.3e6, abs=0.05e6)
    geometry_m3 = point.outputs.process_torque_nm / (p.sticking_stress_pa + p.friction_coefficient * sigma_pa)
    assert geometry_m3 == pytest.approx(9.933e-5, abs=0.5e-8)
    ring_m3 = 2 * pi / 3 * (p.contact_radius_m(2.66) ** 3 - p.contact_inner_radius_m**3)
    assert geometry_m3 == pytest.approx(ring_m3 + p.probe_volume_m3, rel=1e-12)


def test_torques_and_speed_at_43_6_kw(point):
    assert point.force_kn == 78.4
    assert point.outputs.power_kw == pytest.approx(43.6, abs=1e-6)
    assert point.speed_rpm == pytest.approx(407.576, abs=5e-4)
    assert point.outputs.process_torque_nm == pytest.approx(1021.53, abs=5e-3)
    assert point.outputs.friction_torque_nm == pytest.approx(31.333, abs=5e-4)
    assert point.outputs.motor_torque_nm == pytest.approx(1052.86, abs=5e-3)


def test_slopes(model, point):
    at = model.linearise(point)
    assert at.c_power[0] / (407.576 * pi / 30e3) == pytest.approx(120.8, abs=0.05)  # dM/dz, N m per mm
    assert at.c[2, 0] == pytest.approx(120.8, abs=0.05)
    assert at.d[2, 0] == pytest.approx(12.84, abs=5e-3)  # dM/dF, N m per kN
    assert at.d_power[1] == pytest.approx(0.107, abs=5e-4)  # dP/domega, kW per rpm


def test_depth_creeps_after_a_transient(model, point):
    """+1 kN without thermal feedback: 1.6 um/s in the end, the line 0.0238 mm ahead, 14.7 s to get there."""
    frozen = ProcessModel(model.parameters.with_values(softening_gain_mm_per_c=0.0))
    start = frozen.equilibrium()
    run = frozen.simulate([start.force_kn + 1.0] * 3000, [start.speed_rpm] * 3000)
    rise_mm = run["depth_mm"] - 2.66
    assert (rise_mm[-1] - rise_mm[-1001]) / 100.0 == pytest.approx(1.6e-3, rel=1e-6)
    ahead_mm = rise_mm - 1.6e-3 * run["time_s"]
    assert ahead_mm[-1] == pytest.approx(0.0238, abs=5e-5)
    at_time_constant = np.interp(14.7, run["time_s"], ahead_mm)
    assert at_time_constant == pytest.approx(ahead_mm[-1] * (1 - np.exp(-1.0)), rel=2e-3)


def test_static_gain_of_thermal_depth_loop(model, point):
    at = model.linearise(point)
    p = model.parameters
    # temperature -> depth -> torque -> power -> temperature
    gain = p.softening_gain_mm_per_c * at.c_power[0] * p.thermal_gain_c_per_kw
    assert gain == pytest.approx(0.521, abs=5e-4)


@pytest.mark.parametrize("step_kn, step_rpm", [(1.0, 0.0), (0.0, 10.0)])
def test_dead_time_is_exactly_28_samples(model, point, step_kn, step_rpm):
    run = model.simulate([point.force_kn + step_kn] * 60, [point.speed_rpm + step_rpm] * 60)
    moved = np.abs(run["temperature_c"] - 850.0) > 1e-7
    assert model.delay_steps == 28
    assert not moved[:29].any()  # row 28 is the state 2.8 s after the step: nothing has arrived yet
    assert moved[29:].all()


def test_60_s_at_equilibrium_drift_less_than_1e_9():
    model = ProcessModel()
    for depth_mm, temperature_c in ((2.66, 850.0), (2.3, 800.0), (3.0, 900.0)):
        start = model.equilibrium(depth_mm, temperature_c)
        run = model.simulate([start.force_kn] * 600, [start.speed_rpm] * 600, start)
        assert np.abs(run["depth_mm"] - depth_mm).max() < 1e-9
        assert np.abs(run["temperature_c"] - temperature_c).max() < 1e-9
        assert np.abs(run["power_kw"] / start.outputs.power_kw - 1.0).max() < 1e-9


def test_fast_pole_is_stable_in_one_step():
    model = ProcessModel()
    assert nominal().depth_pole_fast_s < 1e-3
    run = model.simulate([60.0, 95.0] * 100, [407.0] * 200)
    assert np.all(np.abs(run["depth_mm"] - 2.66) < 1.0)
