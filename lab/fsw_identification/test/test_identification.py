"""Identification: simulation along recorded inputs, estimates, what is left out, report."""

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy

from fsw_analysis.weld_signals import DriveSignals, FloatArray, WeldSignals
from fsw_control.schema.models import InputError
from fsw_identification import (
    disturbed,
    estimation,
    report,
    statistics,
    summary,
)
from fsw_identification.drives import from_air
from fsw_identification.elimination import knots
from fsw_identification.evidence import _WINDOW_TICKS, _long_run, long_run_covariance
from fsw_identification.problem import HEAT, WALK, Prior, Problem
from fsw_identification.simulation import (
    CANDIDATES,
    DEPTH,
    KNOT_TICKS,
    TEMPERATURE,
    Knowledge,
    as_shown,
    driven,
    heated,
    respond,
    rising,
    shown,
    walks,
)
from fsw_identification.solver import solve
from fsw_identification.weld_data import Segment, prepare
from fsw_model import ModelParameters, ParameterCovariance, ProcessModel

NOISE = (0.002, 0.1, 2.0)
#: a process unlike the nominal one, with a dead time of no whole number of steps
OTHER = ModelParameters().scaled(
    thermal_gain_c_per_kw=0.8, copper_lag_s=1.2, tool_lag_s=1.4, dead_time_s=0.873, depth_gain_mm_per_kn_s=1.25,
    depth_zero_s=0.9, softening_per_c=0.7, sliding_friction=1.04, motor_lag_s=0.8,
)  # fmt: skip


def signals_of(columns: dict[str, FloatArray], path: str = "weld") -> WeldSignals:
    """Signals of a weld from columns of outputs and inputs."""
    n = len(columns["depth_mm"])
    time_s, nothing = 0.1 * np.arange(n), np.full(n, np.nan)
    words = np.full(n, "", dtype=object)
    return WeldSignals(
        path=Path(path),
        stamp_ns=np.arange(1, n + 1, dtype=np.int64) * 100_000_000,
        time_s=time_s,
        depth_mm=columns["depth_mm"],
        torque_nm=columns["torque_nm"],
        temperature_c=columns["temperature_c"],
        reference_depth_mm=nothing,
        reference_temperature_c=nothing,
        force_kn=columns["force_kn"],
        speed_rpm=columns["speed_rpm"],
        command_source=words,
        command_reason=words,
        command_latency_s=nothing,
        actual_controller=words,
        actual_mode=words,
        # what acts at a tick is what was held until it
        drives=DriveSignals(
            *(
                np.concatenate([of[:1], of[:-1]])
                for of in (columns["force_kn"], columns["speed_rpm"])
            )
        ),
    )


def weld(
    p: ModelParameters = OTHER, seconds: float = 150.0, seed: int = 1, noise: float = 1.0
) -> WeldSignals:
    """An open-loop weld with balanced steps of force and speed about the process's rest."""
    generator = np.random.default_rng(seed)
    n = round(10 * seconds)
    model = ProcessModel(p)
    rest = model.equilibrium()
    inputs = []
    for centre, size, holds in (
        (rest.force_kn, 2.5, (30, 60, 150)),
        (rest.speed_rpm, 6.0, (40, 80, 120)),
    ):
        levels: list[float] = [0.0] * 50
        while len(levels) < n:
            hold, sign = int(generator.choice(holds)), float(generator.choice((-1.0, 1.0)))
            levels += [sign * size] * hold + [-sign * size] * hold
        inputs.append(centre + np.array(levels[:n]))
    course = model.simulate(inputs[0].tolist(), inputs[1].tolist(), rest)
    # the spindle's acceleration shows in the torque, at the end of the step in which it moved
    moved = np.diff(course["speed_rpm"], prepend=rest.speed_rpm)
    inertia_nm = np.concatenate([[0.0], moved[:-1]]) / 0.1 * p.spindle_inertia_kgm2 * np.pi / 30.0
    shown = (course["depth_mm"], course["temperature_c"], course["motor_torque_nm"] + inertia_nm)
    noisy = [
        of + noise * std * generator.standard_normal(n)
        for of, std in zip(shown, NOISE, strict=True)
    ]
    names = ("depth_mm", "temperature_c", "torque_nm")
    columns = dict(zip(names, noisy, strict=True))
    return signals_of(
        {**columns, "force_kn": course["force_kn"], "speed_rpm": course["speed_rpm"]}
    )


