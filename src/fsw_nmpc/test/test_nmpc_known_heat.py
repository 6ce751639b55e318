"""Heat that is known beforehand.

Met before it comes, ignored where it does not come, without effect where absent.
"""

from dataclasses import replace
from math import exp, nan

import numpy as np
import pytest

from fsw_control import weld
from fsw_control.heat_plan import SHARE_NAME, HeatPlan
from fsw_model import ProcessModel, nominal
from fsw_model.equations import COPPER
from fsw_nmpc.library import KERNEL, tuning_of
from fsw_nmpc.tuning import Settings, Tuning
from fsw_test_support import nmpc_loop
from fsw_test_support.nmpc_problems import (
    LIMITS,
    make_library,
    predict,
    random_moves,
    random_start,
)

P = nominal()
NOISE = (2e-3, 2.0, 0.1)  # depth mm, torque N m, temperature degC: the emulator's sensors
STEP_AT_S, STEP_KW, LENGTH_S = 60.0, 2.0, 120.0
HEAT = 6  # of `fsw_state`


class Loop:
    """The controller on its own model, into which heat flows that it does not make."""

    def __init__(self, comes, known=None, noise=True):
        self.comes, self.known = comes, known  # kW by time, of the process and of the input
        self.library, self.model = make_library(), ProcessModel(P)
        at = self.model.equilibrium()
        self.state, self.inputs = at.state.copy(), (at.force_kn, at.speed_rpm)
        self.library.reset(*self.inputs)
        self.noise = np.random.default_rng(5).normal(0.0, NOISE, (2000, 3)) * noise
        lengths = self.library.horizon.step_length_s
        self.middle_s = np.cumsum(lengths) - 0.5 * lengths
        self.temperature, self.speed, self.weight = [], [], []

    def tick(self, k):
        now_s, inputs = k * weld.TICK_S, self.library.input
        out = self.model.outputs(self.state, *self.inputs)
        shown = np.array([out.depth_mm, out.motor_torque_nm, out.temperature_c]) + self.noise[k]
        inputs.depth_mm, inputs.torque_nm, inputs.temperature_c = shown
        inputs.depth_fresh = inputs.torque_fresh = inputs.temperature_fresh = 1
        inputs.force_kn = inputs.speed_rpm = nan
        inputs.applied_force_kn, inputs.applied_speed_rpm = self.inputs
        inputs.reference_depth_mm, inputs.reference_temperature_c = (
            weld.DEPTH_MM,
            weld.TEMPERATURE_C,
        )
        inputs.dt_s = weld.TICK_S
        if self.known is not None:
            times_s = now_s + np.concatenate(
                [[-1.5 * weld.TICK_S, -0.5 * weld.TICK_S], self.middle_s]
            )
            before, last, *ahead = self.known(times_s).tolist()
            inputs.known_rise_kw = last - before
            inputs.known_ahead_kw[0 : len(ahead)] = [value - last for value in ahead]
        self.library.step()
        self.temperature.append(out.temperature_c)
        self.speed.append(self.inputs[1])
        self.weight.append(self.library.state.estimator.known_weight)
        self.inputs = self.library.output.force_kn, self.library.output.speed_rpm
        self.model.step(self.state, *self.inputs)
        x = list(self.state.x)
        x[COPPER] += (
            P.thermal_gain_c_per_kw
            * (1.0 - exp(-weld.TICK_S / P.copper_lag_s))
            * float(self.comes(np.array(now_s + 0.5 * weld.TICK_S)))
        )
        self.state.x = tuple(x)

    def run(self):
        for k in range(round(LENGTH_S / weld.TICK_S)):
            self.tick(k)
        return self

    def rms_c(self):
        return float(np.sqrt(np.mean((np.array(self.temperature) - weld.TEMPERATURE_C) ** 2)))


def nothing(time_s):
    return np.zeros_like(time_s)


def step(time_s):
    return np.where(time_s < STEP_AT_S, 0.0, STEP_KW)


