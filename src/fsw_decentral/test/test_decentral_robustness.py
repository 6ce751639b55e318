"""The shipped gains keep the bounds they are documented with, checked in two independent ways."""

import importlib.util
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from fsw_decentral import tunings
from fsw_model import ProcessModel

SCRIPT = Path(__file__).resolve().parents[3] / "scripts" / "tune_decentral.py"
STEP_S = 0.1
KW_PER_NM_RPM = math.pi / 30.0e3


@pytest.fixture(scope="module")
def tuner():
    spec = importlib.util.spec_from_file_location("tune_decentral", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


def analytic_peaks(gains, latency_ticks):
    """Ms of both loops from the frequency response of the linearised process and of the controller's equations."""
    model = ProcessModel()
    at, line = model.equilibrium(), model.linearise()
    torque, speed = at.outputs.process_torque_nm, at.speed_rpm
    p = model.parameters
    peaks = [0.0, 0.0]
    for omega in np.geomspace(2e-3, 0.95 * math.pi / STEP_S, 1500):
        s, back = 1j * omega, np.exp(-1j * omega * STEP_S)
        hold = (1.0 - back) / (s * STEP_S) * back**latency_ticks
        delay = np.exp(-s * line.dead_time_s)
        a = line.a + delay * np.outer(line.b_power, line.c_power)
        b = line.b_input + delay * np.outer(line.b_power, line.d_power)
        # what passes directly is sampled just before the inputs change
        process = line.c @ np.linalg.solve(s * np.eye(5) - a, b) * hold + line.d * back ** (1 + latency_ticks)

        def lag(time_s, back=back):
            take = 1.0 - math.exp(-STEP_S / time_s)
            return take / (1.0 - (1.0 - take) * back)

        def pi(gain, time_s, back=back):
            return gain * (1.0 + STEP_S / time_s / (1.0 - back))

        depth = pi(gains.depth_gain, gains.depth_integral_time) * lag(gains.depth_filter)
        temperature = pi(gains.temperature_gain, gains.temperature_integral_time) * lag(gains.temperature_filter)
        power = pi(gains.power_gain, gains.power_integral_time)
        by_torque = -speed / torque * lag(gains.feedforward_filter)
        by_torque -= power * KW_PER_NM_RPM * speed * lag(gains.power_filter)
        inertia = p.spindle_inertia_kgm2 * math.pi / 30.0 / STEP_S
        own = inertia * (1.0 - back) * (back ** (1 + latency_ticks) - back) - p.bearing_viscosity_nm_per_rpm * back
        solved = 1.0 - by_torque * own + power * KW_PER_NM_RPM * torque * back
        by_power = 1.0 / (torque * KW_PER_NM_RPM) + power
        controller = np.array([[depth, 0.0, 0.0], [0.0, by_power * temperature / solved, -by_torque / solved]])
        sensitivity = np.linalg.inv(np.eye(3) + process @ controller)
        peaks = [max(peaks[0], abs(sensitivity[0, 0])), max(peaks[1], abs(sensitivity[1, 1]))]
    return peaks


@pytest.mark.parametrize("name", ["conservative", "tight"])
def test_sensitivity_and_noise_are_within_the_bounds(tuner, name):
    gains, bounds = tunings()[name], tuner.SETS[name]
    peaks = tuner.sensitivity(gains)
    assert max(peaks) <= bounds.sensitivity
    force_kn, speed_rpm = tuner.noise_moves(gains)
    assert force_kn <= bounds.force_move_kn
    assert speed_rpm <= bounds.speed_move_rpm


@pytest.mark.parametrize("name", ["conservative", "tight"])
def test_simulated_sensitivity_is_that_of_the_equations(tuner, name):
    gains = tunings()[name]
    assert tuner.sensitivity(gains) == pytest.approx(analytic_peaks(gains, latency_ticks=1), rel=0.01)


def test_an_unstable_loop_has_no_finite_sensitivity(tuner):
    gains = tuner.replace(tunings()["tight"], temperature_gain=5.0)
    assert tuner.sensitivity(gains)[1] == math.inf