def only(signals: WeldSignals) -> Segment:
    (segment,) = prepare(signals, 0.0).segments
    return segment


def scores(fit: estimation.Fit, p: ModelParameters = OTHER) -> dict[str, float]:
    """Errors in standard deviations."""
    return {
        name: (getattr(fit.parameters, name) - getattr(p, name)) / std
        for name, std in fit.std.items()
    }


def measured(segment: Segment, p: ModelParameters) -> Knowledge:
    depth, temperature, _ = segment.measured.T
    return Knowledge(
        temperature - p.operating_temperature_c, depth, *np.zeros((3, segment.n_ticks))
    )


@pytest.mark.parametrize("dead_time_s", [0.1, 1.0, 2.4444])
def test_responses_are_those_of_the_model(dead_time_s: float) -> None:
    p = OTHER.changed(dead_time_s=dead_time_s)
    segment = only(weld(p, 60.0, noise=0.0))
    for output, tolerance in enumerate((2e-5, 5e-3, 0.05)):
        response = respond(output, p, segment, measured(segment, p))
        difference = response.factor * response.course - segment.measured[:, output]
        assert np.abs(difference).max() < tolerance


def test_a_disturbance_acts_like_the_input() -> None:
    segment = only(weld(OTHER, 60.0, noise=0.0))
    known = measured(segment, OTHER)
    usual = respond(DEPTH, OTHER, segment, known)
    at_knots = np.zeros((knots(segment.n_ticks), 6))
    at_knots[:, -2] = np.random.default_rng(0).standard_normal(len(at_knots))
    course = np.interp(
        np.arange(segment.n_ticks + 1), KNOT_TICKS * np.arange(len(at_knots)), at_knots[:, -2]
    )
    pushed = replace(segment, force_kn=segment.force_kn + (course[1:] + course[:-1]) / 2.0)
    walk = walks(usual)
    by = shown(usual, walk, driven(walk, at_knots)) - shown(usual, walk, 0.0 * at_knots)
    expected = respond(DEPTH, OTHER, pushed, known)
    assert (
        np.abs(expected.factor * (expected.course - usual.course) - by).max()
        < 1e-4 * np.abs(by).max()
    )


def test_power_heats_after_the_dead_time() -> None:
    power = np.where(np.arange(600) < 100, 0.0, 1.3)
    rise = heated(OTHER, power, power)
    arrives = 100 + int(OTHER.dead_time_s / 0.1)
    assert not rise[: arrives + 1].any() and rise[arrives + 2] > 0.0
    assert 0.6 < rise[-1] / 1.3 / OTHER.thermal_gain_c_per_kw < 1.0


@pytest.mark.parametrize("lag_s", [0.3, OTHER.tool_lag_s, 3.0])
def test_a_thermocouple_follows_with_a_first_order_lag(lag_s: float) -> None:
    segment = only(weld(OTHER, 60.0, noise=0.0))
    known = measured(segment, OTHER)
    tool, slow = (respond(TEMPERATURE, OTHER, segment, known, one_s) for one_s in (0.0, lag_s))
    rate = rising(OTHER, segment, known, lag_s, np.zeros((knots(segment.n_ticks), 7)))
    assert np.ptp(tool.course - slow.course) > 0.1
    np.testing.assert_allclose(slow.course + lag_s * rate, tool.course, rtol=0.0, atol=0.01)


def test_two_lags_approximate_three() -> None:
    lagged, step = as_shown(OTHER, 3.0), np.append(0.0, np.ones(600))
    wrong = heated(lagged, step, step) - heated(OTHER, step, step, 3.0)
    assert np.abs(wrong).max() < 0.02 * OTHER.thermal_gain_c_per_kw
    assert lagged.thermal_gain_c_per_kw == OTHER.thermal_gain_c_per_kw
    assert OTHER.dead_time_s < lagged.dead_time_s < OTHER.dead_time_s + OTHER.tool_lag_s


