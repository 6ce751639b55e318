"""``fsw footprint``: biases of the depth sensors of a recorded weld."""

import json
from dataclasses import replace

import numpy as np
import pytest

from fsw.errors import CommandError
from fsw.footprint_command import footprint_of
from fsw_analysis.weld_signals import FusedSignals
from fsw_control.depth_channels import CHANNELS, ChannelHealth
from fsw_control.depth_footprint import Footprint
from fsw_test_support.command_line import run
from fsw_test_support.judged_weld import TICKS, good_weld

SOURCE = ("weld", "0" * 64)
AT_DEG, DEPTHS = np.array([0.3, 0.7]), np.array([2.6, 2.5])


def weld(**changes):
    return replace(good_weld(), optional={"depth_laser_mm": np.full(TICKS, 2.7)}, **changes)


def test_every_depth_sensor_on_record_gets_its_bias():
    footprint = footprint_of(weld(), AT_DEG, DEPTHS, SOURCE, 0.0)
    biases = {row.sensor: row.bias_mm for row in footprint.sensors}
    assert biases == {
        "depth": pytest.approx((0.06, 0.16), abs=1e-3),
        "depth_laser": pytest.approx((0.1, 0.2), abs=1e-3),
    }
    assert footprint.depth_mm == (2.6, 2.5)


def test_expected_deflection_is_not_part_of_the_bias():
    pushed = weld()
    pushed.optional = {"depth_axial_mm": pushed.depth_mm + 0.15}
    pushed.drives.force_kn += 5.0
    expected = 0.15 - 5.0 * CHANNELS["axial"].deflection_mm_per_kn
    (_, axial) = footprint_of(pushed, AT_DEG, DEPTHS, SOURCE, 0.0).sensors
    assert axial.bias_mm[0] == pytest.approx(0.06 + expected, abs=1e-3)


def test_sensor_that_failed_can_be_left_out():
    footprint = footprint_of(weld(), AT_DEG, DEPTHS, SOURCE, 0.0, ("depth_laser",))
    assert [row.sensor for row in footprint.sensors] == ["depth"]


def test_earlier_bias_is_included_in_the_next_footprint():
    """Else every second weld of a series would have none taken off."""
    footprint = footprint_of(
        weld(footprint_bias_mm=np.full(TICKS, 0.2)), AT_DEG, DEPTHS, SOURCE, 0.0
    )
    assert footprint.sensors[0].bias_mm == pytest.approx((0.26, 0.36), abs=1e-3)


def test_samples_of_a_channel_that_was_not_good_do_not_count():
    bad = weld()
    health = np.zeros(TICKS)
    health[::2], bad.optional["depth_laser_mm"][::2] = ChannelHealth.SLIP, 9.0
    bad.fused = FusedSignals(np.full(TICKS, 0.02), {}, {"depth_laser": health})
    (_, laser) = footprint_of(bad, AT_DEG, DEPTHS, SOURCE, 0.0).sensors
    assert laser.bias_mm == pytest.approx((0.1, 0.2), abs=1e-3)


def test_angles_without_a_depth_are_left_out():
    footprint = footprint_of(weld(), np.array([0.3, 9.0]), DEPTHS, SOURCE, 0.0)
    assert footprint.angle_deg == (0.3,)
    with pytest.raises(CommandError):
        footprint_of(weld(), np.array([8.0, 9.0]), DEPTHS, SOURCE, 0.0)


def test_command_writes_a_file_that_the_plant_can_read(tmp_path, monkeypatch, capsys):
    """And replaces none."""
    measured, out = tmp_path / "measured.csv", tmp_path / "out.json"
    measured.write_text("angle_deg,depth_mm\n0.3,2.6\n0.7,2.5\n")
    bag = tmp_path / "bag"
    bag.write_bytes(b"a bag")
    monkeypatch.setattr("fsw.footprint_command.read_weld", lambda path: weld())
    words = ("footprint", str(bag), str(measured), "--out", str(out), "--deviation", "0.02")
    code, printed, _ = run(capsys, *words)
    assert code == 0
    assert "depth_laser" in printed
    assert Footprint.from_file(out).deviation_mm == 0.02
    assert json.loads(out.read_text())["weld"] == "bag"
    assert run(capsys, *words)[0] == 1
