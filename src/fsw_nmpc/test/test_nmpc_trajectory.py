"""Reference trajectories: feasible, consistent in time, early where set-points are known.

And the paper's corridors.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fsw_control import Limits
from fsw_model import nominal
from fsw_model.equations import process_torque_nm
from fsw_nmpc.library import tuning_of
from fsw_nmpc.tuning import PAPER, PRIORITIES, ApproachTuning, Settings, Tuning
from fsw_test_support.nmpc_problems import LIMITS, begin, make_library

NAN = float("nan")
REST_RPM = 407.57607824382967


@pytest.fixture(scope="module")
def library():
    return make_library(20)


def trajectories(
    library,
    depth_mm=2.66,
    temperature_c=816.4,
    tuning=None,
    ticks=1,
    changes=(),
    limits=LIMITS,
    priority="depth",
):
    """Depth and temperature over the horizon at rest at the operating point, for set-points."""
    library.configure(tuning_of(Settings(nominal(), tuning or Tuning(), limits, priority)))
    library.reset(78.4, REST_RPM)
    given_, h = library.input, library.horizon
    given_.depth_mm, given_.torque_nm, given_.temperature_c = 2.66, 1052.8585402958927, 816.4
    given_.depth_fresh = given_.torque_fresh = given_.temperature_fresh = True
    given_.force_kn = given_.speed_rpm = NAN
    given_.applied_force_kn, given_.applied_speed_rpm, given_.dt_s = 78.4, REST_RPM, 0.1
    given_.reference_depth_mm, given_.reference_temperature_c = depth_mm, temperature_c
    given_.n_changes = len(changes)
    for i, change in enumerate(changes):
        given_.change[i] = change
    for _ in range(ticks):
        assert begin(library)
    given_.n_changes = 0
    problem = library.state.problem
    low, high = (
        np.array([list(row[0 : h.n_out]) for row in side]) for side in (problem.low, problem.high)
    )
    return h.time_s, 0.5 * (low + high), high - low


def test_trajectories_at_rest_are_constant(library):
    _, (depth, temperature), width = trajectories(library)
    assert depth == pytest.approx(2.66, abs=1e-9)
    assert temperature == pytest.approx(816.4, abs=1e-9)
    assert not width.any()


@settings(deadline=None)
@given(depth_step=st.floats(-0.5, 0.5), temperature_step=st.floats(-50.0, 50.0))
def test_outputs_come_without_overshoot_as_fast_as_inputs_allow(
    library, depth_step, temperature_step
):
    time_s, (depth, temperature), _ = trajectories(
        library, 2.66 + depth_step, 816.4 + temperature_step
    )
    for path, start, step, most in (
        (depth, 2.66, depth_step, 0.06),
        (temperature, 816.4, temperature_step, 7.0),
    ):
        share = (path - start) * np.sign(step)
        assert share.min() >= -1e-9 and share.max() <= abs(step) * 1.02 + 1e-6
        assert np.abs(np.diff(path) / np.diff(time_s)).max() <= most
        assert share[-1] == pytest.approx(abs(step), abs=0.02 * abs(step) + 1e-6)
    fine = time_s < 5.0
    rate = np.diff(depth[fine]) / 0.1
    assert np.abs(np.diff(rate) / 0.1).max() < 0.035  # 10 kN/s move the depth with 0.032 mm/s^2
    assert temperature[time_s < 2.75] == pytest.approx(816.4, abs=1e-9)  # the dead time


def test_aggressiveness_is_the_time_constant_near_the_set_point(library):
    for slow_s in (0.5, 1.1, 3.0):
        time_s, (depth, _), _ = trajectories(library, 2.661, tuning=Tuning(depth_time_s=slow_s))
        left = 2.661 - depth
        inside = (left < 0.5e-3) & (left > 0.02e-3) & (time_s < 5.0)
        if inside.sum() > 4:
            slope = np.polyfit(time_s[inside], np.log(left[inside]), 1)[0]
            assert -1.0 / slope == pytest.approx(max(slow_s, 0.4), rel=0.25)


def test_known_set_points_are_approached_early(library):
    """Half way when the set-point changes, and then on to the next."""
    time_s, (depth, temperature), _ = trajectories(library, changes=[(7.0, 2.76, 824.4)])
    at = np.searchsorted(time_s, 7.0 - 1e-9)
    assert depth[at] == pytest.approx(2.71, abs=0.01)
    assert temperature[at] == pytest.approx(820.4, abs=1.0)
    assert depth[-1] == pytest.approx(2.76, abs=1e-3)
    time_s, (depth, _), _ = trajectories(library, changes=[(3.0, 2.70, 816.4), (8.0, 2.66, 816.4)])
    assert depth.max() == pytest.approx(2.70, abs=4e-3)
    assert depth[-1] == pytest.approx(2.66, abs=1e-3)


def test_lead_before_a_known_set_point_is_limited(library):
    tuning = Tuning(approach=ApproachTuning(longest_lead_s=0.0))
    time_s, (depth, temperature), _ = trajectories(
        library, tuning=tuning, changes=[(7.0, 2.76, 824.4)]
    )
    before = time_s <= 7.0
    assert depth[before] == pytest.approx(2.66, abs=1e-9)
    assert temperature[before] == pytest.approx(816.4, abs=1e-9)
    assert depth[-1] == pytest.approx(2.76, abs=1e-3)


@pytest.mark.parametrize(
    "changes", [[(-1.0, 2.9, 850.0)], [(3.0, NAN, NAN)], [(NAN, 2.9, 850.0)], [(1e9, 2.9, 850.0)]]
)
def test_invalid_set_point_changes_are_ignored(library, changes):
    _, (depth, temperature), _ = trajectories(library, changes=changes)
    assert depth == pytest.approx(2.66, abs=1e-9)
    assert temperature == pytest.approx(816.4, abs=1e-9)


def test_negative_number_of_changes_counts_as_0(library):
    trajectories(library, 2.76, 824.4)
    library.input.n_changes = -7
    assert begin(library)
    library.input.n_changes = 0
    assert tuple(library.output.attainable) == (2.76, 824.4)


@pytest.mark.parametrize(
    ("kind", "ticks", "first"),
    [
        ("constant", 1, 2.76),
        ("recentred", 20, 2.76 - 0.1 * np.exp(-0.1 / 5.0)),
        ("cold_start", 20, 2.76 - 0.1 * np.exp(-2.0 / 5.0)),
    ],
)
def test_corridors_of_the_paper(library, kind, ticks, first):
    tuning = PAPER.changed(trajectory=kind)
    time_s, (depth, _), width = trajectories(library, 2.76, tuning=tuning, ticks=ticks)
    assert depth[0] == pytest.approx(first, abs=1e-6)
    assert width[0] == pytest.approx(0.004) and width[1] == pytest.approx(0.2)
    if kind != "constant":
        assert (2.76 - depth) / (2.76 - depth[0]) == pytest.approx(
            np.exp(-(time_s - 0.1) / 5.0), rel=1e-6
        )


def test_corridor_recentred_ahead_starts_at_the_temperature_after_the_dead_time(
    library,
):
    """At rest that is where it is now; the depth has no dead time."""
    tuning = PAPER.changed(trajectory="recentred_ahead")
    time_s, (depth, temperature), _ = trajectories(library, 2.76, 826.4, tuning=tuning, ticks=20)
    assert 2.76 - depth == pytest.approx(0.1 * np.exp(-time_s / 5.0), rel=1e-4)
    assert 826.4 - temperature == pytest.approx(
        10.0 * np.exp(-np.maximum(time_s - 2.8, 0.0) / 5.0), rel=1e-4
    )


@pytest.mark.parametrize("depth_mm", [-1e12, 0.0, 1e12])
@pytest.mark.parametrize("temperature_c", [-1e9, 816.4, 1e9])
def test_absurd_set_points_give_finite_trajectories(library, depth_mm, temperature_c):
    _, paths, _ = trajectories(library, depth_mm, temperature_c)
    assert np.isfinite(paths).all()


def test_large_temperature_step_is_limited_by_softening(library):
    """The temperature rises no faster than the fastest speed can heat at the set-point's depth, softening included."""
    time_s, (_, temperature), _ = trajectories(library, temperature_c=876.4)
    rate = np.diff(temperature) / np.diff(time_s)
    fastest_kw = 500.0 / 407.576 * 43.6
    kn_per_rate = 2.66 * 0.0021 / (0.0016 * 29.6 / 14.7)
    softer = (
        1.0 + 18.1 / 30.5 * fastest_kw / 78.4 * kn_per_rate
    )  # torque is about proportional to force
    assert 2.5 < rate.max() <= 18.1 / 30.5 * (fastest_kw - 43.6) / softer


