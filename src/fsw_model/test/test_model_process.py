"""Step, equilibrium, linearisation, simulation: behaviour and input contract."""

from math import inf, nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_model import OperatingPointError, ProcessModel, nominal
from fsw_model.equations import N_STATES, STATE_NAMES

MODEL = ProcessModel()


@given(st.floats(1.5, 4.0), st.floats(700.0, 1000.0))
def test_equilibrium_holds(depth_mm, temperature_c):
    start = MODEL.equilibrium(depth_mm, temperature_c)
    assert start.outputs.depth_mm == pytest.approx(depth_mm, rel=1e-12)
    assert start.outputs.temperature_c == temperature_c
    state = start.state.copy()
    for _ in range(60):
        MODEL.step(state, start.force_kn, start.speed_rpm)
    assert state.x == pytest.approx(start.state.x, abs=1e-9)


def test_copy_is_independent():
    start = MODEL.equilibrium()
    before = start.state.x, list(start.state.power_kw)
    MODEL.step(start.state.copy(), 90.0, 450.0)
    assert (start.state.x, list(start.state.power_kw)) == before


@pytest.mark.parametrize("depth_mm, temperature_c", [(2.66, 850.0), (2.2, 800.0)])
def test_linearisation_equals_finite_differences(depth_mm, temperature_c):
    """Small steps of the non-linear model against the linear one's own simulation."""
    start = MODEL.equilibrium(depth_mm, temperature_c)
    at = MODEL.linearise(start)
    assert at.a.shape == (N_STATES, N_STATES) and len(STATE_NAMES) == N_STATES

    def motor(x, force, speed):
        out = MODEL.outputs(type(start.state)(tuple(x), start.state.power_kw), force, speed)
        return np.array([out.depth_mm, out.temperature_c, out.motor_torque_nm, out.power_kw])

    x0, h = np.array(start.state.x), 1e-5
    for i in range(N_STATES):
        e = np.eye(N_STATES)[i] * h
        slope = (motor(x0 + e, start.force_kn, start.speed_rpm) - motor(x0 - e, start.force_kn, start.speed_rpm)) / (
            2 * h
        )
        assert np.append(at.c[:, i], at.c_power[i]) == pytest.approx(slope, rel=1e-6, abs=1e-7)
    for i, (df, dn) in enumerate([(h, 0.0), (0.0, h)]):
        slope = (
            motor(x0, start.force_kn + df, start.speed_rpm + dn) - motor(x0, start.force_kn - df, start.speed_rpm - dn)
        ) / (2 * h)
        assert np.append(at.d[:, i], at.d_power[i]) == pytest.approx(slope, rel=1e-6, abs=1e-7)


def test_frequency_response_is_that_of_the_stepped_model():
    """Excite the stepped model with a slow sine and compare gain and phase, hold of the inputs included."""
    period_s, cycles = 100.0, 12
    omega = 2 * np.pi / period_s
    # without creep the response settles to a sine: speed as input does not excite the integrator
    start = MODEL.equilibrium()
    t = np.arange(round(period_s * cycles * 10)) * 0.1
    run = MODEL.simulate([start.force_kn] * len(t), list(start.speed_rpm + 0.1 * np.sin(omega * t)))
    last = slice(len(t) - 1000, len(t))
    hold = np.exp(-0.5j * omega * 0.1) * np.sinc(omega * 0.1 / (2 * np.pi))
    response = MODEL.linearise(start).frequency_response(np.array([omega]))[0] * hold
    for row, name in ((0, "depth_mm"), (1, "temperature_c")):
        settled = run[name][last] - run[name][last].mean()
        measured = 2 * np.mean(settled * np.exp(-1j * omega * t[last])) * 1j / 0.1
        assert measured == pytest.approx(response[row, 1], rel=5e-3)


@pytest.mark.parametrize(
    "depth_mm, temperature_c", [(0.5, 850.0), (nan, 850.0), (2.66, 20.0), (2.66, inf), (inf, 850.0)]
)
def test_no_equilibrium(depth_mm, temperature_c):
    with pytest.raises(OperatingPointError, match="no equilibrium at"):
        MODEL.equilibrium(depth_mm, temperature_c)


@pytest.mark.parametrize("force, speed", [(nan, 400.0), (78.4, nan), (inf, 400.0), (78.4, -inf)])
def test_inputs_must_be_finite(force, speed):
    with pytest.raises(OperatingPointError, match="no contact torque"):
        MODEL.step(MODEL.equilibrium().state.copy(), force, speed)


def test_leaving_the_copper_is_an_error_at_once():
    state = MODEL.equilibrium().state.copy()
    shallowest = nominal().shallowest_depth_mm
    with pytest.raises(OperatingPointError, match=r"above 0\.525 mm"):
        for _ in range(100_000):
            MODEL.step(state, 0.0, 0.0)
            assert 2.66 + sum(state.x[:4]) > shallowest - 0.1
    with pytest.raises(OperatingPointError):
        MODEL.outputs(state, 78.4, 400.0)


def test_simulate_input_contract():
    with pytest.raises(ValueError, match="2 forces but 1 speeds"):
        MODEL.simulate([78.4, 78.4], [400.0])
    slower = ProcessModel(nominal().with_values(dead_time_s=3.0))
    with pytest.raises(ValueError, match="28 steps of dead time, model 30"):
        slower.simulate([78.4], [400.0], MODEL.equilibrium())
    nothing = MODEL.simulate([], [])
    assert nothing["time_s"].tolist() == [0.0] and nothing["depth_mm"].tolist() == [2.66]


def test_simulated_torque_belongs_to_the_inputs_of_the_step_that_ended():
    start = MODEL.equilibrium()
    run = MODEL.simulate([start.force_kn + 1.0], [start.speed_rpm])
    assert run["motor_torque_nm"][1] - run["motor_torque_nm"][0] == pytest.approx(12.84, abs=0.05)
    assert run["time_s"].tolist() == [0.0, 0.1]
