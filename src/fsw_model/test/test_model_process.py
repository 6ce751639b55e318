"""Check values of the paper's process, and step, equilibrium, linearisation and simulation as a user meets them."""

import sys
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from math import inf, nan, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_model import (
    STEP_S,
    OperatingPointError,
    OutsideModelError,
    ProcessModel,
    ProcessState,
    nominal,
)
from fsw_model.equations import COPPER, N_STATES, STATE_NAMES, TOOL

MODEL = ProcessModel()
OTHER = ProcessModel(nominal().scaled(thermal_gain_c_per_kw=1.2))
STATES = st.tuples(
    st.floats(-0.5, 0.5),
    st.floats(-0.5, 0.5),
    st.floats(-1e-4, 1e-4),
    st.floats(-100.0, 100.0),
    st.floats(-100.0, 100.0),
    st.floats(500.0, 1500.0),
)
POWERS = st.tuples(*[st.floats(-20.0, 20.0)] * 4)


@given(STATES, POWERS, POWERS, st.floats(20.0, 120.0), st.floats(0.0, 600.0))
def test_step_and_outputs_are_the_casadi_functions(x, older, newer, force, speed):
    """In numbers, also when another model has been used meanwhile."""
    state = ProcessState(
        x, deque([older, newer, *MODEL.equilibrium().state.power][: MODEL.delay_steps])
    )
    expected_x, expected_power, _ = MODEL.step_function(list(x), older, newer, force, speed)
    outputs = MODEL.outputs(state, force, speed)
    MODEL.step(state, force, speed)
    OTHER.outputs(OTHER.equilibrium().state, 70.0, 300.0)
    assert state.x == tuple(expected_x.nonzeros())
    assert (state.power[0], state.power[-1]) == (newer, tuple(expected_power.nonzeros()))
    expected = [float(value) for value in MODEL.output_function(list(x), force, speed)]
    assert outputs == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_check_values_at_the_operating_point():
    point = MODEL.equilibrium()
    p, shown = MODEL.parameters, point.outputs
    assert (point.force_kn, shown.depth_mm, shown.temperature_c) == (78.4, 2.66, 816.4)
    radius_m = p.contact_radius_m + p.contact_slope * 2.66e-3
    area_m2 = pi * radius_m**2
    geometry_m3 = p.geometry_offset_m3 + p.geometry_factor * (radius_m**3 - p.contact_radius_m**3)
    assert area_m2 == pytest.approx(3.366e-3, abs=0.5e-6)
    assert 78.4e3 / area_m2 == pytest.approx(23.3e6, abs=0.05e6)
    assert geometry_m3 == pytest.approx(9.933e-5, abs=0.5e-8)
    assert shown.process_torque_nm == pytest.approx(1021.53, abs=5e-3)
    assert shown.power_kw == pytest.approx(43.6, abs=1e-12)
    assert point.speed_rpm == pytest.approx(407.576, abs=5e-4)
    assert shown.friction_torque_nm == pytest.approx(31.333, abs=5e-4)
    assert shown.motor_torque_nm == pytest.approx(1052.86, abs=5e-3)


def test_slopes_and_loop_gain():
    linear, p = MODEL.linearise(), MODEL.parameters
    by_depth = linear.a[5, 0] * p.motor_lag_s
    by_force = linear.b[5, 0] * p.motor_lag_s
    assert by_depth == pytest.approx(120.8, abs=0.05)  # dM/dz, N m per mm
    assert by_force == pytest.approx(12.84, abs=5e-3)  # dM/dF, N m per kN
    # temperature -> depth -> torque -> power -> temperature
    per_degree_mm = p.softening_per_c * p.operating_depth_mm
    assert per_degree_mm * by_depth * linear.c_power[5] * p.thermal_gain_c_per_kw == pytest.approx(
        0.521, abs=5e-4
    )


def test_depth_creeps_after_a_transient():
    """+1 kN without thermal feedback.

    1.6 um/s in the end, the line 0.0238 mm ahead, 14.7 s to get there.
    """
    frozen = ProcessModel(nominal().changed(softening_per_c=0.0))
    start = frozen.equilibrium()
    run = frozen.simulate([start.force_kn + 1.0] * 3000, [start.speed_rpm] * 3000)
    rise_mm = run["depth_mm"] - 2.66
    assert (rise_mm[-1] - rise_mm[-1001]) / 100.0 == pytest.approx(1.6e-3, rel=1e-6)
    ahead_mm = rise_mm - 1.6e-3 * run["time_s"]
    assert ahead_mm[-1] == pytest.approx(0.0238, abs=5e-5)
    at_time_constant = np.interp(14.7, run["time_s"], ahead_mm)
    assert at_time_constant == pytest.approx(ahead_mm[-1] * (1 - np.exp(-1.0)), rel=2e-3)