def held_temperature_c(speed_rpm, depth_mm):
    """The temperature that a speed holds at a depth on the undisturbed process.

    (17)-(27) at rest.
    """
    p = nominal()
    power_kw = process_torque_nm(p, p.operating_force_kn, depth_mm) * speed_rpm * np.pi / 30_000.0
    return p.operating_temperature_c + p.thermal_gain_c_per_kw * (power_kw - p.operating_power_kw)


def attainable(library, depth_mm, temperature_c, priority="depth", tuning=None, **bounds):
    """What the set-points in force are replaced by."""
    wide = tuning or Tuning(quality_temperature_min_c=0.0, quality_temperature_max_c=2000.0)
    trajectories(
        library, depth_mm, temperature_c, tuning=wide, limits=Limits(**bounds), priority=priority
    )
    return tuple(library.output.attainable)


@given(
    depth_mm=st.floats(2.0, 3.2),
    off_c=st.one_of(st.floats(-60.0, -0.1), st.floats(0.1, 60.0)),
    to_bound_rpm=st.floats(0.1, 95.0),
    priority=st.sampled_from(PRIORITIES),
)
def test_set_points_beyond_the_speed_give_way_as_the_priority_says(
    library, depth_mm, off_c, to_bound_rpm, priority
):
    """The depth gives way within its quality limit and no more than it has to.

    The temperature is one that is held.
    """
    bound_rpm = REST_RPM + np.copysign(to_bound_rpm, off_c)
    bounds = {"speed_min_rpm" if off_c < 0.0 else "speed_max_rpm": bound_rpm}
    held = held_temperature_c(bound_rpm, depth_mm)
    depth, temperature = attainable(library, depth_mm, held + off_c, priority, **bounds)
    away, reach = (
        depth - depth_mm,
        held_temperature_c(bound_rpm, depth_mm + np.copysign(0.1, off_c)) - held,
    )
    given_way = {"depth": 0.0, "balance": 0.5, "temperature": 1.0}[priority] * off_c
    assert temperature - held == pytest.approx(min(given_way, reach, key=abs), abs=1e-3)
    assert held_temperature_c(bound_rpm, depth) == pytest.approx(temperature, abs=1e-3)
    assert abs(away) <= 0.1 + 1e-9 and away * off_c >= 0.0
    if priority == "depth":
        assert away == 0.0


