"""Figures: every one is drawn, for one run, several, and for what a real bag may lack."""

import dataclasses

import numpy as np
import pytest

from fsw_decentral import DecentralController
from fsw_experiment import scenario_file
from fsw_experiment.closed_loop import ClosedLoop
from fsw_experiment.figures import Run, draw


@pytest.fixture(scope="module")
def weld():
    return ClosedLoop(scenario_file.load("quick"), {"decentral": DecentralController()}).run()


def is_png(path):
    return path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" and path.stat().st_size > 20_000


def test_all_figures(weld, tmp_path):
    paths = draw([Run("one", weld)], [4, 5, 6, 7, 8, 9], tmp_path, "quick")
    assert [path.name for path in paths] == [
        *(f"quick_fig{number}.png" for number in range(4, 10)),
        "quick_overview.png",
    ]
    assert all(is_png(path) for path in paths)


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
    assert all(is_png(path) for path in draw([Run("bare", bare)], [6, 7], tmp_path))


def test_bad_input(weld, tmp_path):
    with pytest.raises(ValueError, match="no run"):
        draw([], [4], tmp_path)
    with pytest.raises(ValueError, match="no figure 3"):
        draw([Run("one", weld)], [3], tmp_path)
