"""The decentralized controller, alone and in closed loop with the process model."""

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fsw_control import Command, Controller, Limits, Measurement, Reference, c_library
from fsw_control.parameters import describe
from fsw_control.reason import ReasonCode
from fsw_control.schema.models import range_of
from fsw_control.units import KW_PER_NM_RPM
from fsw_control.weld import DEPTH_MM, FORCE_KN, SPEED_RPM, TEMPERATURE_C, TICK_S
from fsw_decentral import DecentralController, Gains, tunings
from fsw_decentral.controller import KERNEL
from fsw_model import ProcessModel

NOMINAL = Command(FORCE_KN, SPEED_RPM)
REFERENCE = Reference(DEPTH_MM, TEMPERATURE_C)
NAN = float("nan")
MODEL = ProcessModel()
MOTOR_TORQUE_NM = MODEL.equilibrium().outputs.motor_torque_nm


def measured(k, depth=DEPTH_MM, torque=MOTOR_TORQUE_NM, temperature=TEMPERATURE_C):
    return Measurement(
        k * 0.1,
        depth,
        torque,
        temperature,
        depth_valid=not math.isnan(depth),
        torque_valid=not math.isnan(torque),
        temperature_valid=not math.isnan(temperature),
    )


def closed_loop(controller, reference, seconds, lose=lambda t: (), override=lambda t: None):
    """Run on the process model; returns rows of time, depth, temperature, command, proposal."""
    start = MODEL.equilibrium()
    state, applied = start.state.copy(), Command(start.force_kn, start.speed_rpm)
    before = applied
    rows = []
    for k in range(round(seconds * 10)):
        t = k * 0.1
        out = MODEL.outputs(state, applied.force_kn, applied.speed_rpm)
        spike = (
            MODEL.parameters.spindle_inertia_kgm2
            * math.pi
            / 30.0
            * (applied.speed_rpm - before.speed_rpm)
            / 0.1
        )
        lost = lose(t)
        measurement = measured(
            k,
            NAN if "depth" in lost else out.depth_mm,
            NAN if "torque" in lost else out.motor_torque_nm + spike,
            NAN if "thermocouple" in lost else out.temperature_c,
        )
        proposal = controller.step(measurement, reference(t), applied, 0.1)
        before, applied = applied, override(t) or proposal.command
        MODEL.step(state, applied.force_kn, applied.speed_rpm)
        rows.append((t, out.depth_mm, out.temperature_c, before, proposal))
    return rows


def test_is_a_controller():
    controller = DecentralController()
    assert isinstance(controller, Controller)
    assert controller.name == "decentral"


@pytest.mark.parametrize("tuning", tunings())
def test_stays_at_the_operating_point(tuning):
    rows = closed_loop(DecentralController({"tuning": tuning}), lambda t: REFERENCE, 60)
    assert abs(rows[-1][1] - DEPTH_MM) < 1e-6
    assert abs(rows[-1][2] - TEMPERATURE_C) < 1e-3


@pytest.mark.parametrize("tuning", tunings())
@pytest.mark.parametrize(
    ("depth_mm", "temperature_c"), [(0.2, 0.0), (-0.2, 0.0), (0.0, 10.0), (0.0, -10.0)]
)
def test_steps_settle_without_offset_and_within_limits(tuning, depth_mm, temperature_c):
    goal = Reference(DEPTH_MM + depth_mm, TEMPERATURE_C + temperature_c)
    rows = closed_loop(
        DecentralController({"tuning": tuning}), lambda t: goal if t >= 1.0 else REFERENCE, 240
    )
    assert abs(rows[-1][1] - goal.depth_mm) < 2e-3
    assert abs(rows[-1][2] - goal.temperature_c) < 0.1
    limits = Limits()
    for _, _, _, applied, proposal in rows:
        assert proposal.healthy
        assert limits.clip(proposal.command, applied) == proposal.command


