"""Conversions between messages and the core's data: units, stamps, refusals."""

import math

import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st

from fsw_control import Command, Diagnosis, Plan, Proposal, Reference
from fsw_control import messages_ros as convert
from fsw_control.coded import RefusedError
from fsw_control.heat_plan import HeatPlan, HeatPlanProblem
from fsw_control.reason import Reason
from fsw_msgs.msg import WeldReference

finite = st.floats(-1e6, 1e6)


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_stamps_are_kept_exactly(time_ns):
    stamp = convert.stamp_from_ns(time_ns)
    assert isinstance(stamp, Time)
    assert convert.stamp_ns(stamp) == time_ns


@given(finite, finite, st.integers(0, 10**18))
def test_commands_come_back(force, speed, time_ns):
    message = convert.command_message(Command(force, speed), time_ns, "me", False, "why")
    assert convert.stamp_ns(message.header.stamp) == time_ns
    assert (message.source, message.healthy, convert.reason(message)) == (
        "me",
        False,
        Reason.of("why"),
    )
    back = convert.command(message)
    assert back.force_kn == pytest.approx(force, rel=1e-12, abs=1e-12)
    assert back.speed_rpm == pytest.approx(speed, rel=1e-12, abs=1e-12)


def test_command_is_in_si_units():
    message = convert.command_message(Command(78.4, 60.0), 0, "me")
    assert message.axial_force == pytest.approx(78_400.0)
    assert message.spindle_speed == pytest.approx(2.0 * math.pi)


@given(st.floats(1.5, 4.0), st.floats(750.0, 950.0), st.integers(0, 10**18))
def test_sensors_go_out_in_si_units_and_references_come_back(depth, temperature, time_ns):
    assert convert.sensor_message("depth", depth, time_ns).depth == pytest.approx(
        depth * 1e-3, rel=1e-12
    )
    assert convert.sensor_message("thermocouple", temperature, time_ns).temperature == temperature
    assert convert.sensor_message("torque", temperature, time_ns).torque == temperature
    reference = convert.reference(
        convert.reference_message(Reference(depth, temperature), time_ns)
    )
    assert reference.depth_mm == pytest.approx(depth, rel=1e-12)
    assert reference.temperature_c == temperature


@pytest.mark.requirement("S28")
@pytest.mark.parametrize("bad", [math.nan, math.inf, 0.0, -1.0, 2.66, 1200.0])
@pytest.mark.parametrize("name", ["depth", "temperature"])
def test_invalid_reference_is_refused(name, bad):
    message = WeldReference(depth=2.66e-3, temperature=850.0)
    setattr(message, name, bad)
    with pytest.raises(ValueError, match=f"{name}: "):
        convert.reference(message)


def test_status_carries_the_diagnosis():
    diagnosis = Diagnosis(
        2.66,
        850.0,
        1021.0,
        {"force_kn": 2.0, "temperature_c": -1.0, "odd": 3.0},
        "solved",
        4,
        1e-3,
    )
    status = convert.status_message(
        Proposal(Command(1.0, 2.0), False, "why", diagnosis), 5, "me", "me", ("depth",)
    )
    assert status.depth_estimate == pytest.approx(2.66e-3)
    assert list(status.disturbance_names) == ["force [N]", "temperature [degC]", "odd"]
    assert list(status.disturbances) == [2000.0, -1.0, 3.0]
    assert (status.solver_status, status.iterations, status.solve_time) == ("solved", 4, 1e-3)
    assert (status.healthy, convert.reason(status), status.selected) == (
        False,
        Reason.of("why"),
        True,
    )


@pytest.mark.parametrize("source", ["safe_stop", "other", ""])
def test_status_reports_the_source_of_the_applied_command(source):
    status = convert.status_message(Proposal(Command(1.0, 2.0)), 5, "me", source, ())
    assert (status.applied_source, status.selected) == (source, False)