@pytest.mark.parametrize("priority", PRIORITIES)
def test_set_points_within_reach_stay(library, priority):
    assert attainable(library, 2.76, 830.0, priority) == (2.76, 830.0)


def test_quality_limits_of_the_temperature_come_before_the_depth(library):
    """The depth gives way until the slowest speed holds the limit, and no further."""
    limited = Tuning(quality_temperature_min_c=700.0, quality_temperature_max_c=817.0)
    assert held_temperature_c(407.0, 2.70) > 818.0
    depth, temperature = attainable(library, 2.70, 805.0, tuning=limited, speed_min_rpm=407.0)
    assert temperature == pytest.approx(817.0, abs=1e-3)
    assert held_temperature_c(407.0, depth) == pytest.approx(817.0, abs=1e-3)


def test_trajectories_end_at_attainable_set_points(library):
    """At rest where the slowest speed holds the temperature, a colder set-point moves nothing."""
    _, paths, _ = trajectories(library, temperature_c=800.0, limits=Limits(speed_min_rpm=REST_RPM))
    assert paths[0] == pytest.approx(2.66, abs=1e-9)
    assert paths[1] == pytest.approx(816.4, abs=1.5)  # beyond it by the uncertainty of the heat


#: set-points beyond what the spindle at rest can hold, with the bound that it is at
BEYOND = [("speed_max_rpm", 840.0), ("speed_min_rpm", 795.0)]