def test_tight_is_faster_than_conservative():
    deep, hot = Reference(DEPTH_MM + 0.1, TEMPERATURE_C), Reference(DEPTH_MM, TEMPERATURE_C + 5.0)
    errors = {}
    for tuning in ("conservative", "tight"):
        depth = closed_loop(
            DecentralController({"tuning": tuning}), lambda t: deep if t >= 1.0 else REFERENCE, 60
        )
        warmth = closed_loop(
            DecentralController({"tuning": tuning}), lambda t: hot if t >= 1.0 else REFERENCE, 60
        )
        errors[tuning] = (
            sum(abs(row[1] - deep.depth_mm) for row in depth),
            sum(abs(row[2] - hot.temperature_c) for row in warmth),
        )
    assert errors["tight"][0] < 0.75 * errors["conservative"][0]
    assert errors["tight"][1] < 0.95 * errors["conservative"][1]


@pytest.mark.requirement("S12")
@pytest.mark.parametrize("tuning", tunings())
def test_unselected_it_follows_and_takes_over_without_a_bump(tuning):
    """Another one holds shifted inputs.

    The first own moves are small, and it leads back to the reference.
    """
    other = Command(78.6, 409.0)
    controller = DecentralController({"tuning": tuning})
    rows = closed_loop(
        controller, lambda t: REFERENCE, 300, override=lambda t: other if t < 60.0 else None
    )
    shadow = [row[4].command for row in rows[10:600]]
    assert max(abs(command.force_kn - other.force_kn) for command in shadow) < 0.6
    assert max(abs(command.speed_rpm - other.speed_rpm) for command in shadow) < 0.5
    moves = [
        (
            abs(b[4].command.force_kn - a[4].command.force_kn),
            abs(b[4].command.speed_rpm - a[4].command.speed_rpm),
        )
        for a, b in pairwise(rows[598:701])
    ]
    assert max(force for force, _ in moves) < 0.6
    assert max(speed for _, speed in moves) < 2.5
    assert abs(rows[-1][1] - DEPTH_MM) < 5e-3
    assert abs(rows[-1][2] - TEMPERATURE_C) < 0.2


@pytest.mark.parametrize("tuning", tunings())
def test_saturation_does_not_wind_up(tuning):
    """A step far beyond what the force can do at once overshoots hardly more, as a share, than one that it can do."""
    shares = []
    for size in (0.05, 0.6):
        goal = Reference(DEPTH_MM + size, TEMPERATURE_C)
        rows = closed_loop(DecentralController({"tuning": tuning}), lambda t, goal=goal: goal, 150)
        shares.append((max(row[1] for row in rows) - goal.depth_mm) / size)
        limited = {name for row in rows for name in row[4].diagnosis.active_limits}
    assert "force_max" in limited
    assert shares[1] < shares[0] + 0.05


@pytest.mark.parametrize("tuning", tunings())
def test_a_speed_at_its_bound_does_not_wind_up(tuning):
    """A temperature out of reach for a minute.

    The speed leaves the bound as soon as the set-point is back.
    """
    hot = Reference(DEPTH_MM, TEMPERATURE_C + 20.0)
    controller = DecentralController({"tuning": tuning, "speed_max": SPEED_RPM + 2.0})
    rows = closed_loop(controller, lambda t: hot if 1.0 <= t < 61.0 else REFERENCE, 180)
    commands = {round(row[0], 1): row[4].command.speed_rpm for row in rows}
    assert commands[60.0] == SPEED_RPM + 2.0
    assert commands[64.0] < SPEED_RPM - 1.0
    assert abs(rows[-1][2] - TEMPERATURE_C) < 0.5


