"""Smith predictor and decoupling.

Against plain references, and without effect where they are not asked for.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fsw_control import Command, Measurement, Reference
from fsw_control.units import KW_PER_NM_RPM
from fsw_control.weld import DEPTH_MM, FORCE_KN, SPEED_RPM, TEMPERATURE_C, TICK_S
from fsw_decentral import DecentralController, tunings
from fsw_model import ProcessModel

REFERENCE, NOMINAL = Reference(DEPTH_MM, TEMPERATURE_C), Command(FORCE_KN, SPEED_RPM)
TORQUE_NM, NAN = 1000.0, float("nan")
#: so that the process torque is the measured one
IDEAL = {
    "friction.constant": 0.0,
    "friction.linear": 0.0,
    "friction.quadratic": 0.0,
    "spindle_inertia": 0.0,
}
SMITH = {"tuning": "smith"} | IDEAL


def sample(temperature_c=TEMPERATURE_C, torque_nm=TORQUE_NM, depth_mm=DEPTH_MM):
    valid = not math.isnan(temperature_c), not math.isnan(torque_nm)
    return Measurement(
        0.0,
        depth_mm,
        torque_nm,
        temperature_c,
        temperature_valid=valid[0],
        torque_valid=valid[1],
        depth_valid=True,
    )


def correction_c(controller):
    return controller.library.state.predictor.correction_c


def plain_correction(powers, gain, copper_lag, tool_lag, dead_time):
    """Response of the two lags in series to steps of power, less the same one dead time ago."""
    shares = [1.0 - math.exp(-TICK_S / lag) if lag else 1.0 for lag in (copper_lag, tool_lag)]
    copper, response = powers[0], [powers[0]]
    for power in powers:
        before, copper = copper, copper + shares[0] * (power - copper)
        response.append(response[-1] + shares[1] * (0.5 * (before + copper) - response[-1]))
    past = np.interp(len(powers) - dead_time / TICK_S, np.arange(len(response)), response)
    return gain * (response[-1] - past)


@settings(deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(300.0, 2000.0), st.floats(300.0, 500.0), st.integers(1, 4)),
        min_size=1,
        max_size=120,
    ),
    st.floats(0.1, 40.0),
    st.floats(0.0, 60.0),
    st.floats(0.0, 5.0),
    st.floats(0.1, 10.0),
)
def test_the_correction_is_that_of_a_plain_reference(
    samples, gain, copper_lag, tool_lag, dead_time
):
    names = ("predictor_gain", "predictor_copper_lag", "predictor_tool_lag", "predictor_dead_time")
    model = dict(zip(names, (gain, copper_lag, tool_lag, dead_time), strict=True))
    controller, powers = DecentralController(SMITH | model), []
    for torque, speed, ticks in samples:
        controller.step(
            sample(torque_nm=torque), REFERENCE, Command(FORCE_KN, speed), ticks * TICK_S
        )
        powers += [torque * speed * KW_PER_NM_RPM] * ticks
    assert correction_c(controller) == pytest.approx(
        plain_correction(powers, *model.values()), rel=1e-9, abs=1e-9 * gain
    )


class LinearHeat:
    """Temperature over power, the paper's (16) without dead time, exact for a power that is constant within ticks."""

    def __init__(self, gain=18.1, copper_lag=30.5, tool_lag=1.2):
        self.gain, self.lags = gain, np.array([copper_lag, tool_lag])
        self.weights = self.lags * (1.0, -1.0) / (copper_lag - tool_lag)
        self.parts = np.zeros(2)

    def step(self, power_kw):
        self.parts += (1.0 - np.exp(-TICK_S / self.lags)) * (power_kw - self.parts)
        return TEMPERATURE_C + self.gain * float(self.weights @ self.parts)


def set_point_step(controller, dead_ticks, ticks=900):
    """Temperatures and speeds of a loop with ``LinearHeat`` late by a dead time, from rest."""
    heat, under_way, applied = LinearHeat(), [TEMPERATURE_C] * (dead_ticks + 1), NOMINAL
    controller.reset(applied)
    speeds = []
    for k in range(ticks):
        goal = Reference(DEPTH_MM, TEMPERATURE_C + (3.0 if k >= 5 else 0.0))
        applied = controller.step(sample(under_way[k]), goal, applied, TICK_S).command
        speeds.append(applied.speed_rpm)
        under_way.append(heat.step(TORQUE_NM * KW_PER_NM_RPM * (applied.speed_rpm - SPEED_RPM)))
    return np.array(under_way[:ticks]), np.array(speeds)


