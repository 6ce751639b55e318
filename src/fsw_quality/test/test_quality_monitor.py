"""The watch within a weld: silent in a good one, and the right cause in one that is not."""

from __future__ import annotations

from collections.abc import Iterable
from math import nan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fsw_control.sensors import REQUIRED
from fsw_quality.diagnosis import RESIDUALS, diagnose, load_limits
from fsw_quality.monitor import PROCESSES, Monitor, Sample
from fsw_test_support.watched_weld import drifting, samples

GOOD = samples()
STILL = samples(excited=False)


def told(weld: Iterable[Sample], process: str = "paper") -> dict[str, float]:
    """When each kind of alarm was first told."""
    monitor, found = Monitor(process), dict[str, float]()
    for one in weld:
        monitor.step(one)
        for finding in monitor.findings:
            assert 0.0 < finding.confidence <= 1.0 and finding.value > 0.0
            found.setdefault(finding.kind, one.time_s)
    return found


@pytest.mark.parametrize("process", PROCESSES)
def test_nothing_is_told_of_a_weld_that_goes_as_the_model_says(process: str) -> None:
    # nothing controls it, which is told rightly
    assert told(GOOD, process).keys() <= {"poor_control_depth", "poor_control_temperature"}


@pytest.mark.parametrize(
    ("name", "per_s", "kind", "within_s"),
    [
        ("temperature_c", 2.0 / 60.0, "thermocouple", 120.0),
        ("torque_nm", 20.0 / 60.0, "torque_sensor", 60.0),
        ("depth_mm", 0.1 / 60.0, "depth_or_force_sensor", 90.0),
    ],
)
def test_a_sensor_that_drifts_is_named(name: str, per_s: float, kind: str, within_s: float) -> None:
    found = told(drifting(GOOD, name, per_s))
    assert kind in found and 120.0 < found[kind] < 120.0 + within_s


def test_on_a_canister_the_drift_is_told_and_so_are_the_causes_that_it_may_have() -> None:
    found = told(drifting(GOOD, "temperature_c", 3.0 / 60.0), "canister")
    assert "thermocouple" not in found and found["sinking_or_thermocouple"] < 240.0


@pytest.mark.parametrize(
    ("factors", "kind"),
    [
        ({"thermal_gain_c_per_kw": 1.2}, "gain_heat"),
        ({"depth_gain_mm_per_kn_s": 1.25}, "gain_depth"),
        ({"sticking_stress_pa": 1.2, "sliding_friction": 1.2}, "gain_torque"),
        ({"dead_time_s": 1.5}, "dead_time"),
    ],
)
def test_a_process_unlike_the_model_is_told(factors: dict[str, float], kind: str) -> None:
    assert kind in told(samples(250.0, **factors))


def test_the_gains_are_those_of_the_process() -> None:
    monitor, gains = Monitor(), dict[str, tuple[float, float]]()
    for one in samples(160.0, thermal_gain_c_per_kw=1.1, depth_gain_mm_per_kn_s=0.9):
        monitor.step(one)
        gains |= {name: one for name, one in monitor.gains.items() if not one[1] > gains.get(name, one)[1]}
    for name, gain in (("heat", 1.1), ("depth", 0.9)):
        estimated, error = gains[name]
        assert abs(estimated - gain) < 2.0 * error + 0.01 and error < 0.06


def test_without_excitation_no_gain_is_told() -> None:
    monitor = Monitor()
    for one in STILL:
        monitor.step(one)
        assert not {"heat", "depth"} & monitor.gains.keys() and "dead_time" not in monitor.figures


@pytest.mark.parametrize("process", PROCESSES)
@pytest.mark.parametrize("correlation_s", [1.0, 5.0])
def test_noise_that_is_correlated_is_no_fault_and_its_time_is_known(process: str, correlation_s: float) -> None:
    weld = samples(correlation_s=correlation_s)
    assert told(weld, process).keys() <= {"poor_control_depth", "poor_control_temperature"}
    monitor = Monitor(process)
    for one in weld:
        monitor.step(one)
    assert monitor.correlations_s.keys() == set(REQUIRED)
    assert correlation_s / 3.0 < monitor.correlations_s["depth"] < 3.0 * correlation_s


def test_white_noise_is_not_taken_for_correlated() -> None:
    for weld in (GOOD, STILL):
        monitor = Monitor()
        for one in weld:
            monitor.step(one)
        assert not monitor.correlations_s


