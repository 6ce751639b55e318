"""What the page gets of a recorded weld."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from fsw_analysis.signals import load_weld
from fsw_hmi.bag_view import load, view
from fsw_hmi.frames import COLUMNS
from fsw_recorder.bag_metadata import METADATA_NAME
from fsw_recorder.bag_writer import BagWriter
from fsw_recorder.errors import BagError
from fsw_recorder.manifest import MANIFEST_NAME, UNKNOWN, Manifest, hashed, mapped, unlisted
from fsw_test_support.programme_bag import write_programme_weld
from fsw_test_support.sample_weld import TOPICS, SampleTypes, sample_topics, write_sample_weld

pytest.importorskip(
    "starlette", reason="starlette is not installed: pip install -r requirements/hmi.lock"
)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bag of a weld of 30 s.

    Phases from 0 and 10 s, a hold, an operator's action, and a swap after 15 s.
    """
    folder = tmp_path_factory.mktemp("weld") / "bag"
    write_programme_weld(folder)
    return folder


def test_rows_are_those_of_the_live_page_with_mode_and_controller(bag: Path) -> None:
    [shown] = load([bag])
    assert shown.columns == (*COLUMNS, "mode", "controller", "phase", "flags")
    assert len(shown.rows) == 300
    assert {len(row) for row in shown.rows} == {len(shown.columns)}
    first, last = (
        dict(zip(shown.columns, row, strict=True)) for row in (shown.rows[0], shown.rows[-1])
    )
    assert (first["time_s"], first["mode"], first["controller"]) == (0.1, "auto", "decentral")
    assert (first["phase"], last["phase"]) == ("dwell", "start")
    assert (last["time_s"], last["controller"]) == (30.0, "nmpc")
    assert first["depth_mm"] == pytest.approx(2.66)
    assert first["force_kn"] == pytest.approx(78.4)
    assert first["power_kw"] == pytest.approx(1052.9 * 42.78e-3, rel=1e-3)
    assert first["latency_ms"] == pytest.approx(9.1)
    assert first["solve_ms"] == pytest.approx(4.0)
    assert [
        row[shown.columns.index("angle_deg")]
        for row in (shown.rows[0], shown.rows[150], shown.rows[-1])
    ] == [
        0.0,
        10.0,
        21.0,
    ]


def test_summary_has_events(bag: Path) -> None:
    summary = load([bag])[0].summary
    assert summary["name"] == bag.parent.name
    assert summary["duration_s"] == 30.0
    assert summary["controllers"] == ["decentral", "nmpc"]
    assert [(event["time_s"], event["kind"]) for event in summary["events"]] == [
        (0.1, "phase"),  # the first tick is at 0.1 s
        (10.1, "phase"),
        (15.1, "swap"),
        (20.1, "weld"),
        (21.1, "weld"),
        (25.1, "operator"),
    ]
    assert (
        summary["events"][-1]["text"] == "anna (3f2a): weld resume: done: running in phase start"
    )
    json.dumps([summary, load([bag])[0].limits], allow_nan=False)


def test_limits_are_those_that_the_supervisor_was_recorded_with(bag: Path) -> None:
    [shown] = load([bag])
    assert shown.limits["depth_mm"]["warn"] == [1.7, 3.4]
    assert shown.summary["problems"] == []


def test_without_the_supervisors_parameters_no_interlock_is_drawn(tmp_path: Path) -> None:
    write_sample_weld(tmp_path / "weld", 20)
    [shown] = load([tmp_path / "weld"])
    assert "warn" not in shown.limits["depth_mm"]
    assert any("interlocks" in problem for problem in shown.summary["problems"])
    assert {row[shown.columns.index("phase")] for row in shown.rows} == {""}


def test_weld_of_one_tick_is_shown(tmp_path: Path) -> None:
    write_sample_weld(tmp_path / "weld", 1)
    assert len(load([tmp_path / "weld"])[0].rows) == 1


def test_two_bags_have_names_that_tell_them_apart(bag: Path, tmp_path: Path) -> None:
    write_sample_weld(tmp_path / "other", 20)
    assert [weld.summary["name"] for weld in load([bag, tmp_path / "other"])] == [
        bag.parent.name,
        "other",
    ]


@pytest.mark.parametrize("count", [0, 3])
def test_one_or_two_bags(bag: Path, count: int) -> None:
    with pytest.raises(BagError, match=f"^{count} bags: the page shows one, or compares 2$"):
        load([bag] * count)


def test_a_damaged_bag_is_shown_as_far_as_it_can_be_read(tmp_path: Path) -> None:
    write_sample_weld(tmp_path / "weld", 100, in_chunk=200)
    [file] = (tmp_path / "weld").glob("*.mcap")
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    [shown] = load([tmp_path / "weld"])
    assert 10 < len(shown.rows) < 100
    assert any("not finished" in problem for problem in shown.summary["problems"])


def test_a_bag_that_is_not_as_its_manifest_has_it_is_not_intact(tmp_path: Path) -> None:
    folder = tmp_path / "weld"
    write_sample_weld(folder, 100)
    listed = Manifest(bag="weld", custom_data={}, attachments_sha256={}, clock=UNKNOWN, files=())
    files = [hashed(path.name, mapped(path), "afterwards") for path in unlisted(folder, listed)]
    listed = listed.changed(files=(*listed.files, *files))
    (folder / MANIFEST_NAME).write_text(listed.text(), encoding="utf-8")
    [shown] = load([folder])
    metadata = folder / METADATA_NAME
    metadata.write_bytes(metadata.read_bytes() + b"\n# later\n")
    [changed] = load([folder])
    new = [
        problem
        for problem in changed.summary["problems"]
        if problem not in shown.summary["problems"]
    ]
    assert len(new) == 1 and METADATA_NAME in new[0]


def test_no_bag_and_no_weld_are_one_line(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "other") as writer:
        writer.add_topic(next(topic for topic in sample_topics() if topic.name == "/diagnostics"))
        writer.write("/diagnostics", SampleTypes().serialize(TOPICS["/diagnostics"], {}), 1, 1)
    for path, complaint in (
        (tmp_path / "none", "there is no such bag"),
        (tmp_path / "other", "not the bag of a weld"),
    ):
        with pytest.raises(BagError, match=complaint) as error:
            load([path])
        assert "\n" not in str(error.value)


def test_simulated_time_has_no_date(bag: Path) -> None:
    signals = load_weld(bag)
    assert view(signals, "weld").summary["start_s"] == 1_700_000_000.0
    signals.stamp_ns = signals.stamp_ns - signals.stamp_ns[0] + 100_000_000
    assert view(signals, "weld").summary["start_s"] is None