@pytest.mark.parametrize("dead_ticks", [28, 70])
def test_smith_predictor_with_true_model_only_delays_the_response(dead_ticks):
    late = DecentralController(SMITH | {"predictor_dead_time": dead_ticks * TICK_S})
    prompt = DecentralController(SMITH | {"predictor_dead_time": 0.0})
    (warm, speeds), (goal, goal_speeds) = (
        set_point_step(late, dead_ticks),
        set_point_step(prompt, 0),
    )
    assert np.ptp(goal_speeds) > 10.0
    assert speeds == pytest.approx(goal_speeds, abs=0.02)
    assert warm[dead_ticks:] == pytest.approx(goal[:-dead_ticks], abs=2e-3)
    unpredicted, _ = set_point_step(prompt, dead_ticks)
    assert np.abs(unpredicted[dead_ticks:] - goal[:-dead_ticks]).max() > 1.0


@pytest.mark.parametrize("off", ["predictor_dead_time", "predictor_gain"])
def test_without_dead_time_or_gain_it_is_the_plain_pi_to_the_bit(off):
    plain = {
        name: 0.0 for name in tunings()["smith"].model_fields_set if name.startswith("predictor")
    }
    runs = [
        set_point_step(DecentralController(SMITH | other), 28, 200)[1]
        for other in ({off: 0.0}, plain)
    ]
    assert np.array_equal(*runs)


def in_motion():
    """A controller and a command 1.5 s after a step of the set-point, with power under way."""
    controller, applied = DecentralController(SMITH), NOMINAL
    goal = Reference(DEPTH_MM, TEMPERATURE_C + 5.0)
    controller.step(sample(), REFERENCE, applied, TICK_S)
    for _ in range(15):
        applied = controller.step(sample(), goal, applied, TICK_S).command
    assert correction_c(controller) > 0.5
    return controller, goal, applied


def test_model_change_at_runtime_is_bumpless():
    for change in (
        {"predictor_dead_time": 1.0},
        {"predictor_gain": 9.0},
        {"predictor_gain": 0.0},
        {},
    ):
        controller, goal, applied = in_motion()
        as_before, _, _ = in_motion()
        controller.configure(change)
        assert (correction_c(controller) == 0.0) == bool(change)
        commands = [
            each.step(sample(), goal, applied, TICK_S).command.speed_rpm
            for each in (controller, as_before)
        ]
        assert commands[0] == pytest.approx(commands[1], abs=0.5 if change else 0.0)


def test_reset_forgets_the_power_under_way():
    controller, _, applied = in_motion()
    controller.reset(applied)
    assert correction_c(controller) == 0.0
    again = controller.step(sample(), REFERENCE, applied, TICK_S).command
    assert again.speed_rpm == pytest.approx(applied.speed_rpm, abs=1e-6)


def test_prediction_continues_without_temperature():
    controller, goal, applied = in_motion()
    twin, _, _ = in_motion()
    for _ in range(20):  # the speed is held by another controller
        controller.step(sample(NAN), goal, applied, TICK_S)
        twin.step(sample(), goal, applied, TICK_S)
    assert correction_c(controller) == correction_c(twin) > 1.0
    back = controller.step(sample(), goal, applied, TICK_S)
    assert back.healthy and back.command.speed_rpm == pytest.approx(applied.speed_rpm, abs=1.0)


def test_without_torque_the_last_one_counts():
    controller, goal, applied = in_motion()
    twin, _, _ = in_motion()
    for _ in range(20):
        proposals = [
            each.step(sample(torque_nm=torque), goal, applied, TICK_S)
            for each, torque in ((controller, NAN), (twin, TORQUE_NM))
        ]
        assert proposals[0] == proposals[1]


def test_an_absurd_torque_leaves_no_trace_in_the_prediction():
    controller, goal, applied = in_motion()
    reasons = [
        controller.step(sample(torque_nm=nm), goal, applied, TICK_S).healthy
        for nm in (1e20, TORQUE_NM)
    ]
    assert reasons == [False, True]
    assert correction_c(controller) == 0.0


@pytest.mark.parametrize("size_mm", [0.03, -0.03])
def test_decoupled_a_depth_step_hardly_disturbs_the_temperature(size_mm):
    peaks = []
    for torque in (0.0, tunings()["smith"].decoupling_torque):
        model, goal = ProcessModel(), Reference(DEPTH_MM + size_mm, TEMPERATURE_C)
        start = model.equilibrium()
        state, applied = start.state.copy(), Command(start.force_kn, start.speed_rpm)
        controller = DecentralController(
            {"tuning": "smith", "decoupling_torque": torque, "spindle_inertia": 0.0}
        )
        off = []
        for _ in range(300):
            out = model.outputs(state, applied.force_kn, applied.speed_rpm)
            measured = sample(out.temperature_c, out.motor_torque_nm, out.depth_mm)
            applied = controller.step(measured, goal, applied, TICK_S).command
            model.step(state, applied.force_kn, applied.speed_rpm)
            off.append(abs(out.temperature_c - TEMPERATURE_C))
        peaks.append(max(off))
    assert peaks[1] < 0.6 * peaks[0]
