"""Settings and schedules from data, and what is said of wrong ones."""

import math

import pytest
import yaml

from fsw_control import Limits
from fsw_control.parameters import defaults
from fsw_control.schema.models import InputError, Problem
from fsw_control.units import m_from_mm, mm_from_m, rad_s_from_rpm, rpm_from_rad_s
from fsw_model import ModelParameters
from fsw_plant import PlantConfig, PlantEmulator, PlantSchedule
from fsw_plant.event_schema import disturbance, fault
from fsw_plant.parameters import PlantParameters


def test_defaults_are_those_of_the_design():
    config = PlantConfig.from_values({})
    assert config.limits == Limits(60.0, 95.0, 300.0, 500.0, force_step_kn=1.0, speed_step_rpm=3.0)
    noise = [
        config[f"sensors.{name}"]
        for name in ("depth_noise_mm", "temperature_noise_c", "torque_noise_nm")
    ]
    assert noise == [0.002, 0.1, 2.0]
    assert config["actuators.lag_s"] == 0.02 and config["watchdog.timeout_s"] == 1.0


def test_every_model_parameter_can_differ():
    factors = [
        name.removeprefix("factors.")
        for name in defaults(PlantParameters)
        if name.startswith("factors.")
    ]
    assert factors == list(ModelParameters.model_fields)


def test_nested_and_dotted_are_the_same():
    nested = PlantConfig.from_values(
        {"seed": 3, "start": {"depth_mm": 2.7}, "factors": {"copper_lag_s": 1.1}}
    )
    assert nested == PlantConfig.from_values(
        {"seed": 3, "start.depth_mm": 2.7, "factors.copper_lag_s": 1.1}
    )


@pytest.mark.parametrize(
    "text, words",
    [
        ("sed: 1", "parameters sed"),
        ("start: {depth: 2.7}", r"parameters start\.depth"),
        ("seed: x", "seed is 'x'"),
        ("noise: 1", "noise is 1"),
        ("start: {depth_mm: 9}", r"start\.depth_mm = 9 .* 1 to 5 mm"),
        ("limits: {force_min_kn: 95}", r"limits force_min \(95\) .* force_max \(95\)"),
        ("factors: {copper_lag_s: 0}", "outside 0.1 to 10"),
        (
            "factors: {dead_time_s: 0.1, depth_pole_fast_s: 9}",
            r"depth_pole_fast_s = 0\.00855 .* 1e-06 to 0\.005",
        ),
    ],
)
def test_wrong_settings(text, words):
    with pytest.raises(InputError, match=words) as caught:
        PlantConfig.from_values(yaml.safe_load(text))
    assert "\n" not in str(caught.value)


def test_dead_time_of_no_whole_ticks_is_a_plant_like_any_other():
    plant = PlantEmulator(PlantConfig.from_values({"factors": {"dead_time_s": 1.01}}))
    plant.step()
    assert plant.stopped == ""


def event(**content):
    return [{"at_s": 1.0, **content}]


FAULT = "events[0].fault"
DISTURBANCE = "events[0].disturbance"