@pytest.mark.slow
def test_estimate_with_its_deviations() -> None:
    fit = estimation.identify([only(weld())])
    assert {
        "thermal_gain_c_per_kw",
        "dead_time_s",
        "depth_gain_mm_per_kn_s",
        "depth_zero_s",
    } <= set(fit.free)
    assert max(map(abs, scores(fit).values())) < 4.0
    assert fit.std["dead_time_s"] < 0.1 and fit.std["thermal_gain_c_per_kw"] < 1.0
    assert fit.noise == pytest.approx(NOISE, rel=0.1)
    assert not fit.shifts and not fit.notes
    judged = statistics.judge(fit.segments, fit.residuals, fit.whitened)
    assert all(max(judged.outside(output)) < 0.1 for output in range(3))


@pytest.mark.slow
@pytest.mark.full
def test_colour_of_the_noise_is_estimated() -> None:
    signals, left = weld(seconds=200.0, noise=0.0), statistics.autocorrelation_of(2.0)
    fresh = np.random.default_rng(3).standard_normal((3, signals.n_ticks))
    for of, std, white in zip(
        (signals.depth_mm, signals.temperature_c, signals.torque_nm), NOISE, fresh, strict=True
    ):
        of += std * scipy.signal.lfilter([np.sqrt(1.0 - left**2)], [1.0, -left], white)
    fit = estimation.identify([only(signals)])
    assert max(map(abs, scores(fit).values())) < 4.0
    assert fit.noise == pytest.approx(NOISE, rel=0.3)
    assert fit.correlation_s == pytest.approx([2.0] * 3, rel=0.6)
    assert not summary.disturbances(fit)
    assert (
        sum("correlated over" in line for line in summary.remarks(summary.Summary("weld", fit)))
        == 3
    )
    assert summary.model_text(fit, "weld").count("correlated over") == 3
    slow = replace(fit, correlation_s=np.array([0.0, 2.0, 20.0]))
    assert [
        "torque" in line for line in summary.disturbances(slow) if "counts as noise" in line
    ] == [True]
    steady = estimation.identify([only(signals)], steady=True)
    assert sum("--steady " in note and "white" in note for note in steady.notes) == 3


@pytest.mark.slow
@pytest.mark.full
def test_lag_of_the_thermocouple_is_identified_from_the_depth() -> None:
    signals, left = weld(seconds=200.0, noise=0.0), np.exp(-0.1 / 2.0)
    rise, mean = signals.temperature_c - signals.temperature_c[0], (1.0 - left) * 2.0 / 0.1
    # exact for a temperature that is linear within a step
    signals.temperature_c[:] -= rise - scipy.signal.lfilter(
        [1.0 - mean, mean - left], [1.0, -left], rise
    )
    for of, std in zip(
        (signals.depth_mm, signals.temperature_c, signals.torque_nm), NOISE, strict=True
    ):
        of += std * np.random.default_rng(3).standard_normal(signals.n_ticks)
    fit = estimation.identify([only(signals)])
    assert fit.lag_s is not None and fit.lag_s[0] == pytest.approx(
        2.0, abs=max(0.1, 4.0 * fit.lag_s[1])
    )
    assert fit.known_lag_s == fit.lag_s[0]
    assert max(map(abs, scores(fit).values())) < 4.0
    assert any("lags" in line for line in summary.remarks(summary.Summary("weld", fit)))
    text = summary.model_text(fit, "weld")
    assert "lags" in text and text.count("the thermocouple shows") == 2
    from_file = ModelParameters.from_yaml(text)
    assert (
        from_file.dead_time_s > OTHER.dead_time_s + 0.3
        and from_file.tool_lag_s > OTHER.tool_lag_s + 0.3
    )
    late_s = from_file.dead_time_s + from_file.tool_lag_s - OTHER.dead_time_s - OTHER.tool_lag_s
    assert late_s == pytest.approx(2.0, abs=0.3)


