"""Figures: every one is drawn, for one run, several, and for what a real bag may lack."""

import dataclasses

import numpy as np
import pytest

from fsw_analysis.figures import Run, draw, draw_open_loop, draw_whole_weld
from fsw_analysis.signals import load_weld


@pytest.fixture(scope="module")
def weld(weld_bag):
    return load_weld(weld_bag)


def is_png(path):
    return path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" and path.stat().st_size > 20_000


@pytest.mark.slow
def test_all_figures(weld, tmp_path):
    paths = draw([Run("one", weld)], [5, 6], tmp_path, "quick")
    assert [path.name for path in paths] == [
        *(f"quick_fig{number}.png" for number in (5, 6)),
        "quick_overview.png",
    ]
    assert all(is_png(path) for path in paths)


@pytest.mark.slow
def test_several_runs_and_missing_signals(weld, tmp_path):
    nothing = np.full(weld.n_ticks, np.nan)
    bare = dataclasses.replace(
        weld,
        truth=None,
        reference_depth_mm=nothing,
        reference_temperature_c=nothing,
        torque_nm=nothing,
        force_kn=nothing,
    )
    (path,) = draw([Run("one", weld), Run("bare", bare)], [], tmp_path)
    assert is_png(path)
    assert all(is_png(path) for path in draw([Run("bare", bare)], [6], tmp_path))


@pytest.mark.slow
def test_a_weld_in_phases_is_one_page(weld, tmp_path):
    draw_whole_weld([Run("one", weld)], [("dwell", 0.0, 5.0), ("start", 5.0, 20.0)], "title", tmp_path / "weld.png")
    assert is_png(tmp_path / "weld.png")


def test_bad_input(weld, tmp_path):
    with pytest.raises(ValueError, match="no run"):
        draw([], [4], tmp_path)
    with pytest.raises(ValueError, match="no figure 3"):
        draw([Run("one", weld)], [3], tmp_path)


def test_open_loop(tmp_path):
    names = ("depth_mm", "motor_torque_nm", "process_power_kw", "temperature_c", "force_kn", "speed_rpm")
    draw_open_loop({"time_s": np.arange(3.0), **{name: np.arange(3.0) for name in names}}, "title", tmp_path / "a.png")
    assert is_png(tmp_path / "a.png")