@pytest.mark.parametrize(
    ("tracking_s", "least_kj", "most_kj"), [(30.0, -3.0, 0.0), (0.1, -25.0, -14.0)]
)
def test_the_power_loop_makes_up_for_energy_that_the_move_limit_has_cost(
    tracking_s, least_kj, most_kj
):
    """The torque drops by a fifth at once, the speed follows with 3 rpm per tick.

    A short tracking time forgets.
    """
    power_loop = {
        "power_gain": 2.0,
        "power_integral_time": 0.3,
        "power_filter": 0.1,
        "power_tracking_time": tracking_s,
    }
    spindle = {
        "friction.constant": 0.0,
        "friction.linear": 0.0,
        "friction.quadratic": 0.0,
        "spindle_inertia": 0.0,
    }
    controller = DecentralController(
        {**power_loop, **spindle, "feedforward_filter": 0.1, "speed_max": 900.0}
    )
    applied = Command(FORCE_KN, 400.0)
    controller.reset(applied)
    power_kw, missing_kj = 1000.0 * applied.speed_rpm * KW_PER_NM_RPM, 0.0
    for k in range(201):  # without temperature the power reference is held
        torque = 800.0 if k else 1000.0
        applied = controller.step(
            measured(k, torque=torque, temperature=NAN), REFERENCE, applied, 0.1
        ).command
        if k:
            missing_kj += (torque * applied.speed_rpm * KW_PER_NM_RPM - power_kw) * 0.1
        else:
            assert applied.speed_rpm == pytest.approx(400.0)
    assert least_kj < missing_kj < most_kj


def test_missing_torque_is_tolerated_then_reported():
    controller = DecentralController({"blind_limit": 10.0})
    rows = closed_loop(
        controller, lambda t: REFERENCE, 40, lose=lambda t: ("torque",) if t >= 5.0 else ()
    )
    assert all(row[4].healthy for row in rows if row[0] < 14.9)
    assert not rows[-1][4].healthy
    assert rows[-1][4].reason.sensors == ("torque",)
    assert abs(rows[-1][2] - TEMPERATURE_C) < 1.0
    assert all(math.isfinite(row[4].command.speed_rpm) for row in rows)


def test_without_temperature_the_power_is_held():
    controller = DecentralController({"blind_limit": 10.0})
    rows = closed_loop(
        controller, lambda t: REFERENCE, 40, lose=lambda t: ("thermocouple",) if t >= 5.0 else ()
    )
    assert all(row[4].healthy for row in rows if row[0] < 14.9)
    assert rows[-1][4].reason.sensors == ("thermocouple",)
    assert abs(rows[-1][2] - TEMPERATURE_C) < 1.0


def test_without_depth_the_force_is_held_and_it_is_said_at_once():
    goal = Reference(DEPTH_MM + 0.1, TEMPERATURE_C)
    rows = closed_loop(
        DecentralController(),
        lambda t: goal,
        20,
        lose=lambda t: ("depth",) if 5.0 <= t < 10.0 else (),
    )
    blind = [row for row in rows if 5.0 <= row[0] < 10.0]
    assert not any(row[4].healthy for row in blind)
    assert len({row[4].command.force_kn for row in blind}) == 1
    again = next(row for row in rows if row[0] >= 10.0)
    assert again[4].healthy
    assert abs(again[4].command.force_kn - again[3].force_kn) < 0.2


def test_gains_change_at_runtime_without_a_bump():
    controller = DecentralController({"tuning": "conservative"})
    goal = Reference(DEPTH_MM + 0.01, TEMPERATURE_C + 0.5)
    applied = NOMINAL
    for k in range(100):
        applied = controller.step(measured(k), goal, applied, 0.1).command
    controller.configure({"tuning": "tight"})
    after = controller.step(measured(100), goal, applied, 0.1).command
    assert abs(after.force_kn - applied.force_kn) < 0.2
    assert abs(after.speed_rpm - applied.speed_rpm) < 1.0


def test_overrides_take_the_place_of_the_tuning():
    controller = DecentralController({"tuning": "tight", "depth_gain": 12.0})
    assert controller.gains.depth_gain == 12.0
    assert controller.gains.temperature_gain == tunings()["tight"].temperature_gain
    controller.configure({"depth_gain": -1.0})
    assert controller.gains == tunings()["tight"]


def test_unusable_parameters_are_rejected_unchanged():
    controller = DecentralController()
    gains = controller.gains
    assert controller.check({}) is None
    assert "depth_integral_time" in controller.check({"depth_integral_time": 0.0})
    assert "force_min" in controller.check({"force_min": 99.0})
    assert "speed_min" in controller.check({"speed_min": 600.0})
    assert "conservative, tight" in controller.check({"tuning": "loose"})
    for name in (
        "friction.linear",
        "spindle_inertia",
        "nominal_torque",
        "blind_limit",
        "force_max",
        "speed_step",
    ):
        assert "must be" in controller.check({name: NAN})
    with pytest.raises(ValueError, match="be finite"):
        DecentralController({"spindle_inertia": math.inf})
    with pytest.raises(ValueError, match="depth_integral_time"):
        controller.configure({"depth_integral_time": 0.0})
    assert controller.gains == gains


