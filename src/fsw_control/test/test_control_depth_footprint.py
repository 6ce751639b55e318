"""Biases of the depth sensors by the footprint, and what the next weld makes of them."""

import json
from itertools import product

import numpy as np
import pytest

from fsw_control.depth_channels import CHANNELS
from fsw_control.depth_footprint import (
    Footprint,
    SensorBias,
    biases,
    measured_depths,
    smoothed,
)
from fsw_control.depth_fusion import DepthFusion
from fsw_control.schema.models import InputError

FOOTPRINT = Footprint(
    weld="weld",
    sha256="0" * 64,
    angle_deg=(0.0, 10.0),
    depth_mm=(2.6, 2.7),
    deviation_mm=0.01,
    sensors=tuple(
        SensorBias(sensor=name, bias_mm=(0.1, 0.3), deviation_mm=(0.0, 0.01))
        for name in ("depth", "depth_laser")
    ),
)


def test_bias_is_the_mean_over_the_ticks_nearest_to_an_angle():
    angle = np.linspace(-20.0, 30.0, 501)
    shown = np.where(angle < 5.0, 2.8, 3.0)
    shown[angle < -6.0] = 9.0  # beyond the measured places
    late = np.where(angle > 20.0, shown, np.nan)
    measured = biases(angle, {"a": shown, "b": late}, np.array([0.0, 10.0]), np.array([2.6, 2.7]))
    assert measured["a"] == pytest.approx([0.2, 0.3], abs=0.01)
    assert np.isnan(measured["b"]).all()


def test_bias_at_an_angle():
    assert FOOTPRINT.bias_mm("depth_laser", 5.0) == pytest.approx((0.2, 0.005))
    assert FOOTPRINT.bias_mm("depth_laser", 99.0) == (0.3, 0.01)
    assert FOOTPRINT.bias_mm("depth_laser", np.nan) == pytest.approx((0.2, 0.005))
    assert FOOTPRINT.bias_mm("depth_axial", 5.0) == (0.0, np.inf)


def test_next_weld_takes_off_what_the_footprint_shows_but_for_what_does_not_repeat():
    rows = {name: CHANNELS[name] for name in ("laser", "lvdt_lead")}
    with_prior = DepthFusion(channels=rows, footprint=FOOTPRINT)
    without = DepthFusion(channels=rows)
    for tick in range(1, 200):
        shown = dict.fromkeys(rows, 2.66 + 0.2)
        estimate = with_prior.update(0.1 * tick, shown, 78.4, angle_deg=5.0)
        plain = without.update(0.1 * tick, shown, 78.4, angle_deg=5.0)
    assert plain.depth_mm == pytest.approx(2.86, abs=1e-3)
    assert 0.7 < (plain.depth_mm - estimate.depth_mm) / 0.2 < 1.0
    assert estimate.deviation_mm < plain.deviation_mm


@pytest.mark.parametrize(("seed", "wave_mm"), list(product(range(4), (0.0, 0.02))))
def test_errors_of_the_measurement_are_smoothed(seed, wave_mm):
    """Also where few angles are measured; what is left is as large as the deviation says."""
    at_deg = np.arange(0.0, 48.0, 2.0)
    bias = 0.1 + wave_mm * np.sin(np.radians(4.0 * at_deg))
    measured = bias + np.random.default_rng(seed).normal(0.0, 0.01, at_deg.size)
    mean, deviation = smoothed(at_deg, measured, 0.01, at_deg)
    assert np.abs(mean - bias).max() < (0.015 if wave_mm else 0.008)
    assert np.sqrt(np.mean(((mean - bias) / deviation) ** 2)) < 2.0
    exact, _ = smoothed(at_deg[:2], measured[:2], 0.0, at_deg[:2])
    assert exact == pytest.approx(measured[:2], abs=1e-3)


def test_file_is_read_back(tmp_path):
    path = tmp_path / "footprint.json"
    path.write_text(json.dumps(FOOTPRINT.model_dump()))
    assert Footprint.from_file(path) == FOOTPRINT


@pytest.mark.parametrize(
    "text",
    [
        "angle,depth_mm\n0,1\n",
        "angle_deg,depth_mm\n0,x\n",
        "angle_deg,depth_mm\n0\n",
        "angle_deg,depth_mm\n0,nan\n",
        "angle_deg,depth_mm\n",
        "angle_deg,depth_mm\n0,1\n0,2\n",
    ],
)
def test_measured_depths_must_be_numbers_by_angle(tmp_path, text):
    path = tmp_path / "measured.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=r"measured\.csv"):
        measured_depths(path)


def test_measured_depths_are_put_in_order(tmp_path):
    path = tmp_path / "measured.csv"
    path.write_text("angle_deg,depth_mm\n10,2.7\n0,2.6\n")
    angle, depth = measured_depths(path)
    assert angle.tolist() == [0.0, 10.0]
    assert depth.tolist() == [2.6, 2.7]
