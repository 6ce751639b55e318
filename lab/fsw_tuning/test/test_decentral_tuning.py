"""The shipped gains keep the bounds and reach the targets they are documented with.

The tuner's formulas are right.
"""

import math
import random

import numpy as np
import pytest

from fsw_decentral import Gains, tunings
from fsw_model import OperatingPointError, nominal
from fsw_tuning import decentral_loop, tune_decentral
from fsw_tuning.decentral_loop import noise_moves, sensitivity, simulate
from fsw_tuning.standard_cases import REST
from fsw_tuning.tune_decentral import BOUNDS, SEARCHED, TARGETS

EACH = pytest.mark.parametrize("name", tunings())
#: factors on the parameters of the process that a tuning was made for
MISMATCH = (
    {"dead_time_s": 0.8},
    {"dead_time_s": 1.2},
    {"thermal_gain_c_per_kw": 0.8},
    {"thermal_gain_c_per_kw": 1.2},
    {"depth_gain_mm_per_kn_s": 1.2},
    {"softening_per_c": 1.5},
)


def simulated_sensitivity(gains, parameters=None):
    """The peaks of both sensitivities by simulation: from the response to a tiny impulse on one sensor.

    Inf if it does not die out.
    """
    # The impulse response of the closed loop is S itself: the peak of its Fourier transform is Ms.
    peaks = []
    for channel, size in enumerate((1e-5, 1e-4)):
        pulse = np.zeros((3010, 3))
        pulse[10, channel] = size
        try:
            rows = simulate(gains, pulse, None, parameters, latency_ticks=1)
        except OperatingPointError:
            return math.inf, math.inf
        response = rows[10:, channel] - (REST.depth_mm, REST.temperature_c)[channel]
        settled = np.abs(response[-500:]).max() < 1e-3 * size
        peaks.append(float(np.abs(np.fft.rfft(response / size)).max()) if settled else math.inf)
    return peaks[0], peaks[1]


@EACH
def test_shipped_gains_are_within_the_bounds(name):
    gains = tunings()[name]
    pairs = zip(
        BOUNDS[name].values(), (*simulated_sensitivity(gains), *noise_moves(gains)), strict=True
    )
    assert all(figure <= bound for bound, figure in pairs)


@EACH
def test_shipped_gains_reach_their_targets(name):
    figures = decentral_loop.errors(tunings()[name])
    assert {
        key: figures[key] for key, target in TARGETS[name].items() if figures[key] > target
    } == {}
    assert figures["unsettled_c"] < 0.3


@pytest.mark.slow
@EACH
def test_shipped_gains_are_stable_on_processes_unlike_the_model(name):
    for factors in MISMATCH:
        assert max(simulated_sensitivity(tunings()[name], nominal().scaled(**factors))) < 3.5


@EACH
def test_computed_sensitivity_matches_the_simulation(name):
    """Away from the shipped gains as well, and with every filter and derivative in play."""
    gains = tunings()[name]
    other = gains.changed(
        depth_derivative_time=0.3,
        temperature_derivative_time=0.4,
        temperature_filter=0.8,
        power_filter=0.5,
        feedforward_filter=0.7,
    )
    for these in (gains, other):
        assert sensitivity(these) == pytest.approx(simulated_sensitivity(these), rel=0.01)


def test_computed_noise_moves_match_the_simulation():
    gains, source = tunings()["tight"], random.Random(3)
    rows = simulate(
        gains,
        np.array(
            [[source.gauss(0.0, size) for size in decentral_loop.NOISE] for _ in range(8000)]
        ),
    )
    moves = np.diff(rows[200:, 2:], axis=0).std(axis=0)
    assert tuple(moves) == pytest.approx(noise_moves(gains), rel=0.05)


def test_an_unstable_loop_has_no_finite_sensitivity():
    gains = tunings()["tight"].changed(temperature_gain=5.0)
    assert simulated_sensitivity(gains)[1] == math.inf


def test_the_search_finds_the_bottom_of_a_narrow_valley(monkeypatch):
    """As many variables as there are gains, whose scales differ by 30, turned against the axes."""
    shipped = tunings()["tight"]
    turn, _ = np.linalg.qr(
        np.random.default_rng(0).standard_normal((len(SEARCHED), len(SEARCHED)))
    )
    scales, bottom = (
        np.geomspace(1.0, 30.0, len(SEARCHED)),
        np.log([getattr(shipped, key) for key in SEARCHED]),
    )

    def valley(gains, name, parameters):
        return float(
            (
                (scales * (turn @ (np.log([getattr(gains, key) for key in SEARCHED]) - bottom)))
                ** 2
            ).sum()
        )

    monkeypatch.setattr(tune_decentral, "cost", valley)
    shares = []
    tuned = tune_decentral.tune("tight", evaluations=3000, progress=shares.append)
    start = tune_decentral.start_of("tight", nominal())
    assert valley(tuned, "", None) < 1e-2 * valley(start, "", None)
    assert shares == sorted(shares) and shares[0] > 0.0 and shares[-1] <= 1.0
    assert tune_decentral.tune("tight", evaluations=100) == tune_decentral.tune(
        "tight", evaluations=100
    )


@pytest.mark.slow
@pytest.mark.full
def test_tuning_another_process_improves_on_its_start_and_stays_in_range():
    other = nominal().scaled(thermal_gain_c_per_kw=0.7, dead_time_s=1.2)
    tuned = tune_decentral.tune("conservative", other, evaluations=60)
    start = tune_decentral.start_of("conservative", other)
    assert tune_decentral.cost(tuned, "conservative", other) < tune_decentral.cost(
        start, "conservative", other
    )
    assert set(SEARCHED) == {
        name for name, field in Gains.model_fields.items() if field.is_required()
    }
    for key, (low, high) in SEARCHED.items():
        assert low <= getattr(tuned, key) <= high