@pytest.mark.slow
@pytest.mark.full
def test_two_welds_are_more_informative_than_one() -> None:
    segments = [only(weld(seconds=80.0, seed=seed)) for seed in (1, 2)]
    single, both = estimation.identify(segments[:1]), estimation.identify(segments)
    assert both.std["thermal_gain_c_per_kw"] < 0.9 * single.std["thermal_gain_c_per_kw"]


def test_prior_is_widened_by_the_step_from_weld_to_weld() -> None:
    known = ParameterCovariance(
        parameters=["dead_time_s", "copper_lag_s"], covariance=[[4e-4, 1e-4], [1e-4, 9e-4]]
    )
    names = ("copper_lag_s", "dead_time_s", "softening_per_c")
    covariance = Prior.of(OTHER, known).covariance_of(names)
    assert covariance[:2, :2] == pytest.approx(np.array([[10e-4, 1e-4], [1e-4, 5e-4]]))
    assert covariance[2, 2] == pytest.approx(0.2**2 + 1e-4) and not covariance[2, :2].any()
    other = Prior.of(OTHER, known, other_type=True).covariance_of(names)
    assert np.sqrt(np.diag(other - covariance)) == pytest.approx([0.2, 0.05, 0.05], rel=0.03)
    # what a lagging thermocouple shows says nothing of the tool
    lagging = Prior.of(OTHER, known).covariance_of(names, lagged=True)
    assert lagging[1, 1] > 1.0 and not lagging[1, [0, 2]].any()
    assert Prior().covariance_of(names)[0, 0] > 1.0 and not Prior().lacks(OTHER, names).any()
    assert Prior.of(OTHER, known).lacks(OTHER.scaled(copper_lag_s=1.1), names) == pytest.approx(
        [-np.log(1.1), 0.0, 0.0]
    )


@pytest.mark.slow
@pytest.mark.full
def test_prior_and_second_weld_equal_both_welds_together() -> None:
    """Without a change between them; up to what is linearised, and what noise one weld shows."""
    segments = [only(weld(seconds=80.0, seed=seed)) for seed in (1, 2)]
    first, both = estimation.identify(segments[:1]), estimation.identify(segments)
    seen = [CANDIDATES.index(name) for name in first.free]
    covariance = np.diag(np.full(len(CANDIDATES), 4.0))
    covariance[np.ix_(seen, seen)] = first.covariance
    second = estimation.identify(
        segments[1:], first.parameters, prior=Prior(first.parameters, covariance)
    )
    for name in ("thermal_gain_c_per_kw", "dead_time_s", "depth_gain_mm_per_kn_s"):
        values = [getattr(fit.parameters, name) for fit in (second, both)]
        assert values[0] == pytest.approx(values[1], abs=0.4 * both.std[name])
        assert second.std[name] == pytest.approx(both.std[name], rel=0.25)
        assert second.std[name] < 0.9 * first.std[name]
        assert second.moved[name] < summary.STRANGE
    assert not first.moved


@pytest.mark.slow
@pytest.mark.full
def test_weld_of_another_machine_contradicts_the_prior() -> None:
    names = ["thermal_gain_c_per_kw", "dead_time_s"]
    known = ParameterCovariance(parameters=names, covariance=np.diag([1e-4, 1e-4]).tolist())
    fit = estimation.identify(
        [only(weld(seconds=80.0))], OTHER, prior=Prior.of(OTHER.scaled(dead_time_s=1.5), known)
    )
    assert fit.moved["dead_time_s"] > summary.STRANGE > fit.moved["thermal_gain_c_per_kw"]
    lines = [
        line for line in summary.remarks(summary.Summary("weld", fit)) if "--other-type" in line
    ]
    assert len(lines) == sum(size > summary.STRANGE for size in fit.moved.values())
    assert any(line.startswith("dead_time_s") for line in lines)