def test_the_parameter_offers_the_documented_tunings():
    assert list(describe(DecentralController.parameters)["tuning"].options) == list(tunings())


def test_gains_refuse_nonsense():
    good = tunings()["tight"]
    with pytest.raises(ValueError, match="depth_gain"):
        Gains(**{name: getattr(good, name) for name in Gains.model_fields} | {"depth_gain": NAN})


def test_reset_starts_from_the_applied_command():
    controller = DecentralController()
    for k in range(50):
        controller.step(measured(k, depth=2.4), REFERENCE, NOMINAL, 0.1)
    other = Command(80.0, 390.0)
    controller.reset(other)
    command = controller.step(measured(0), REFERENCE, other, 0.1).command
    assert abs(command.force_kn - 80.0) < 1e-6
    assert abs(command.speed_rpm - 390.0) < 1e-6


def test_reset_to_nothing_known_starts_from_the_last_proposal():
    controller = DecentralController()
    last = controller.step(measured(0), REFERENCE, Command(80.0, 390.0), 0.1).command
    controller.reset(Command(NAN, 400.0))
    again = controller.step(measured(1), REFERENCE, Command(NAN, NAN), 0.1)
    assert again.healthy
    assert (again.command.force_kn, again.command.speed_rpm) == pytest.approx(
        (last.force_kn, last.speed_rpm)
    )


def test_a_torque_beyond_all_range_starts_the_loops_again():
    """After it the feed-forward would divide by a torque of 0."""
    controller = DecentralController({"feedforward_filter": 0.0})
    reasons = [
        controller.step(measured(k, torque=1e20 if k == 1 else 1e3), REFERENCE, NOMINAL, 0.1)
        for k in range(4)
    ]
    assert [proposal.healthy for proposal in reasons] == [True, False, True, True]
    assert reasons[1].reason.code is ReasonCode.OVERFLOW
    assert reasons[1].command == NOMINAL


def test_a_pause_counts_as_one_second_at_most_and_a_time_that_cannot_be_as_one_tick():
    def after(dt_s):
        controller = DecentralController()
        for k, step_s in enumerate((0.1, dt_s)):
            proposal = controller.step(
                measured(k, depth=2.66 + 1e-3 * k), REFERENCE, NOMINAL, step_s
            )
        return proposal

    assert after(5.0) == after(math.inf) == after(1.0) != after(0.1)
    assert after(NAN) == after(-1.0) == after(0.0) == after(TICK_S)


