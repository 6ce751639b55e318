"""The controller stays within bounds and moves, whatever comes.

Samples, set-points, applied commands.
"""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fsw_control import Command, Limits, Measurement, Reference
from fsw_control.contract import Coming
from fsw_control.reason import ReasonCode
from fsw_nmpc import NmpcController
from fsw_test_support.nmpc_loop import TARGET, Loop, within

NAN = float("nan")
BOUNDED = NmpcController()


@pytest.mark.requirement("S4")
@pytest.mark.parametrize("value", [NAN, math.inf, -math.inf, 1e300, -1e300, 0.0])
@pytest.mark.parametrize("sensor", ["depth_mm", "torque_nm", "temperature_c"])
def test_absurd_samples_keep_the_command_within_limits(sensor, value):
    """Never an exception nor a command beyond limits; sound again at once when the sensor is."""
    loop = Loop()
    for _ in range(20):
        loop.step()
    for _ in range(3):
        before = loop.applied
        assert within(loop.step(**{sensor: value}), before)
    for _ in range(250):
        proposal = loop.step()
    assert proposal.healthy
    assert abs(loop.shown.depth_mm - 2.66) < 0.01
    assert abs(loop.shown.temperature_c - 816.4) < 1.0


@pytest.mark.requirement("S4")
@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(
    depth=st.floats(2.3, 3.0),
    temperature=st.floats(780.0, 880.0),
    force=st.floats(55.0, 100.0),
    speed=st.floats(280.0, 520.0),
    seed=st.integers(0, 1000),
)
def test_limits_hold_always(depth, temperature, force, speed, seed):
    """Any set-point, any applied command.

    Every proposal is within bounds and moves of the applied command.
    """
    rng = np.random.default_rng(seed)
    loop = Loop()
    loop.applied = Command(force, speed)
    for _ in range(30):
        before, shown = loop.applied, loop.shown
        proposal = loop.step(
            Reference(depth, temperature), depth_mm=shown.depth_mm + rng.normal(0, 2e-3)
        )
        assert within(proposal, before)


any_float = st.floats() | st.sampled_from(
    [NAN, math.inf, 0.0, -0.0, 5e-324, 1e12, -1e12, 1e300, -1e300]
)


def mostly(value):
    return st.just(value) | any_float


anything = st.tuples(
    *(mostly(value) for value in (2.66, 1052.0, 816.4, 78.4, 407.6, 78.4, 407.6, 2.7, 818.0, 0.1)),
    st.tuples(*[st.booleans()] * 3),
    st.lists(st.builds(Coming, any_float, any_float, any_float), max_size=10),
)


#: with sensors that are not valid
SANE = (2.66, 1052.0, 816.4, 78.4, 407.6, 78.4, 407.6, 2.7, 818.0, 0.1, (False, False, False), [])


@pytest.mark.requirement("S31")
@pytest.mark.slow
@settings(deadline=None)
@example([*[SANE] * 3, (*SANE[:4], 50970.0, *SANE[5:10], (True, False, True), [])])
@given(st.lists(anything, max_size=25))
def test_any_input_keeps_the_command_within_the_bounds(ticks):
    """Any bits in any input, for many ticks.

    Then sane ones find it within the bounds and a move, and soon well.

    After drives far out of their bounds that were said to be valid, the estimator needs two
    seconds to come back.
    """
    controller = BOUNDED
    controller.reset(Command(NAN, 0.0))
    for (
        depth,
        torque,
        temperature,
        acting_kn,
        acting_rpm,
        force,
        speed,
        *reference,
        dt_s,
        valid,
        coming,
    ) in ticks:
        m = Measurement(
            0.0, depth, torque, temperature, *valid, force_kn=acting_kn, speed_rpm=acting_rpm
        )
        proposal = controller.step(
            m, Reference(*reference, tuple(coming)), Command(force, speed), dt_s
        )
        known = Command(force, speed) if math.isfinite(force + speed) else proposal.command
        assert within(proposal, known)
    healthy = []
    for _ in range(40):
        proposal = controller.step(
            Measurement(0.0, 2.66, 1052.0, 816.4), TARGET, Command(78.4, 407.6), 0.1
        )
        assert within(proposal, Command(78.4, 407.6))
        healthy.append(proposal.healthy)
    assert healthy[-1]


@pytest.mark.requirement("S31")
def test_absurd_applied_command_is_reported_and_ignored():
    loop = Loop()
    for _ in range(5):
        loop.step()
    for force_kn in (1e12, -1e300, 97.0, 58.0):
        proposal = loop.controller.step(loop.measure(), TARGET, Command(force_kn, 407.6), 0.1)
        assert (proposal.healthy, proposal.command.force_kn) == (
            False,
            Limits().clip(Command(force_kn, 400.0), None).force_kn,
        )
        assert proposal.reason.code is ReasonCode.OUT_OF_BOUNDS
    after = loop.step()
    assert after.healthy and abs(after.command.force_kn - 78.4) < 0.2


