"""Heat of a constructed weld is found again, with its place and its uncertainty."""

from dataclasses import replace
from math import exp

import numpy as np
import pytest
import yaml
from scipy.signal import lfilter

from fsw_campaign.welds import with_programme
from fsw_control.schema.models import InputError
from fsw_identification.heat import (
    FAST_LAG_S,
    HeatRecord,
    HeatWalk,
    fit_fast,
    fit_walk,
    smooth,
)
from fsw_identification.heat_learning import learn
from fsw_model import nominal
from fsw_nmpc import NmpcController
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.scenario_file import parse

P = nominal()
TICK_S, DIGEST = 0.1, "0" * 64


def shown_rise(power_kw, model):
    """Answer of the thermocouple to a power that arrives at once, from rest."""
    for lag_s in (model.copper_lag_s, model.tool_lag_s):
        left = exp(-TICK_S / lag_s)
        power_kw = lfilter([1.0 - left], [1.0, -left], power_kw)
    return model.thermal_gain_c_per_kw * power_kw


def bump(travel_mm):
    """Known heat by place: up by 2 kW about 100 mm, and down to -1 kW beyond."""
    return 2.0 * np.exp(-(((travel_mm - 100.0) / 25.0) ** 2)) - 1.0 / (
        1.0 + np.exp(-(travel_mm - 160.0) / 8.0)
    )


def weld(seed, heat=bump):
    """A weld along 220 mm whose thermocouple also shows the effect of a heat."""
    phases = [
        {"name": "dwell", "duration_s": 20.0},
        {"name": "start", "to_deg": 20.0, "length_mm": 220.0},
    ]
    content = {"name": "way", "controller": "nmpc", "phases": phases, "plant": {"seed": seed}}
    scenario = parse(yaml.safe_dump(content), "way")
    signals = with_programme(ClosedLoop(scenario, {"nmpc": NmpcController()}).run(), scenario)
    rise_c = shown_rise(heat(signals.travel_mm), P)
    return replace(signals, temperature_c=signals.temperature_c + rise_c)


@pytest.fixture(scope="module")
def welds():
    return [(f"C{seed}", DIGEST, weld(seed)) for seed in (1, 2, 3)]


def moved(values, places):
    """Without their constant: only changes are meant."""
    inside = (places > 15.0) & (places < 205.0)
    return values[inside] - values[inside].mean()


@pytest.mark.slow
def test_learnt_profile_matches_a_constructed_weld(welds):
    """One weld tells it as its noise lets it; three tell it better, and say how they differ."""
    errors = {}
    for n in (1, 3):
        learned = learn(welds[:n], "made", P, 0.05, keep_model=True)
        assert learned.model == P
        places = np.array(learned.profile.travel_mm)
        error = moved(np.array(learned.profile.heat_kw), places) - moved(bump(places), places)
        errors[n] = float(np.std(error))
        assert [source.weld for source in learned.profile.welds] == [
            name for name, *_ in welds[:n]
        ]
    assert errors[1] < 0.25
    assert errors[3] < errors[1]
    assert all(0.0 < source.left_out_kw < 0.5 for source in learned.profile.welds)


@pytest.mark.slow
def test_weld_of_another_type_has_a_large_left_out_error(welds):
    """The leave-one-out check shows it."""

    def mirrored(travel_mm):
        return bump(220.0 - travel_mm)

    strange = ("C9", DIGEST, weld(9, mirrored))
    learned = learn([*welds, strange], "mixed", P, 0.05, keep_model=True)
    own, other = learned.profile.welds[0].left_out_kw, learned.profile.welds[-1].left_out_kw
    assert other > 1.5 * own
    alone = learn(welds, "made", P, 0.05, keep_model=True)
    assert min(learned.profile.deviation_kw) > 1.5 * max(alone.profile.deviation_kw)