@pytest.mark.parametrize(
    ("name", "per_s", "kinds"),
    [
        ("torque_nm", 20.0 / 60.0, {"torque_sensor", "tool"}),
        ("depth_mm", 0.1 / 60.0, {"depth_or_force_sensor", "sinking"}),
        ("temperature_c", 6.0 / 60.0, {"thermocouple", "heat"}),
    ],
)
def test_a_drift_shows_in_noise_that_is_correlated_too(name: str, per_s: float, kinds: set[str]) -> None:
    found = told(drifting(samples(correlation_s=5.0), name, per_s))
    assert kinds & {kind for kind, at_s in found.items() if 120.0 < at_s < 240.0}


def later(weld: list[Sample], **changes: object) -> list[Sample]:
    """A weld in which some fields are replaced by a function of tick and sample, from 120 s on."""
    return [
        one._replace(**{name: change(k, one) for name, change in changes.items()}) if one.time_s > 120.0 else one  # type: ignore[operator]
        for k, one in enumerate(weld)
    ]


def test_drives_that_stick_or_lag_are_told() -> None:
    random = np.random.default_rng(3)
    moved = 78.4 + np.cumsum(random.normal(0.0, 0.08, len(GOOD)))
    stuck = later(GOOD, command_force_kn=lambda k, _: moved[k], force_kn=lambda k, _: moved[k - k % 40])
    late = later(GOOD, command_force_kn=lambda k, _: moved[k], force_kn=lambda k, _: moved[k - 5])
    assert "stiction_force" in told(stuck)
    assert "lag_force" in told(late)


def test_sensors_that_stand_still_or_lose_or_gain_noise_are_told() -> None:
    random = np.random.default_rng(4)
    assert "stuck_torque" in told(later(GOOD, torque_nm=lambda _, __: 1050.0))
    assert "noise_grown_depth" in told(later(GOOD, depth_mm=lambda _, one: one.depth_mm + 0.006 * random.normal()))
    assert "noise_gone_thermocouple" in told(later(GOOD, temperature_c=lambda k, _: 816.4 + 1e-5 * k))


def test_samples_that_scatter_less_under_another_controller_are_no_fault() -> None:
    random = np.random.default_rng(5)
    moved = [one._replace(torque_nm=one.torque_nm + 4.0 * random.normal()) for one in STILL]
    calmer = [STILL[k] if one.time_s > 120.0 else one for k, one in enumerate(moved)]
    assert "noise_gone_torque" in told(calmer)
    swapped = [one._replace(source="other") if one.time_s > 120.0 else one for one in calmer]
    assert "noise_gone_torque" not in told(swapped)
    # what is not usual at the swap is not learnt as usual
    dead = later(STILL, temperature_c=lambda k, _: 816.4 + 1e-5 * k)
    assert "noise_gone_thermocouple" in told(
        one._replace(source="other") if one.time_s > 150.0 else one for one in dead
    )


def test_a_loop_that_swings_is_told_with_its_period() -> None:
    swinging = later(
        STILL, temperature_c=lambda _, one: one.temperature_c + 1.5 * np.sin(one.time_s * 2 * np.pi / 20.0)
    )
    monitor = Monitor()
    causes = set()
    for one in swinging:
        monitor.step(one)
        causes |= {finding.cause for finding in monitor.findings if finding.kind == "oscillation_temperature"}
    assert any("20 s" in cause for cause in causes)


def test_another_weld_and_a_gap_begin_anew() -> None:
    monitor = Monitor()
    for one in GOOD[:1200]:
        monitor.step(one)
    assert not monitor.learning
    monitor.step(GOOD[0])
    assert monitor.restarts == 1 and monitor.learning
    for one in GOOD[1:100]:
        monitor.step(one._replace(depth_mm=nan))
    monitor.step(GOOD[100])
    assert monitor.restarts == 2


@settings(max_examples=20, deadline=None)
@given(st.lists(st.tuples(*[st.floats()] * 9), min_size=1, max_size=40))
def test_no_sample_stops_it(values: list[tuple[float, ...]]) -> None:
    monitor = Monitor()
    for k, row in enumerate(values):
        monitor.step(Sample(0.1 * k, *row))
    for one in GOOD[:300]:
        monitor.step(one)
    assert all(np.isfinite(value) for value in monitor.figures.values())