@pytest.mark.requirement("S31")
def test_absurd_applied_command_acts_like_an_unknown_one():
    after = []
    for strange in (Command(1e12, 407.6), Command(NAN, NAN)):
        loop = Loop()
        for _ in range(5):
            loop.step()
        loop.controller.step(loop.measure(), TARGET, strange, 0.1)
        after.append(loop.step().command)
    assert after[0] == after[1]


@pytest.mark.requirement("S31")
@pytest.mark.parametrize(
    ("force_kn", "speed_rpm", "inside"),
    [
        *((60.0 + off, 407.6, off > -1.0) for off in (-1.1, -0.9, 0.5)),
        *((95.0 + off, 407.6, off < 1.0) for off in (-0.5, 0.9, 1.1)),
        *((78.4, 300.0 + off, off > -3.0) for off in (-3.1, -2.9, 1.5)),
        *((78.4, 500.0 + off, off < 3.0) for off in (-1.5, 2.9, 3.1)),
    ],
)
def test_applied_command_up_to_one_move_beyond_the_bounds_is_accepted(force_kn, speed_rpm, inside):
    loop = Loop(BOUNDED)
    proposal = loop.controller.step(loop.measure(), TARGET, Command(force_kn, speed_rpm), 0.1)
    assert proposal.healthy == inside


@pytest.mark.requirement("S31")
@pytest.mark.parametrize(
    ("applied", "reference"),
    [
        (Command(95.8, 407.6), Reference(2.36, 816.4)),
        (Command(59.2, 407.6), Reference(2.96, 816.4)),
        (Command(78.4, 502.5), Reference(2.66, 776.4)),
        (Command(78.4, 297.5), Reference(2.66, 866.4)),
    ],
)
def test_return_into_the_bounds_takes_one_move_per_tick(applied, reference):
    """Or as far as the bound, however far away the set-points are."""
    loop = Loop(BOUNDED)
    for _ in range(3):
        proposal = loop.controller.step(loop.measure(), reference, applied, 0.1)
        assert proposal.healthy and within(proposal, applied)
    move = (
        abs(proposal.command.force_kn - applied.force_kn),
        abs(proposal.command.speed_rpm - applied.speed_rpm),
    )
    is_back = Limits().clip(proposal.command, None) == proposal.command
    assert is_back or move[0] == pytest.approx(1.0) or move[1] == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("beyond", "bound"), [((95.5, 407.6), (95.0, 407.6)), ((78.4, 298.0), (78.4, 300.0))]
)
def test_an_applied_command_beyond_a_bound_counts_as_the_bound(beyond, bound):
    """The drives keep the bounds, whatever they were told."""
    after = []
    for first in (beyond, bound):
        loop = Loop(BOUNDED)
        loop.controller.step(loop.measure(), TARGET, Command(*first), 0.1)
        after.append(
            loop.controller.step(
                loop.measure(), TARGET, Command(*bound), 0.1
            ).diagnosis.disturbances
        )
    assert after[0] == after[1]


@pytest.mark.requirement("S31")
def test_command_without_sensors_is_within_the_bounds():
    loop = Loop(BOUNDED)
    for applied in (Command(97.0, 407.6), Command(1e300, -1e300), Command(59.5, 301.0)):
        blind = loop.measure(depth_mm=NAN, depth_valid=False)
        proposal = loop.controller.step(blind, TARGET, applied, 0.1)
        assert not proposal.healthy and proposal.reason.code in (
            ReasonCode.WAITING_FOR_SENSORS,
            ReasonCode.NOT_WELDING,
        )
        assert Limits().clip(proposal.command, None) == proposal.command


@pytest.mark.parametrize("preset", ["default", "paper"])
@pytest.mark.parametrize("depth_mm", [2.0, 3.4])
def test_planned_moves_keep_the_rate_limits_to_the_end_of_the_horizon(preset, depth_mm):
    """Also in the long intervals beyond 5 s.

    Both inputs go from one end of their range to the other in the plan.
    """
    loop = Loop(NmpcController({"preset": preset}))
    lim, beyond = Limits(), 0.0
    for tick in range(60):
        plan = loop.step(Reference(depth_mm, 790.0 if tick > 30 else 900.0)).diagnosis.plan
        ticks = np.diff(plan.time_s) / 0.1
        forces, speeds = (
            np.abs(np.diff(plan.force_kn)) / ticks,
            np.abs(np.diff(plan.speed_rpm)) / ticks,
        )
        assert (
            forces.max() <= lim.force_step_kn + 1e-6 and speeds.max() <= lim.speed_step_rpm + 1e-5
        )
        beyond = max(beyond, speeds[ticks > 1.5].max())
    assert beyond > 0.1