@pytest.mark.parametrize(
    ("events", "path", "kind", "fact"),
    [
        ("text", "events", "tuple_type", ""),
        ([1], "events[0]", "model_type", ""),
        (event(), "events[0]", "value_error", "exactly one"),
        (event(explosion={}), "events[0].explosion", "extra_forbidden", ""),
        (event(reference={}, switch="a"), "events[0]", "value_error", "reference and switch"),
        (event(fault={}), f"{FAULT}.sensor", "missing", ""),
        (event(fault={}), f"{FAULT}.kind", "missing", ""),
        (event(fault={"kind": "nan"}), f"{FAULT}.sensor", "missing", ""),
        (event(fault=3), FAULT, "model_type", ""),
        (
            [{"fault": {"sensor": "depth", "kind": "nan"}}],
            "events[0].at_s",
            "missing",
            "",
        ),
        (
            [{"at_s": -1, "fault": {"sensor": "depth", "kind": "nan"}}],
            "events[0].at_s",
            "outside",
            "0 to 36000 s",
        ),
        (
            event(fault={"sensor": "depth", "kind": "odd"}),
            f"{FAULT}.kind",
            "literal_error",
            "freeze",
        ),
        (
            event(fault={"sensor": "depth", "kind": "nan", "size": 1}),
            f"{FAULT}.size",
            "extra_forbidden",
            "known: sensor",
        ),
        (event(fault={"sensor": "depth", "kind": "bias"}), FAULT, "value_error", "magnitude_mm"),
        (event(fault={"sensor": "depth", "kind": "delay"}), FAULT, "value_error", "magnitude_s"),
        (
            event(fault={"sensor": "depth", "kind": "delay", "magnitude_s": 99}),
            f"{FAULT}.magnitude_s",
            "outside",
            "0 to 60 s",
        ),
        (
            event(fault={"sensor": "depth", "kind": "bias", "magnitude": 1, "magnitude_mm": 1}),
            f"{FAULT}.magnitude",
            "extra_forbidden",
            "",
        ),
        (
            event(fault={"sensor": "depth", "kind": "bias", "magnitude_c": 1}),
            FAULT,
            "value_error",
            "has magnitude_c",
        ),
        (
            event(disturbance={"channel": "traverse", "shape": "step"}),
            f"{DISTURBANCE}.channel",
            "literal_error",
            "'depth', 'temperature'",
        ),
        (
            event(disturbance={"channel": "depth", "shape": "step"}),
            DISTURBANCE,
            "value_error",
            "lacks amplitude_mm",
        ),
        (
            event(disturbance={"channel": "depth", "shape": "step", "amplitude_c": 1}),
            DISTURBANCE,
            "value_error",
            "has amplitude_c",
        ),
        (
            event(disturbance={"channel": "depth", "shape": "step", "amplitude_mm": "x"}),
            f"{DISTURBANCE}.amplitude_mm",
            "not_a_number",
            "'x'",
        ),
        (
            event(disturbance={"channel": "depth", "shape": "ramp", "amplitude_mm": 1}),
            DISTURBANCE,
            "value_error",
            "lacks duration_s",
        ),
    ],
)
def test_wrong_events(events, path, kind, fact):
    with pytest.raises(InputError) as caught:
        PlantSchedule.from_yaml(yaml.safe_dump(events))
    assert Problem(path, kind) in caught.value.problems
    assert fact in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("check", "asked", "path", "kind", "limits"),
    [
        (disturbance, ("depth", "step", 1e9), "amplitude_mm", "outside", "-1 to 1 mm"),
        (disturbance, ("depth", "step", math.nan), "amplitude_mm", "outside", "-1 to 1 mm"),
        (disturbance, ("temperature", "ramp", 5.0, 0.0), "duration_s", "outside", "0.1 to"),
        (disturbance, ("temperature", "sine", 5.0, 0.0, 1e9), "period_s", "outside", "36000 s"),
        (disturbance, ("nose", "step", 1.0), "channel", "literal_error", "depth"),
        (disturbance, ("depth", "jump", 1.0), "shape", "literal_error", "step"),
        (fault, ("depth", "bias", 1e9), "magnitude_mm", "outside", "-5 to 5 mm"),
        (fault, ("depth", "delay", 61.0), "magnitude_s", "outside", "0 to 60 s"),
        (fault, ("depth", "freeze", 0.0, -1.0), "duration_s", "outside", "36000 s"),
        (fault, ("nose", "bias", 1.0), "sensor", "literal_error", "depth"),
    ],
)
def test_runtime_requests_obey_the_scenario_ranges(check, asked, path, kind, limits):
    with pytest.raises(InputError) as caught:
        check(*asked)
    assert caught.value.problems == (Problem(path, kind),)
    assert limits in str(caught.value)


def test_limits_survive_the_wire_and_unused_fields_are_free():
    disturbance("spindle_speed", "step", rpm_from_rad_s(rad_s_from_rpm(-100.0)))
    disturbance("depth", "step", mm_from_m(m_from_mm(1.0)), duration_s=7.0, period_s=math.inf)
    disturbance("depth", "none", 1e9)
    fault("thermocouple", "freeze", 1e9)


SCENARIO = """
name: x
events:
  - {at_s: 2.0, fault: {sensor: thermocouple, kind: freeze, duration_s: 5.0}}
  - {at_s: 1.0, disturbance: {channel: temperature, shape: sine, amplitude_c: 3.0, period_s: 20.0}}
  - {at_s: 0.5, reference: {depth_mm: 2.8}}
  - {at_s: 1.0, disturbance: {channel: axial_force, shape: step, amplitude_kn: 1.0}}
  - {at_s: 3.0, fault: {sensor: torque, kind: bias, magnitude_nm: 20.0}}
  - {at_s: 3.5, fault: {sensor: torque, kind: none}}
  - {at_s: 4.0, switch: nmpc}
"""


def test_schedule_from_text_and_file(tmp_path):
    (tmp_path / "s.yaml").write_text(SCENARIO)
    for source in (SCENARIO, str(tmp_path / "s.yaml")):
        schedule = PlantSchedule.from_text_or_file(source)
        assert [(e.at_s, e.target, e.kind) for e in schedule.events] == [
            (1.0, "temperature", "sine"),
            (1.0, "axial_force", "step"),
            (2.0, "thermocouple", "freeze"),
            (3.0, "torque", "bias"),
            (3.5, "torque", "none"),
        ]
        assert schedule.due(0.9) == []
        assert len(schedule.due(1.0 - 1e-10)) == 2
        assert [e.target for e in schedule.due(3.2)] == ["thermocouple", "torque"]
        assert [e.kind for e in schedule.due(1e9)] == ["none"] and schedule.due(1e9) == []
    assert not PlantSchedule.from_text_or_file("  ").events
    assert (
        len(
            PlantSchedule.from_text_or_file(
                "[{at_s: 1, fault: {sensor: depth, kind: nan}}]"
            ).events
        )
        == 1
    )


@pytest.mark.parametrize("source", ["/nowhere/s.yaml", "a: b: c\n", "{", "\0"])
def test_unreadable_schedules(source):
    with pytest.raises(InputError, match=r"scenario|not valid|null byte"):
        PlantSchedule.from_text_or_file(source)