@pytest.mark.parametrize("step_kn, step_rpm", [(1.0, 0.0), (0.0, 10.0)])
@pytest.mark.parametrize("dead_time_s, first", [(2.8, 29), (2.85, 29), (0.1, 2), (3.0, 31)])
def test_temperature_moves_after_the_dead_time(step_kn, step_rpm, dead_time_s, first):
    model = ProcessModel(nominal().changed(dead_time_s=dead_time_s))
    start = model.equilibrium()
    run = model.simulate([start.force_kn + step_kn] * 60, [start.speed_rpm + step_rpm] * 60)
    moved = np.abs(run["temperature_c"] - 816.4) > 1e-9
    assert not moved[:first].any()
    assert moved[first:].all()


@given(st.floats(1.5, 4.0), st.floats(700.0, 1000.0))
def test_equilibrium_holds(depth_mm, temperature_c):
    start = MODEL.equilibrium(depth_mm, temperature_c)
    assert start.outputs.depth_mm == pytest.approx(depth_mm, rel=1e-12)
    assert start.outputs.temperature_c == pytest.approx(temperature_c, rel=1e-12)
    state = start.state.copy()
    for _ in range(600):
        MODEL.step(state, start.force_kn, start.speed_rpm)
    assert state.x == pytest.approx(start.state.x, abs=1e-9)


def test_copper_leads_the_tool():
    start = MODEL.equilibrium()
    run = MODEL.simulate([start.force_kn] * 300, [start.speed_rpm + 20.0] * 300)
    lag_s = MODEL.parameters.tool_lag_s
    copper, tool = run["copper_temperature_c"][60:], run["temperature_c"][60:]
    assert (copper - tool)[:-1] == pytest.approx(lag_s * np.diff(tool) / 0.1, rel=0.05)
    assert STATE_NAMES[COPPER] == "copper_c" and STATE_NAMES[TOOL] == "tool_c"


def test_copy_is_independent():
    start = MODEL.equilibrium()
    before = start.state.x, list(start.state.power)
    MODEL.step(start.state.copy(), 90.0, 450.0)
    assert (start.state.x, list(start.state.power)) == before


@pytest.mark.parametrize("depth_mm, temperature_c", [(2.66, 816.4), (2.2, 850.0)])
def test_linearisation_equals_finite_differences(depth_mm, temperature_c):
    """The stepped model after a small push, against the linear one's own simulation with its delay."""
    from scipy.linalg import expm

    start = MODEL.equilibrium(depth_mm, temperature_c)
    linear = MODEL.linearise(start)
    push, steps, fine = np.array([0.01, 0.1]), 100, 20
    run = MODEL.simulate(
        [start.force_kn + push[0]] * steps, [start.speed_rpm + push[1]] * steps, start
    )
    h = STEP_S / fine
    chain = np.zeros((N_STATES + 2, N_STATES + 2))
    chain[:N_STATES, :N_STATES], chain[:N_STATES, N_STATES], chain[:N_STATES, N_STATES + 1] = (
        linear.a,
        linear.b @ push,
        linear.b_power,
    )
    e = expm(chain * h)
    x, powers, rows = np.zeros(N_STATES), [0.0] * round(linear.dead_time_s / h), []
    for k in range(steps * fine):
        if k % fine == 0:
            rows.append(linear.c @ x)
        powers.append(linear.c_power @ x + linear.d_power @ push)
        x = (
            e[:N_STATES, :N_STATES] @ x
            + e[:N_STATES, N_STATES]
            + e[:N_STATES, N_STATES + 1] * powers[k]
        )
    for i, name in enumerate(("depth_mm", "temperature_c", "motor_torque_nm")):
        moved = run[name] - run[name][0]
        assert moved == pytest.approx(np.array(rows)[:, i], abs=5e-3 * np.abs(moved).max()), name