def record(rng, model, walk_kw=0.15, minutes=15):
    """A weld of a model whose heat is a random walk and whose power moves."""
    n = minutes * 600
    power_kw = np.repeat(rng.normal(0.0, 2.0, n // 50), 50)
    heat_kw = np.cumsum(rng.normal(0.0, walk_kw * np.sqrt(TICK_S), n))
    late = np.concatenate([np.zeros(round(model.dead_time_s / TICK_S)), power_kw])[:n]
    rise_c = shown_rise(late + heat_kw, model) + rng.normal(0.0, 0.1, n)
    return HeatRecord(0, power_kw, rise_c), heat_kw


def test_fast_part_of_the_copper_is_identified():
    truth = P.changed(
        thermal_gain_c_per_kw=9.5, copper_lag_s=FAST_LAG_S, tool_lag_s=0.6, dead_time_s=1.9
    )
    rng = np.random.default_rng(4)
    fitted, walk = fit_fast([record(rng, truth)[0] for _ in range(2)], P)
    assert fitted.thermal_gain_c_per_kw == pytest.approx(9.5, rel=0.05)
    assert fitted.copper_lag_s == FAST_LAG_S
    assert fitted.tool_lag_s == pytest.approx(0.6, abs=0.15)
    assert fitted.dead_time_s == pytest.approx(1.9, abs=0.15)
    # together they are surer than each: a lag looks like a later and softer response
    assert fitted.tool_lag_s + fitted.dead_time_s == pytest.approx(2.5, abs=0.1)
    assert walk.heat_kw == pytest.approx(0.15, rel=0.2)


def test_control_action_against_slow_heat_does_not_bias_the_gain():
    """A controller takes back six seconds later what drifts; a walk without rate finds 8.5."""
    truth = P.changed(
        thermal_gain_c_per_kw=9.5, copper_lag_s=FAST_LAG_S, tool_lag_s=0.6, dead_time_s=1.9
    )
    rng, n = np.random.default_rng(3), 6000
    steps, rates = (rng.normal(0.0, size * np.sqrt(TICK_S), n) for size in (0.1, 0.01))
    heat_kw = np.cumsum(steps + TICK_S * np.cumsum(rates))
    power_kw = np.repeat(rng.normal(0.0, 0.3, n // 50), 50)
    power_kw -= np.concatenate([np.zeros(60), heat_kw])[:n]
    late = np.concatenate([np.zeros(19), power_kw])[:n]
    rise_c = shown_rise(late + heat_kw, truth) + rng.normal(0.0, 0.1, n)
    fitted, walk = fit_fast([HeatRecord(0, power_kw, rise_c)], P)
    assert fitted.thermal_gain_c_per_kw == pytest.approx(9.5, rel=0.05)
    assert walk.heat_kw == pytest.approx(0.1, rel=0.2)


def test_walk_of_the_heat_is_identified_with_a_given_model():
    rng = np.random.default_rng(8)
    assert fit_walk([record(rng, P, 0.3)[0]], P).heat_kw == pytest.approx(0.3, rel=0.2)


def test_errors_of_smoothed_heat_match_its_variance():
    rng = np.random.default_rng(6)
    made, heat_kw = record(rng, P, minutes=5)
    gaps = np.zeros(made.rise_c.size, bool)
    gaps[1000:1100] = True  # a thermocouple that is lost for ten seconds
    smoothed = smooth(
        made._replace(rise_c=np.where(gaps, np.nan, made.rise_c)), P, HeatWalk(0.15, 1e-3)
    )
    error = (smoothed.heat_kw - heat_kw)[600:-100]
    expected = np.sqrt(smoothed.variance_kw2[600:-100])
    assert 0.5 < np.sqrt(np.mean((error / expected) ** 2)) < 1.6
    assert smoothed.variance_kw2[1050] > smoothed.variance_kw2[900]


def test_weld_without_a_path_is_refused(welds):
    name, digest, signals = welds[0]
    still = replace(signals, travel_mm=np.full(signals.n_ticks, np.nan))
    with pytest.raises(InputError, match="path"):
        learn([(name, digest, still)], "made", P, 0.05)
    with pytest.raises(InputError):
        learn([], "made", P, 0.05)