@pytest.mark.slow
@pytest.mark.full
def test_shifts_are_estimated_and_do_not_bias() -> None:
    signals = weld()
    signals.depth_mm[700:] += 0.05
    signals.torque_nm[400:600] += 15.0
    fit = estimation.identify([only(signals)])
    sizes = {(shift.output, shift.tick): size for shift, size, _ in fit.shifts}
    shown = {(0, 700): 0.05, (2, 400): 15.0, (2, 600): -15.0}
    # a shift of the sensor alone does not heat
    assert sizes == pytest.approx(shown | {(HEAT, 400): -15.0, (HEAT, 600): 15.0}, rel=0.2)
    assert max(map(abs, scores(fit).values())) < 4.0
    lines = summary.disturbances(fit)
    assert (
        sum("shifts by" in line for line in lines) == 3
        and sum("heats like" in line for line in lines) == 2
    )


def test_disturbed_windows_are_detected() -> None:
    generator = np.random.default_rng(4)
    noise = np.array([0.002, 0.1, 2.0])
    clean = noise * generator.standard_normal((20_000, 3))
    assert not disturbed.disturbed_windows(clean, noise).any()
    ticks = np.arange(200)
    swinging, kinked, coloured = clean[:3000].copy(), clean[:3000].copy(), clean[:3000].copy()
    swinging[600:800, 0] += 0.02 * np.sin(ticks / 3.0)
    kinked[600:800, 1] += 0.5 * (1.0 - np.abs(ticks - 100) / 100.0)
    coloured[:, 2] = np.convolve(clean[:3000, 2], np.ones(8), "same")
    for residuals, output in ((swinging, 0), (kinked, 1)):
        windows = disturbed.disturbed_windows(residuals, noise)
        assert (
            windows[650:750, output].all()
            and not windows[900:, output].any()
            and not windows[:500, output].any()
        )
        assert windows.any(axis=0).sum() == 1
    assert (
        disturbed.disturbed_windows(coloured, noise).mean() < 0.02
    )  # noise that is not white is no disturbance


@pytest.mark.slow
@pytest.mark.full
def test_slow_disturbance_is_estimated_and_does_not_bias() -> None:
    signals = weld()
    signals.temperature_c[500:] += np.minimum(4.0, 0.01 * np.arange(signals.n_ticks - 500))
    fit = estimation.identify([only(signals)])
    assert max(map(abs, scores(fit).values())) < 4.5
    assert any(
        "slow disturbance" in line and "temperature" in line
        for line in summary.remarks(summary.Summary("weld", fit))
    )


@pytest.mark.slow
@pytest.mark.full
def test_steady_disturbances_neither_drift_nor_shift() -> None:
    """Without any the estimate is as good; a shift then stays in the residuals."""
    signals = weld()
    clean = estimation.identify([only(signals)], steady=True)
    assert max(map(abs, scores(clean).values())) < 4.0
    signals.depth_mm[700:] += 0.05
    fit = estimation.identify([only(signals)], steady=True)
    assert (
        not fit.shifts
        and (
            np.ptp(fit.disturbances[0], axis=0) < 0.2 * np.array([1.0, 1.0, 0.01, 1.0, 10.0])
        ).all()
    )
    assert fit.noise[0] > 2.0 * clean.noise[0]


@pytest.mark.slow
@pytest.mark.full
def test_fast_disturbance_of_the_temperature() -> None:
    """What heat and offset add together stays of the disturbance's size.

    It grew from iteration to iteration.
    """
    signals = weld()
    ticks = np.arange(544)
    signals.temperature_c[480:1024] -= 3.9 * np.sin(2.0 * np.pi * ticks / 342.0)
    segment = only(signals)
    fit = estimation.identify([segment])
    assert all(
        np.nanmax(np.abs(predicted[:, 1] - segment.measured[:, 1])) < 20.0
        for predicted in fit.predicted
    )


@pytest.mark.slow
@pytest.mark.full
def test_depth_distinguishes_temperature_offset_from_heat() -> None:
    signals = weld(seconds=400.0)
    signals.temperature_c[500:] += np.minimum(25.0, 0.0125 * np.arange(signals.n_ticks - 500))
    fit = estimation.identify([only(signals)])
    assert abs(fit.share[0]) < 4.0 * fit.share[1] < 0.4
    assert fit.heat_and_offset < -0.2
    assert abs(scores(fit)["depth_gain_mm_per_kn_s"]) < 4.0
    lines = summary.remarks(summary.Summary("weld", fit))
    assert any("heat and offset" in line and "correlation -" in line for line in lines)