def test_frequency_response_is_that_of_the_stepped_model():
    """Excite the stepped model with a slow sine and compare gain and phase, hold of the inputs included."""
    period_s, cycles = 100.0, 12
    omega = 2 * np.pi / period_s
    start = MODEL.equilibrium()
    t = np.arange(round(period_s * cycles * 10)) * 0.1
    run = MODEL.simulate(
        [start.force_kn] * len(t), list(start.speed_rpm + 0.1 * np.sin(omega * t))
    )
    last = slice(len(t) - 1000, len(t))
    hold = np.exp(-0.5j * omega * 0.1) * np.sinc(omega * 0.1 / (2 * np.pi))
    response = MODEL.linearise(start).frequency_response(np.array([omega]))[0] * hold
    for row, name in ((0, "depth_mm"), (1, "temperature_c"), (2, "motor_torque_nm")):
        settled = run[name][last] - run[name][last].mean()
        measured = 2 * np.mean(settled * np.exp(-1j * omega * t[last])) * 1j / 0.1
        assert measured == pytest.approx(response[row, 1], rel=5e-3)


@pytest.mark.parametrize(
    "depth_mm, temperature_c",
    [(0.0, 816.4), (nan, 816.4), (inf, 816.4), (2.66, 20.0), (2.66, inf), (2.66, nan)],
)
def test_no_equilibrium(depth_mm, temperature_c):
    with pytest.raises(OperatingPointError, match="no equilibrium"):
        MODEL.equilibrium(depth_mm, temperature_c)


@pytest.mark.parametrize("force, speed", [(nan, 400.0), (78.4, nan), (inf, 400.0), (78.4, -inf)])
def test_inputs_must_be_finite(force, speed):
    state = MODEL.equilibrium().state.copy()
    with pytest.raises(OutsideModelError) as raised:
        MODEL.step(state, force, speed)
    assert [raised.value.force_kn, raised.value.speed_rpm] == pytest.approx(
        [force, speed], nan_ok=True
    )
    assert state == MODEL.equilibrium().state


def test_leaving_the_copper_is_an_error_and_the_state_stays():
    state = MODEL.equilibrium().state.copy()
    with pytest.raises(OutsideModelError) as raised:
        for _ in range(100_000):
            before = state.copy()
            MODEL.step(state, 0.0, 400.0)
    assert -0.1 < raised.value.depth_mm <= 0.0
    assert state == before
    assert 0.0 < MODEL.outputs(state, 0.0, 400.0).depth_mm < 0.1


def test_fast_pole_is_stable_in_one_step():
    run = MODEL.simulate([60.0, 95.0] * 100, [407.0] * 200)
    assert np.all(np.abs(run["depth_mm"] - 2.66) < 1.0)


def test_simulate_input_contract():
    with pytest.raises(ValueError, match=r"2 forces .* 1 speeds"):
        MODEL.simulate([78.4, 78.4], [400.0])
    longer = ProcessModel(nominal().changed(dead_time_s=3.0))
    with pytest.raises(ValueError, match=r"28 steps .* 30"):
        longer.simulate([78.4], [400.0], MODEL.equilibrium())
    assert all(len(column) == 0 for column in MODEL.simulate([], []).values())


def test_rows_show_the_inputs_that_begin_there():
    start = MODEL.equilibrium()
    run = MODEL.simulate([start.force_kn, start.force_kn + 1.0], [start.speed_rpm] * 2)
    assert run["time_s"].tolist() == [0.0, 0.1]
    assert run["force_kn"][1] - run["force_kn"][0] == pytest.approx(1.0)
    assert run["process_torque_nm"][1] - run["process_torque_nm"][0] == pytest.approx(
        12.84, abs=0.05
    )
    assert run["motor_torque_nm"][1] == pytest.approx(
        run["motor_torque_nm"][0], rel=1e-12
    )  # a state: it has a lag


def test_threads_do_not_disturb_each_other():
    """Plants with the same parameters have one model, and each may run in a thread of its own."""
    model = ProcessModel()
    state = model.equilibrium().state
    alone = {rpm: model.outputs(state, 78.4, rpm) for rpm in (380.0, 420.0)}

    def is_as_alone(rpm):
        return all(model.outputs(state, 78.4, rpm) == alone[rpm] for _ in range(5000))

    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor() as pool:
            assert all(pool.map(is_as_alone, alone))
    finally:
        sys.setswitchinterval(before)