@pytest.mark.parametrize(("bound", "temperature_c"), BEYOND)
def test_temperature_beyond_reach_is_sought_with_more_than_the_bound_gives(
    library, bound, temperature_c
):
    ends = []
    for power_kw in (0.0, 0.15):
        tuning = Tuning(approach=ApproachTuning(beyond_bound_kw=power_kw))
        limits = Limits(**{bound: REST_RPM})
        _, (_, path), _ = trajectories(
            library, temperature_c=temperature_c, tuning=tuning, limits=limits
        )
        ends.append(path[-1])
    assert ends[0] == pytest.approx(816.4, abs=0.1)
    beyond_c = (ends[1] - ends[0]) * (1.0 if bound == "speed_max_rpm" else -1.0)
    assert 0.5 < beyond_c < 1.5


@pytest.mark.parametrize(("bound", "temperature_c"), BEYOND)
@pytest.mark.parametrize("known_kw", [-2.0, 2.0])
def test_known_heat_changes_what_a_bound_brings_and_costs_no_depth(
    library, bound, temperature_c, known_kw
):
    """Without it the speed would leave the bound before heat that helps, and the depth make up for heat that does not."""
    h = library.horizon
    ahead_kw = np.where(np.cumsum(h.step_length_s) > 4.0, known_kw, 0.0).tolist()
    library.input.known_ahead_kw[0 : len(ahead_kw)] = ahead_kw
    limits = Limits(**{bound: REST_RPM})
    _, (_, temperature), _ = trajectories(library, temperature_c=temperature_c, limits=limits)
    library.step()
    library.input.known_ahead_kw[0 : len(ahead_kw)] = [0.0] * len(ahead_kw)
    planned = library.output
    assert (temperature[-1] - 816.4) / known_kw > 5.0
    assert planned.plan_temperature_c[h.n_out - 1] == pytest.approx(temperature[-1], abs=1.5)
    assert list(planned.plan_depth_mm[0 : h.n_out]) == pytest.approx([2.66] * h.n_out, abs=0.02)


@pytest.mark.parametrize(("bound", "temperature_c"), BEYOND)
def test_depth_to_come_changes_what_a_bound_brings_from_its_time_on(library, bound, temperature_c):
    deep, flat = (
        trajectories(
            library,
            temperature_c=temperature_c,
            limits=Limits(**{bound: REST_RPM}),
            changes=[(12.0, depth_mm, temperature_c)],
        )[1][1]
        for depth_mm in (2.60, 2.66)
    )
    assert deep[0:50] == pytest.approx(flat[0:50], abs=1e-3)  # 5 s
    assert deep[-1] < flat[-1] - 2.0


@pytest.mark.parametrize(
    ("bound", "beyond_c", "goal_c"),
    [("speed_max_rpm", 840.0, 805.0), ("speed_min_rpm", 795.0, 830.0)],
)
def test_way_back_into_reach_is_that_from_the_attainable_temperature(
    library, bound, beyond_c, goal_c
):
    """It begins as early, and is as slow, as that from the set-point that the bound holds."""
    back, usual = (
        trajectories(
            library,
            temperature_c=temperature_c,
            limits=Limits(**{"speed_min_rpm": 395.0, "speed_max_rpm": 420.0, bound: REST_RPM}),
            changes=[(12.0, 2.66, goal_c)],
        )[1][1]
        for temperature_c in (beyond_c, 816.4)
    )
    assert np.abs(usual - 816.4).max() > 4.0
    assert back == pytest.approx(usual, abs=1.5)


def test_shallower_tool_at_a_bound_cools_as_its_path_says(library):
    """The force that lifts the tool takes heat.

    The path has it, so the plan follows both paths at the highest speed.
    """
    wide = Tuning(quality_temperature_min_c=0.0, quality_temperature_max_c=2000.0)
    _, (depth, temperature), _ = trajectories(
        library, depth_mm=2.56, tuning=wide, limits=Limits(speed_max_rpm=REST_RPM)
    )
    library.step()
    held, planned, n = held_temperature_c(REST_RPM, 2.56), library.output, library.horizon.n_out
    assert library.output.attainable[1] == pytest.approx(held, abs=1e-3)
    assert 816.4 - held > 5.0
    assert list(planned.plan_temperature_c[0:n]) == pytest.approx(temperature, abs=1.5)
    assert list(planned.plan_depth_mm[0:n]) == pytest.approx(depth, abs=0.02)