def test_quantities_are_converted_by_their_exact_names():
    names, values = convert.wire_quantities(
        {
            "force_kn": 2.0,
            "speed_rpm": 30.0,
            "power_kw": 0.5,
            "depth_mm": 1.0,
            "temperature_c": -3.0,
            "torque_nm": 7.0,
            "torque_scale": 1.1,
            "depth_rate_mm_per_s": 3.0,
            "force_deviation_kn": 0.1,
            "axial_force [kN]": 4.0,
            "inner_mm": 5.0,
        }
    )
    wire = dict(zip(names, values, strict=True))
    assert wire == pytest.approx(
        {
            "force [N]": 2000.0,
            "speed [rad/s]": math.pi,
            "power [W]": 500.0,
            "depth [m]": 1e-3,
            "temperature [degC]": -3.0,
            "torque [N m]": 7.0,
            "torque_scale": 1.1,
            "depth_rate [m/s]": 3e-3,
            "force_deviation [N]": 100.0,
            "axial_force [kN]": 4.0,
            "inner_mm": 5.0,
        }
    ), "a name that is not the core's own says its unit itself"


@given(finite, finite, st.integers(0, 10**18))
def test_drive_feedback_comes_back(force, speed, time_ns):
    message = convert.drives_message(Command(force, speed), time_ns)
    assert convert.stamp_ns(message.header.stamp) == time_ns
    back = convert.command(message)
    assert back.force_kn == pytest.approx(force, rel=1e-12, abs=1e-12)
    assert back.speed_rpm == pytest.approx(speed, rel=1e-12, abs=1e-12)


def test_prediction():
    plan = Plan((0.0, 0.1), (2.6, 2.7), (850.0, 851.0), (78.0, 79.0), (400.0, 401.0))
    message = convert.prediction_message(plan, 0)
    assert list(message.depth) == pytest.approx([2.6e-3, 2.7e-3])
    assert list(message.spindle_speed) == pytest.approx(
        [400.0 * math.pi / 30.0, 401.0 * math.pi / 30.0]
    )
    assert list(message.depth_deviation) == [], "where the controller tells none"
    converted = convert.prediction_message(plan, 0, ((0.004, 0.005), (0.2, 0.3)))
    assert list(converted.depth_deviation) == pytest.approx([4e-6, 5e-6])
    assert list(converted.temperature_deviation) == pytest.approx([0.2, 0.3])


def test_a_plan_of_set_points_goes_there_and_back():
    planned = [(10**9, Reference(2.7, 820.0)), (3 * 10**9, Reference(2.8, 816.4))]
    back = convert.reference_plan(convert.reference_plan_message(planned, 5))
    assert [stamp for stamp, _ in back] == [10**9, 3 * 10**9]
    assert [set_points.depth_mm for _, set_points in back] == pytest.approx([2.7, 2.8])


def test_a_heat_plan_goes_there_and_back():
    plan = HeatPlan(
        [1.0, 2.5],
        [0.5, -1.0],
        [0.0, 0.01],
        {"dead_time_s": 2.8},
        [0.0, 2.15],
        [0.0, 0.25],
        "lid",
        "a" * 64,
    )
    message = convert.heat_plan_message(plan, 5)
    assert list(message.heat) == [500.0, -1000.0]
    assert list(message.variance) == pytest.approx([0.0, 1e4])
    assert list(message.length) == pytest.approx([0.0, 2.15e-3])
    back = convert.heat_plan(message)
    assert back.problem is None
    assert (back.at_s, back.model, back.type, back.profile) == (
        plan.at_s,
        plan.model,
        plan.type,
        plan.profile,
    )
    for name in ("heat_kw", "variance_kw2", "travel_mm", "angle_deg"):
        assert getattr(back, name) == pytest.approx(getattr(plan, name))
    assert convert.heat_plan(convert.heat_plan_message(None, 5)) is None
    message.model_names = ["dead_time_s", "copper_lag_s"]
    assert convert.heat_plan(message).problem is HeatPlanProblem.MODEL


@pytest.mark.parametrize("wrong", ["falling", "nan"])
def test_a_bad_plan_is_refused(wrong):
    message = convert.reference_plan_message(
        [(10**9, Reference(2.7, 820.0)), (2 * 10**9, Reference(2.8, 816.4))], 0
    )
    if wrong == "falling":
        message.references.reverse()
    else:
        message.references[1].depth = math.nan
    with pytest.raises(RefusedError) as refused:
        convert.reference_plan(message)
    assert refused.value.fact.code == ("falling" if wrong == "falling" else "out_of_range")