def test_failed_estimate_is_an_input_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(_: object) -> None:
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(estimation.Problem, "settle", broken)
    with pytest.raises(InputError, match=r"\(Singular matrix\)"):
        estimation.identify([only(weld(seconds=40.0))])


def test_dead_time_beyond_the_models_range_is_refused_not_clipped() -> None:
    longest = ModelParameters(dead_time_s=10.0)
    with pytest.raises(InputError, match="dead_time_s"):
        estimation.identify([only(weld(seconds=40.0))], longest)


@pytest.mark.slow
def test_nothing_is_identifiable_at_rest() -> None:
    signals = weld(seconds=60.0)
    rest = [
        np.full(600, of[0]) for of in (signals.depth_mm, signals.temperature_c, signals.torque_nm)
    ]
    noise = np.random.default_rng(0).standard_normal((3, 600))
    depth, temperature, torque = (
        of + std * white for of, std, white in zip(rest, NOISE, noise, strict=True)
    )
    inputs = {"force_kn": np.full(600, 78.4), "speed_rpm": np.full(600, 407.6)}
    quiet = signals_of(
        {"depth_mm": depth, "temperature_c": temperature, "torque_nm": torque, **inputs}
    )
    with pytest.raises(InputError, match="hardly move"):
        estimation.identify([only(quiet)])
    # with a prior it says nothing new
    known = ParameterCovariance(parameters=["dead_time_s"], covariance=[[1e-4]])
    prior = Prior.of(OTHER, known)
    fit = estimation.identify([only(quiet)], OTHER, prior=prior)
    assert fit.parameters.dead_time_s == pytest.approx(OTHER.dead_time_s, rel=2e-3)
    expected = prior.covariance_of(fit.free)[fit.free.index("dead_time_s")]
    assert fit.std["dead_time_s"] == pytest.approx(
        OTHER.dead_time_s * np.sqrt(expected.max()), rel=0.05
    )


