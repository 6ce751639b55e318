"""The deviations that are told along the horizon.

Those of the estimator, and as large as the errors are.
"""

import numpy as np
import pytest

from fsw_control import Command, Measurement, Reference, weld
from fsw_model import ProcessModel, nominal
from fsw_nmpc import NmpcController

NOISE = (2e-3, 2.0, 0.1)  # depth mm, torque N m, temperature degC: the emulator's sensors
SEEN = Reference(weld.DEPTH_MM, weld.TEMPERATURE_C)


class Weld:
    """The controller on its own model, with noise."""

    def __init__(self):
        self.model, self.controller = ProcessModel(nominal()), NmpcController()
        at = self.model.equilibrium(SEEN.depth_mm, SEEN.temperature_c)
        self.state, self.command, self.rng = (
            at.state.copy(),
            Command(at.force_kn, at.speed_rpm),
            np.random.default_rng(3),
        )
        self.controller.reset(self.command)
        self.k = 0

    def tick(self, **valid):
        """One tick; returns what the sensors showed, and the plan."""
        out = self.model.outputs(self.state, *self.command)
        shown = np.array([out.depth_mm, out.motor_torque_nm, out.temperature_c]) + self.rng.normal(
            0.0, NOISE
        )
        self.k += 1
        measurement = Measurement(self.k * weld.TICK_S, *shown, **valid)
        proposal = self.controller.step(measurement, SEEN, self.command, weld.TICK_S)
        self.model.step(self.state, *self.command)
        self.command = proposal.command
        return shown[[0, 2]], proposal.diagnosis.plan

    def deviations(self, plan):
        return np.array(self.controller.plan_deviations(plan.time_s))


@pytest.fixture
def welded():
    weld = Weld()
    for _ in range(300):
        weld.plan = weld.tick()[1]
    return weld


def test_most_measurements_lie_within_two_deviations(welded):
    shown, predicted = [], []
    for _ in range(400):
        seen, plan = welded.tick()
        shown.append(seen)
        predicted.append((np.array([plan.depth_mm, plan.temperature_c]), welded.deviations(plan)))
    for ahead in (1, 5, 10):
        errors = [
            (shown[k + ahead] - value[:, ahead - 1]) / deviation[:, ahead - 1]
            for k, (value, deviation) in enumerate(predicted[:-ahead])
        ]
        ratio = np.sqrt(np.mean(np.square(errors), axis=0))
        assert (ratio > 0.6).all() and (ratio < 1.2).all(), (ahead, ratio)
        assert (np.mean(np.abs(errors) < 2.0, axis=0) > 0.93).all(), ahead


def test_predicted_deviations_match_the_estimator_without_sensors(welded):
    ahead = welded.deviations(welded.plan)
    for ticks in range(1, 26):
        plan = welded.tick(depth_valid=False, torque_valid=False, temperature_valid=False)[1]
        # a sensor of which nothing is known: its own share is the noise, as before
        come_to = welded.deviations(plan)[:, 0]
        assert ahead[:, ticks] == pytest.approx(come_to, rel=0.03), ticks


def test_deviation_grows_along_the_horizon_and_without_a_sensor(welded):
    sure = welded.deviations(welded.plan)
    assert (np.diff(sure) >= 0.0).all()
    for _ in range(20):
        plan = welded.tick(temperature_valid=False)[1]
    blind = welded.deviations(plan)[1]
    assert (blind > sure[1]).all() and (blind[:20] > 1.2 * sure[1][:20]).all()
