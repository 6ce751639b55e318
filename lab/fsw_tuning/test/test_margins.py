"""Gain and delay margins by simulation."""

import math

import pytest

from fsw_model import nominal
from fsw_tuning.margins import Loops, largest_delay, largest_gain, texts


def test_delay_and_gain_beyond_the_margin_are_unstable():
    loops = Loops("decentral:conservative")
    assert loops.is_stable()
    assert not loops.is_stable(60)
    assert not loops.is_stable(thermal_gain_c_per_kw=8.0)
    tight = Loops("decentral:tight")
    assert tight.with_delay(2.0) and not tight.with_delay(7.2)


def test_margins_use_the_given_process():
    """Half of the model's gain leaves twice the margin."""
    half = Loops("decentral:conservative", process=nominal().scaled(thermal_gain_c_per_kw=0.5))
    assert half.is_stable(thermal_gain_c_per_kw=4.0)
    assert not Loops("decentral:conservative").is_stable(thermal_gain_c_per_kw=4.0)


@pytest.mark.parametrize(
    ("factor", "margin", "most"),
    [(0.2, math.inf, "> 8"), (1.5, pytest.approx(1.8, rel=0.1), "> 6.6"), (4.0, 1.0, "> 2.5")],
)
def test_margin_search_ends_at_the_limits_of_the_emulator(factor, margin, most):
    process = nominal().scaled(thermal_gain_c_per_kw=factor)
    assert Loops("decentral:tight", process=process).gain("thermal_gain_c_per_kw") == margin
    assert texts({"depth_gain": math.inf, "temperature_gain": math.inf}, process) == {
        "depth_gain": "> 8",
        "temperature_gain": most,
    }


@pytest.mark.parametrize("margin", [1.05, 2.7, 7.9])
def test_largest_stable_gain_is_found(margin):
    assert margin / 1.02 <= largest_gain(lambda gain: gain <= margin) <= margin
    assert largest_gain(lambda gain: True) == math.inf


def test_largest_stable_delay_is_found():
    assert [largest_delay(lambda ticks, most=most: ticks <= most, 72) for most in (0, 1, 5, 57, 72, 99)] == [
        0, 1, 5, 57, 72, 72,
    ]  # fmt: skip