@pytest.mark.parametrize("process", PROCESSES)
def test_every_figure_has_a_cause_in_words(process: str) -> None:
    limits = load_limits()[process]
    numbers = dict.fromkeys(("torque", "heat", "depth", "ratio", "dead_time", "nominal_dead_time"), 1.0)
    numbers |= {f"{name}_{what}": 1.0 for name in ("heat", "depth") for what in ("gain", "error")}
    numbers |= {f"period_{name}": 10.0 for name in ("depth", "temperature")}
    for name, limit in limits.limits.items():
        (found,) = diagnose({name: 2.0 * limit}, limits, {name: True}, numbers)
        assert found.cause and found.advice and "{" not in found.cause
    judged = [name for name in RESIDUALS if limits.known_heat or name != "heat"]
    assert {RESIDUALS[name] for name in judged} <= limits.limits.keys()
    # where the model does not know the heat, its figures would tell how a canister warms up
    assert limits.known_heat == any(name.endswith("heat") for name in limits.limits)


def test_a_gain_is_not_told_while_a_sensor_is_noisy() -> None:
    limits = load_limits()["paper"]
    figures = {name: 1.5 * limits.limits[name] for name in ("gain_depth", "noise_grown_depth")}
    words = {"depth_gain": 1.2, "depth_error": 0.02}
    assert [one.kind for one in diagnose(figures, limits, dict.fromkeys(figures, True), words)] == ["noise_grown_depth"]
    active = {"gain_depth": True, "noise_grown_depth": False}
    assert [one.kind for one in diagnose(figures, limits, active, words)] == ["gain_depth"]


@pytest.mark.parametrize("process", PROCESSES)
def test_an_edge_of_the_workpiece_is_no_change_of_the_process(process: str) -> None:
    edge = [one._replace(depth_mm=one.depth_mm + 0.03 * (one.time_s > 150.0)) for one in GOOD]
    assert told(edge, process).keys() <= {"poor_control_depth", "poor_control_temperature"}


def largest(weld: Iterable[Sample], figure: str) -> float:
    """Largest value of a figure, as a share of its limit on a canister."""
    monitor, found = Monitor("canister"), 0.0
    for one in weld:
        monitor.step(one)
        found = max(found, monitor.figures.get(figure, 0.0))
    return found / load_limits()["canister"].limits[figure]


def test_an_edge_is_no_change_of_the_torque_at_the_same_depth() -> None:
    """The edge of 0.05 mm between lid and canister moves what depth is measured from: 6 N m of the model's torque."""
    assert (
        largest([one._replace(depth_mm=one.depth_mm + 0.05 * (one.time_s > 150.0)) for one in GOOD], "drift_torque")
        < 0.6
    )
    # a depth that is really another changes the torque, and the model knows how much: spikes and noise are no edges
    noise = np.random.default_rng(6).normal(0.0, 0.006, len(GOOD))
    assert largest([one._replace(depth_mm=one.depth_mm + noise[k]) for k, one in enumerate(GOOD)], "drift_torque") < 0.6


def test_a_torque_that_swings_or_is_off_throughout_does_not_drift() -> None:
    swinging = [one._replace(torque_nm=one.torque_nm + 5.0 * np.sin(one.time_s * 2 * np.pi / 60.0)) for one in GOOD]
    assert largest(swinging, "drift_torque") < 0.9
    assert largest(samples(sliding_friction=1.05, sticking_stress_pa=1.05), "drift_torque") < 0.6


def test_a_gain_of_the_depth_unlike_the_model_is_no_drift() -> None:
    """Set-points move the depth while the monitor learns what is normal, and later."""
    for gain in (0.95, 1.05):
        assert largest(samples(depth_gain_mm_per_kn_s=gain), "drift_depth") < 0.6


def test_after_a_step_a_gain_is_judged_and_not_the_colour_of_its_error() -> None:
    monitor, step_s = Monitor(), 200.0
    for one in samples(thermal_gain_c_per_kw=1.04):
        monitor.step(one._replace(reference_temperature_c=816.4 + (one.time_s > step_s)))
        if 120.0 < one.time_s < step_s or step_s + 65.0 < one.time_s:
            assert "innovation_colour_heat" in monitor.figures
        if step_s + 2.5 < one.time_s < step_s + 60.0:
            assert "innovation_colour_heat" not in monitor.figures and "innovation_size_heat" in monitor.figures


def test_the_begin_of_a_weld_is_no_gain_of_the_torque() -> None:
    monitor = Monitor()
    for one in GOOD[:600]:
        monitor.step(one._replace(torque_nm=one.torque_nm * (1.12 if one.time_s < 8.0 else 1.0)))
        assert monitor.figures.get("gain_torque", 0.0) < 2.0


def test_an_offset_of_the_load_cell_is_no_stiction() -> None:
    offset = [one._replace(command_force_kn=one.command_force_kn + 0.3) for one in STILL]
    assert not any(kind.startswith("stiction") for kind in told(offset))