def test_known_heat_is_part_of_the_prediction(library, rng):
    """The same over the whole horizon is a heat offset; what begins later acts from then on."""
    start, moves = random_start(rng, library.horizon, P), random_moves(rng, library.horizon)
    _, before, _, _ = predict(library, start, moves)
    n, time_s = len(library.horizon.step_length_s), library.horizon.time_s
    start.heat_ahead_kw[0:n] = [1.5] * n
    _, ahead, _, _ = predict(library, start, moves)
    start.heat_ahead_kw[0:n] = [0.0] * n
    start.x[HEAT] += 1.5
    _, offset, _, _ = predict(library, start, moves)
    assert ahead == pytest.approx(offset, rel=1e-12)
    start.x[HEAT] -= 1.5
    start.heat_ahead_kw[0:n] = np.where(
        np.cumsum(library.horizon.step_length_s) > 2.05, 1.5, 0.0
    ).tolist()
    _, later, _, _ = predict(library, start, moves)
    assert (later[time_s < 2.05] == before[time_s < 2.05]).all()
    assert (later[time_s > 2.05] > before[time_s > 2.05]).all()


def test_the_controller_moves_before_a_known_step():
    unknown, known = Loop(step).run(), Loop(step, step).run()
    at = round(STEP_AT_S / weld.TICK_S)
    moved = np.array(known.speed)[at - 1] - np.array(unknown.speed)[at - 1]
    assert moved < -5.0  # rpm, and nothing of the step has been measured yet
    assert known.rms_c() < 0.4 * unknown.rms_c()
    assert min(known.weight) > 0.9


def test_absent_known_heat_is_ignored_within_seconds():
    """So a second step of the same wrong knowledge moves nothing."""

    def twice(time_s):
        return step(time_s) + step(time_s - 30.0)

    wrong, once = Loop(nothing, twice).run(), Loop(nothing, step).run()
    ignored = np.flatnonzero(np.array(wrong.weight) == 0.0)
    assert STEP_AT_S < ignored[0] * weld.TICK_S < STEP_AT_S + 5.0
    assert wrong.speed == pytest.approx(once.speed, abs=0.01)  # rpm; the first one moves 19


def test_known_heat_of_wrong_sign_is_ignored_within_seconds():
    mirrored = Loop(step, lambda time_s: -step(time_s)).run()
    ignored = np.flatnonzero(np.array(mirrored.weight) == 0.0)
    assert STEP_AT_S < ignored[0] * weld.TICK_S < STEP_AT_S + 5.0


def test_known_heat_widens_the_start_of_the_estimator():
    """Heat that has just come is found within seconds, while the thermocouple is still late."""
    heat_kw = 6.0

    def estimated_kw(deviation_kw):
        loop = Loop(lambda time_s: np.full_like(time_s, heat_kw))
        loop.library.input.known_deviation_kw = deviation_kw
        for k in range(round(8.0 / weld.TICK_S)):
            loop.tick(k)
            loop.library.input.known_deviation_kw = 0.0  # of the first tick alone
        return loop.library.state.estimator.x[HEAT]

    assert estimated_kw(0.0) < 0.5 * heat_kw
    assert estimated_kw(0.01) == pytest.approx(heat_kw, rel=0.1)


@pytest.mark.parametrize("value", [0.0, nan])
def test_zero_or_nan_known_heat_changes_nothing(value):
    """Not a bit: of zeros, as of an input that is not finite."""

    def absent(time_s):
        return np.full_like(time_s, value)

    plain, with_heat = Loop(step).run(), Loop(step, absent).run()
    assert with_heat.speed == plain.speed
    assert with_heat.temperature == plain.temperature


@pytest.mark.parametrize(
    ("model", "is_used"),
    [
        (P.model_dump(), True),
        ({"copper_lag_s": 11.0}, False),
        ({"no_such": 1.0}, False),
        ({"model_dump": 1.0}, False),
        ({}, False),
    ],
)
def test_only_heat_of_the_same_thermal_model_is_used(model, is_used):
    """Any other leaves the controller proposing."""
    plan = HeatPlan([0.0, 60.0], [0.0, 1.0], [0.0, 0.1], model)
    proposal = nmpc_loop.Loop().step(replace(nmpc_loop.TARGET, heat=plan))
    assert proposal.healthy
    assert (SHARE_NAME in proposal.diagnosis.disturbances) == is_used


def test_known_heat_evidence_of_0_is_refused():
    library = make_library()
    settings = Settings(P, Tuning(), LIMITS)
    tuning = tuning_of(settings)
    tuning.estimator.known_heat_evidence = 0.0
    assert library.lib.fsw_nmpc_configure(library.state, tuning) == 1
    assert KERNEL.lib.fsw_nmpc_configure(library.state, tuning_of(settings)) == 0
