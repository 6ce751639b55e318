"""Figures: every one is drawn, for one run, several, and for what a real bag may lack."""

import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest

from fsw_analysis.figure_style import CONTROLLER_COLOURS, colours_of
from fsw_analysis.figures import Run, draw, draw_open_loop, draw_whole_weld, page
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
    draw_whole_weld(
        [Run("one", weld)],
        [("dwell", 0.0, 5.0), ("start", 5.0, 20.0)],
        "title",
        tmp_path / "weld.png",
    )
    assert is_png(tmp_path / "weld.png")


def test_open_loop(tmp_path):
    names = (
        "depth_mm",
        "motor_torque_nm",
        "process_power_kw",
        "temperature_c",
        "force_kn",
        "speed_rpm",
    )
    draw_open_loop(
        {"time_s": np.arange(3.0), **{name: np.arange(3.0) for name in names}},
        "title",
        tmp_path / "a.png",
    )
    assert is_png(tmp_path / "a.png")


def test_a_controller_has_one_colour_wherever_it_stands(weld):
    def colour(label, *labels):
        axes = page([Run(one, weld) for one in labels]).axes
        return next(line.get_color() for line in axes[2].get_lines() if line.get_label() == label)

    for label in ("nmpc", "decentral:tight", "mine"):
        assert (
            colour(label, "decentral", label)
            == colour(label, label, "decentral")
            == colours_of([label])[0]
        )
    assert colours_of(["nmpc", "nmpc:default"])[0] != colours_of(["nmpc", "nmpc:default"])[1]
    by_source = dataclasses.replace(
        weld, command_source=np.full(weld.n_ticks, "nmpc", dtype=object)
    )
    axes = page([Run("bag_1", by_source)]).axes
    assert axes[2].get_lines()[0].get_color() == CONTROLLER_COLOURS["nmpc"]


def test_the_more_restless_of_two_lies_below_and_is_wider(weld):
    restless = dataclasses.replace(weld, force_kn=weld.force_kn + np.arange(weld.n_ticks) % 2)
    for runs in ([Run("a", restless), Run("b", weld)], [Run("b", weld), Run("a", restless)]):
        lines = {line.get_label(): line for line in page(runs).axes[3].get_lines()}
        assert lines["a"].get_zorder() < lines["b"].get_zorder()
        assert lines["a"].get_linewidth() > lines["b"].get_linewidth()


def test_what_happens_is_marked_at_its_time_on_every_axis(weld):
    def stepped(values, *ticks):
        return np.asarray(values) + np.isin(np.arange(weld.n_ticks), ticks).cumsum()

    nothing = np.zeros(weld.n_ticks)
    faults = np.where((weld.time_s >= 20.0) & (weld.time_s < 25.0), "depth: stuck", "").astype(
        object
    )
    truth = dataclasses.replace(
        weld.truth, depth_disturbance_mm=nothing, temperature_disturbance_c=nothing, speed_disturbance_rpm=nothing,
        force_disturbance_kn=stepped(nothing, 99), active_faults=faults,
    )  # fmt: skip
    source = np.where(weld.time_s < 15.0, "nmpc", "decentral").astype(object)
    eventful = dataclasses.replace(
        weld,
        truth=truth,
        command_source=source,
        reference_depth_mm=stepped(nothing, 49),
        reference_temperature_c=np.full(weld.n_ticks, 850.0),
    )
    for axis in page([Run("one", eventful)]).axes:
        named = {
            line.get_label(): np.round(line.get_xdata(), 6).tolist() for line in axis.get_lines()
        }
        assert named["set-point"] == [5.0] and named["disturbance"] == [10.0]
        assert named["fault on, off"] == [20.0, 25.0] and named["swap"] == [15.0, 15.0]
        assert {"nmpc commands", "decentral commands"} <= {
            one.get_label() for one in axis.collections
        }


@pytest.mark.slow
def test_nothing_is_said_without_a_home_folder(tmp_path):
    environment = {**os.environ, "HOME": "/proc/none", "TMPDIR": str(tmp_path)}
    environment = {name: value for name, value in environment.items() if name != "MPLCONFIGDIR"}
    code = (
        "import fsw_analysis.figures, matplotlib.font_manager; print(matplotlib.get_configdir())"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True
    )
    assert ended.stderr == "" and ended.stdout.startswith(str(tmp_path / "fsw-"))
