"""Figures: every one is drawn, for one run, several, and for what a real bag may lack."""

import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest

from fsw_analysis.figure_style import CONTROLLERS, OTHERS, looks_of, sheet
from fsw_analysis.figures import Run, draw, draw_whole_weld, page
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


def test_a_controller_has_one_look_wherever_it_stands(weld):
    def look(label, *labels):
        axes = page([Run(one, weld) for one in labels]).axes
        line = next(line for line in axes[2].get_lines() if line.get_label() == label)
        return line.get_color(), line.is_dashed()

    for label in ("nmpc", "decentral:tight", "mine"):
        assert (
            look(label, "decentral", label)
            == look(label, label, "decentral")
            == (looks_of([label])[0].colour, looks_of([label])[0].dashes != "-")
        )
    assert len(set(looks_of(["nmpc", "nmpc:default"]))) == 2
    by_source = dataclasses.replace(
        weld, command_source=np.full(weld.n_ticks, "nmpc", dtype=object)
    )
    axes = page([Run("bag_1", by_source)]).axes
    assert axes[2].get_lines()[0].get_color() == CONTROLLERS["nmpc"].colour


def test_looks_differ_without_colour():
    looks = [*dict.fromkeys(CONTROLLERS.values()), *OTHERS]
    for part in ("dashes", "marker", "hatch"):
        assert len({getattr(look, part) for look in looks}) == len(looks)
    names = [f"controller {number}" for number in range(len(looks))]
    assert len(set(looks_of(names))) == len(looks)


@pytest.mark.parametrize(
    ("ending", "head"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")]
)
def test_the_name_decides_the_format_and_equal_figures_have_equal_bytes(ending, head, tmp_path):
    files = [tmp_path / f"{name}.{ending}" for name in "ab"]
    for file in files:
        with sheet(2.0, 1.0, file) as figure:
            figure.subplots().plot([0.0, 1.0])
    assert files[0].read_bytes().startswith(head)
    assert files[0].read_bytes() == files[1].read_bytes()


def test_long_times_are_in_minutes(weld):
    assert page([Run("one", weld)]).axes[-1].get_xlabel() == "time [s]"
    longer = dataclasses.replace(weld, time_s=30.0 * weld.time_s)
    axis = page([Run("one", longer)]).axes[-1]
    assert axis.get_xlabel() == "time [min]"
    assert axis.xaxis.get_major_formatter()(120.0, 0) == "2"
    assert all(tick % 60.0 == 0.0 for tick in axis.get_xticks())


def test_sizes_of_set_point_changes_stand_beside_their_marks(weld):
    stepped = 2.66 + 0.2 * (np.arange(weld.n_ticks) >= 50)
    axes = page([Run("one", dataclasses.replace(weld, reference_depth_mm=stepped))]).axes
    sizes = {text.get_text(): text.xy[0] for text in axes[0].texts}
    assert sizes["+0.2 mm"] == pytest.approx(weld.time_s[50])


def test_sizes_of_changes_that_crowd_stand_below_each_other(weld):
    ticks = np.arange(weld.n_ticks)
    stepped = 2.66 + sum(0.1 * i * (ticks >= tick) for i, tick in enumerate((50, 61, 72, 83), 1))
    figure = page([Run("one", dataclasses.replace(weld, reference_depth_mm=stepped))])
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in figure.axes[0].texts]
    assert len(boxes) == 3  # a fourth row would hide the curves
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


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