@pytest.mark.slow
@pytest.mark.full
def test_unexcited_parameters_stay_nominal() -> None:
    p = ModelParameters()
    model = ProcessModel(p)
    rest = model.equilibrium()
    speed = rest.speed_rpm + 5.0 * np.where(np.arange(1200) // 100 % 2, 1.0, -1.0)
    course = model.simulate([rest.force_kn] * 1200, speed.tolist(), rest)
    noise = np.random.default_rng(0).standard_normal((3, 1200))
    shown = (course["depth_mm"], course["temperature_c"], course["motor_torque_nm"])
    depth, temperature, torque = (
        of + std * white for of, std, white in zip(shown, NOISE, noise, strict=True)
    )
    inputs = {"force_kn": course["force_kn"], "speed_rpm": course["speed_rpm"]}
    signals = signals_of(
        {"depth_mm": depth, "temperature_c": temperature, "torque_nm": torque, **inputs}
    )
    fit = estimation.identify([only(signals)])
    assert "thermal_gain_c_per_kw" in fit.free and "depth_zero_s" not in fit.free
    assert fit.parameters.depth_zero_s == p.depth_zero_s
    assert "more than 100 %" in fit.kept["depth_zero_s"]


def test_unusable_samples_are_left_out() -> None:
    signals = weld(seconds=60.0)
    signals.depth_mm[200:240] = signals.depth_mm[199]  # frozen
    signals.temperature_c[300:310] = np.nan
    signals.torque_nm[400] = 1e6
    data = prepare(signals, 0.0)
    measured = data.segments[0].measured
    assert (
        np.isnan(measured[201:240, 0]).all()
        and np.isnan(measured[300:310, 1]).all()
        and np.isnan(measured[400, 2])
    )
    text = "\n".join(data.notes)
    assert "depth" in text and "frozen" in text and "missing" in text and "out of range" in text


def test_a_long_weld_is_one_segment() -> None:
    whole = weld(seconds=40.0)
    n = 10000
    names = ("depth_mm", "temperature_c", "torque_nm", "force_kn", "speed_rpm")
    long = signals_of({name: np.resize(getattr(whole, name), n) for name in names})
    data = prepare(long, 0.0)
    assert [segment.n_ticks for segment in data.segments] == [n] and not data.notes


def test_long_gap_divides_the_weld() -> None:
    signals = weld(seconds=120.0)
    signals.stamp_ns[700:] += 5_000_000_000
    segments = prepare(signals, 0.0).segments
    assert [segment.n_ticks for segment in segments] == [700, 500]
    assert segments[1].begin_s == pytest.approx(75.0)


@pytest.mark.parametrize(("ticks", "enough"), [(2, True), (5, False), (10, False)])
def test_a_log_with_a_sample_in_fewer_than_half_of_the_ticks_is_refused(
    ticks: int, enough: bool
) -> None:
    signals = weld(seconds=40.0)
    signals.stamp_ns[:] = signals.stamp_ns[0] + ticks * (signals.stamp_ns - signals.stamp_ns[0])
    with nullcontext() if enough else pytest.raises(InputError, match="5 Hz"):
        assert [part.n_ticks for part in prepare(signals, 0.0).segments] == [399 * ticks + 1]


def test_commands_stand_in_for_the_drives() -> None:
    signals = weld(seconds=40.0)
    with_drives = only(signals)
    signals.drives = None
    data = prepare(signals, 0.0)
    np.testing.assert_allclose(data.segments[0].force_kn[:-1], with_drives.force_kn[:-1])
    assert len(data.notes) == 1 and "commands" in data.notes[0]


def test_inputs_within_a_step_follow_the_lag_of_the_drives() -> None:
    signals = weld(seconds=40.0)
    assert signals.drives is not None
    left, setpoint, position, means = (
        np.exp(-0.1 / 0.05),
        signals.force_kn,
        float(signals.force_kn[0]),
        [],
    )
    for k, wanted in enumerate(setpoint):
        signals.drives.force_kn[k] = position
        means.append(wanted + (position - wanted) * 0.5 * (1.0 - left))
        position = wanted + (position - wanted) * left
    np.testing.assert_allclose(prepare(signals, 0.05).segments[0].force_kn[:-1], means[:-1])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"torque_nm": np.full(400, np.nan)}, "of torque"),
        ({"drives": None, "force_kn": np.full(400, np.nan)}, "/fsw/drives nor /fsw/command"),
    ],
)
def test_weld_without_a_required_signal_is_refused(
    change: dict[str, FloatArray], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        prepare(replace(weld(seconds=40.0), **change), 0.0)  # type: ignore[arg-type]


def test_short_weld_is_refused() -> None:
    with pytest.raises(InputError, match="of 30 s"):
        prepare(weld(seconds=10.0), 0.0)


@pytest.mark.slow
def test_validation_shows_a_wrong_model() -> None:
    segment = only(weld(seed=3))
    right, wrong = (estimation.validate([segment], p) for p in (OTHER, ModelParameters()))
    fits = [
        statistics.judge(fit.segments, fit.residuals, fit.whitened).fit_percent
        for fit in (right, wrong)
    ]
    assert all(good > 80.0 for good in fits[0]) and fits[1][1] < fits[0][1] - 10.0


@pytest.mark.slow
def test_model_file_and_report(tmp_path: Path) -> None:
    segment = only(weld(seconds=80.0))
    fit = estimation.identify([segment])
    text = summary.model_text(fit, "weld")
    read = ModelParameters.from_yaml(text)
    assert read.thermal_gain_c_per_kw == pytest.approx(
        fit.parameters.thermal_gain_c_per_kw, rel=1e-5
    )
    assert "# +- " in text and "#   geometry_factor" in text
    result = summary.Summary("weld <1>", fit, estimation.validate([segment], fit.parameters))
    page, picture = report.write(result, tmp_path)
    assert picture.read_bytes().startswith(b"\x89PNG")
    written = page.read_text(encoding="utf-8")
    assert (
        "weld &lt;1&gt;" in written
        and "data:image/png;base64," in written
        and "http" not in written
    )


def test_friction_from_a_run_in_air() -> None:
    p = ModelParameters(friction_constant_nm=200.0)
    speeds = np.repeat([320.0, 380.0, 440.0, 480.0], 200)
    shown = (
        p.friction_constant_nm
        + p.friction_linear_nm_per_rpm * speeds
        + p.friction_quadratic_nm_per_rpm2 * speeds**2
    )
    nothing = np.full(800, np.nan)
    columns = {
        "depth_mm": nothing,
        "temperature_c": nothing,
        "force_kn": np.zeros(800),
        "speed_rpm": speeds,
    }
    signals = signals_of(
        {**columns, "torque_nm": shown + np.random.default_rng(0).normal(0.0, 2.0, 800)}
    )
    fitted, deviations = from_air(signals, ModelParameters(), 0.02)
    for name, std in deviations.items():
        assert abs(getattr(fitted, name) - getattr(p, name)) < 4.0 * std
    slow = replace(signals, drives=DriveSignals(np.zeros(800), np.full(800, 400.0)))
    with pytest.raises(InputError, match="it has 1"):
        from_air(slow, ModelParameters(), 0.02)


def test_long_run_factor() -> None:
    white = np.random.default_rng(0).standard_normal(3000)
    coloured = np.convolve(white, 0.9 ** np.arange(60))[:3000]
    assert statistics.long_run_factor([white]) == 1.0
    assert statistics.long_run_factor([coloured]) > 5.0


def test_slow_noise_is_detected_by_the_sum_over_lags() -> None:
    """2 % of the variance, correlated over 10 s."""
    generator, left = np.random.default_rng(1), 0.99
    white = generator.standard_normal(3000)
    slow = scipy.signal.lfilter(
        [np.sqrt(0.02 * (1.0 - left**2))], [1.0, -left], generator.standard_normal(3000)
    )
    segment = only(weld(seconds=300.0))
    for noise, is_slow in ((white, False), (white + slow, True)):
        left_over = [np.column_stack([white, noise, white])]
        judged = statistics.judge([segment], left_over, left_over)
        assert judged.outside(TEMPERATURE)[0] < 0.07
        assert (judged.together(TEMPERATURE) > statistics.SLOW) == is_slow
        assert (statistics.long_run_factor([noise]) > 1.5) == is_slow


def test_long_run_variance_is_the_weighted_sum_over_lags() -> None:
    scores = np.random.default_rng(0).standard_normal((3 * _WINDOW_TICKS, 2))
    lags = np.abs(np.subtract.outer(*2 * [np.arange(len(scores))]))
    expected = scores.T @ np.maximum(0.0, 1.0 - lags / _WINDOW_TICKS) @ scores
    np.testing.assert_allclose(_long_run(scores), expected)


def widened(noise: FloatArray) -> FloatArray:
    """Variances by the residuals over those by the model, of a weld with this noise.

    ``noise`` is in the sensors' standard deviations.
    """
    segment = only(weld(seconds=300.0, noise=0.0))
    segment = replace(
        segment, measured=segment.measured + np.array(NOISE) * noise[: segment.n_ticks]
    )
    problem = Problem(
        [segment], OTHER, ("thermal_gain_c_per_kw", "depth_gain_mm_per_kn_s", "sliding_friction")
    )
    problem.walk = WALK[0]
    solve(problem, lambda: None)
    ratios = np.diag(long_run_covariance(problem)) / np.diag(np.linalg.inv(problem.information()))
    return np.asarray(ratios[: len(problem.free)])


def test_residuals_widen_the_intervals_where_they_are_not_white() -> None:
    white = np.random.default_rng(6).standard_normal((3000, 3))
    assert (np.abs(np.log(widened(white))) < np.log(2.0)).all()
    assert (widened(scipy.signal.lfilter([1.0], [1.0, -0.9], white, axis=0)) > 3.0).all()