def test_missing_compiler_error_is_one_line_with_a_remedy(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(c_library, "compiler", lambda: None)
    monkeypatch.delitem(KERNEL.__dict__, "lib", raising=False)
    with pytest.raises(ValueError, match=r"^decentral: .*C compiler"):
        DecentralController()


def test_same_inputs_give_the_same_outputs():
    runs = []
    for _ in range(2):
        controller = DecentralController()
        controller.reset(NOMINAL)
        rows = closed_loop(
            controller, lambda t: Reference(DEPTH_MM + 0.04, TEMPERATURE_C + 2.0), 20
        )
        runs.append([(row[4].command.force_kn, row[4].command.speed_rpm) for row in rows])
    assert runs[0] == runs[1]


any_float = st.one_of(st.floats(), st.sampled_from([0.0, NAN, math.inf, -math.inf, 1e300]))
sample = st.builds(
    Measurement,
    st.just(0.0),
    st.one_of(st.floats(2.0, 4.0), any_float),
    st.one_of(st.floats(500.0, 1500.0), any_float),
    st.one_of(st.floats(700.0, 1000.0), any_float),
    st.booleans(),
    st.booleans(),
    st.booleans(),
)


bounds = st.floats(-1e3, 1e3)
values = st.fixed_dictionaries(
    {},
    optional={
        "tuning": st.sampled_from(list(tunings())),
        **{name: st.floats(0.0, range_of(Gains, name).high) for name in Gains.model_fields},
        **{f"{name}_{end}": bounds for name in ("force", "speed") for end in ("min", "max")},
        **{f"{name}_step": st.floats(0.0, 100.0) for name in ("force", "speed")},
        "blind_limit": any_float,
        "nominal_torque": any_float,
    },
)
event = st.tuples(
    sample,
    st.builds(Reference, any_float, any_float),
    st.one_of(st.none(), st.builds(Command, any_float, any_float)),
    st.one_of(st.just(0.1), any_float),
    st.one_of(st.none(), values),
    st.one_of(st.none(), st.none(), st.builds(Command, any_float, any_float)),
)


@pytest.mark.requirement("S4")
@settings(deadline=None)
@given(st.lists(event, max_size=30))
def test_whatever_comes_the_proposal_keeps_every_limit(events):
    controller = DecentralController()
    proposed = NOMINAL
    for measurement, reference, elsewhere, dt_s, changed, restart in events:
        if changed is not None and controller.check(changed) is None:
            controller.configure(changed)
        if restart is not None:
            controller.reset(restart)
            known = math.isfinite(restart.force_kn + restart.speed_rpm)
            proposed = controller.limits.clip(restart, None) if known else proposed
        given_command = elsewhere or proposed
        is_known = math.isfinite(given_command.force_kn + given_command.speed_rpm)
        applied = given_command if is_known else proposed
        proposal = controller.step(measurement, reference, given_command, dt_s)
        proposed = proposal.command
        limits = controller.limits
        near = limits.clip(applied, None)
        assert limits.clip(proposed, near) == limits.clip(proposed, None) == proposed
        assert proposal.healthy == (not proposal.reason)
        if proposal.healthy:
            assert abs(proposed.force_kn - applied.force_kn) <= limits.force_step_kn + 2e-6
            assert abs(proposed.speed_rpm - applied.speed_rpm) <= limits.speed_step_rpm + 2e-6


@pytest.mark.requirement("S31")
@pytest.mark.parametrize("force_kn", [1e12, -1e12, 1e300, -1e300, 97.0, 58.0])
def test_absurd_applied_command_is_reported_and_has_no_effect(force_kn):
    controller = DecentralController()
    controller.step(measured(0), REFERENCE, NOMINAL, 0.1)
    for _ in range(2):
        proposal = controller.step(
            measured(1), REFERENCE, Command(force_kn, NOMINAL.speed_rpm), 0.1
        )
        bound = (
            controller.limits.force_max_kn if force_kn > 90.0 else controller.limits.force_min_kn
        )
        assert (proposal.healthy, proposal.command.force_kn) == (False, bound)
        assert proposal.reason.code is ReasonCode.OUT_OF_BOUNDS
    for k in range(3):
        proposal = controller.step(measured(2 + k), REFERENCE, NOMINAL, 0.1)
        assert proposal.healthy and abs(proposal.command.force_kn - NOMINAL.force_kn) < 1e-3


@pytest.mark.parametrize("sensor", ["depth", "torque", "temperature"])
@pytest.mark.parametrize("value", [1e12, -1e12, 1e300])
@pytest.mark.parametrize("tuning", ["conservative", "smith"])
def test_an_absurd_sample_does_not_pull_for_ever(tuning, sensor, value):
    """One sample beyond all range must not leave an integrator that takes minutes to come back."""
    controller = DecentralController({"tuning": tuning})
    proposed = NOMINAL
    for k in range(200):
        m = measured(k, **({sensor: value} if k == 5 else {}))
        proposal = controller.step(m, REFERENCE, proposed, 0.1)
        proposed = proposal.command
    assert proposal.healthy
    assert not {"force_min", "force_max", "speed_min", "speed_max"} & set(
        proposal.diagnosis.active_limits
    )


@pytest.mark.parametrize("sensor", ["depth", "temperature"])
@pytest.mark.parametrize("value", [1.7e308, -1.7e308])
def test_non_finite_sum_is_not_proposed(sensor, value):
    """A gain times such a sample is infinite, and infinity less infinity is no number."""
    controller = DecentralController()
    controller.configure({"depth_gain": 500.0, "temperature_gain": 10.0})
    proposal = controller.step(measured(0, **{sensor: value}), REFERENCE, NOMINAL, 0.1)
    assert (proposal.healthy, proposal.command) == (False, NOMINAL)
    assert controller.step(measured(1), REFERENCE, NOMINAL, 0.1).healthy


@pytest.mark.parametrize(
    ("force_kn", "speed_rpm", "inside"),
    [
        *((60.0 + off, 407.5, off > -1.0) for off in (-1.1, -0.9, 0.0, 0.5)),
        *((95.0 + off, 407.5, off < 1.0) for off in (-0.5, 0.0, 0.9, 1.1)),
        *((78.4, 300.0 + off, off > -3.0) for off in (-3.1, -2.9, 0.0, 1.5)),
        *((78.4, 500.0 + off, off < 3.0) for off in (-1.5, 0.0, 2.9, 3.1)),
    ],
)
def test_applied_command_up_to_one_move_beyond_the_bounds_is_accepted(force_kn, speed_rpm, inside):
    controller = DecentralController()
    proposal = controller.step(measured(0), REFERENCE, Command(force_kn, speed_rpm), 0.1)
    assert proposal.healthy == inside


@pytest.mark.parametrize("sensor", ["torque", "temperature"])
def test_blindness_is_said_when_its_limit_has_passed(sensor):
    controller = DecentralController({"blind_limit": 1.05})
    controller.step(measured(0), REFERENCE, NOMINAL, 0.1)
    healthy = [
        controller.step(measured(k, **{sensor: NAN}), REFERENCE, NOMINAL, 0.1).healthy
        for k in range(1, 16)
    ]
    assert healthy == [True] * 10 + [False] * 5


@pytest.mark.parametrize(("error_mm", "error_c"), [(1.0, 50.0), (-1.0, -50.0)])
def test_the_move_limit_is_named_in_both_directions(error_mm, error_c):
    goal = Reference(DEPTH_MM + error_mm, TEMPERATURE_C + error_c)
    controller = DecentralController(
        {"temperature_gain": 10.0, "temperature_reference_filter": 0.0}
    )
    for k in range(5):
        proposal = controller.step(measured(k), goal, NOMINAL, 0.1)
    assert proposal.diagnosis.active_limits == ("force_rate", "speed_rate")


@pytest.mark.parametrize("ends", [("force", 70.0), ("speed", 400.0)])
def test_bounds_without_room_between_are_refused(ends):
    quantity, value = ends
    assert (
        DecentralController().check({f"{quantity}_min": value, f"{quantity}_max": value})
        is not None
    )


def test_a_reset_beyond_the_bounds_begins_at_them():
    controller = DecentralController()
    controller.reset(Command(1000.0, 1000.0))
    proposal = controller.step(measured(0), REFERENCE, Command(NAN, NAN), 0.1)
    assert (
        proposal.healthy
        and controller.limits.clip(proposal.command, Command(95.0, 500.0)) == proposal.command
    )


@pytest.mark.parametrize(
    ("beyond", "bound"), [((95.5, 407.5), (95.0, 407.5)), ((78.4, 298.0), (78.4, 300.0))]
)
def test_an_applied_command_beyond_a_bound_counts_as_the_bound(beyond, bound):
    logged = []
    for first in (beyond, bound):
        controller = DecentralController()
        proposed = controller.step(measured(0), REFERENCE, Command(*first), 0.1).command
        logged.append(
            controller.step(measured(1, depth=DEPTH_MM + 0.002), REFERENCE, proposed, 0.1).command
        )
    assert logged[0] == logged[1]


def test_non_finite_set_points_are_ignored():
    goal = Reference(DEPTH_MM + 0.05, TEMPERATURE_C + 2.0)
    logged = []
    for second in (goal, Reference(NAN, TEMPERATURE_C)):
        controller = DecentralController()
        proposed = controller.step(measured(0), goal, NOMINAL, 0.1).command
        logged.append(controller.step(measured(1), second, proposed, 0.1).command)
    assert logged[0] == logged[1] != proposed
