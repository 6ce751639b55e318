"""What the page says of the recording: state, file, size and gaps."""

from math import nan

import pytest

from fsw_hmi.recording import Recording, RecordingState
from fsw_recorder.recording import Note


@pytest.fixture
def values(tmp_path):
    return {"bag": str(tmp_path), "bytes": "1000", "pending_bytes": "24", "lost": "0"}


def test_without_a_recorder_nothing_is_on_record():
    recording = Recording()
    recording.look("", "", {}, 1.0)
    assert recording.frame()["state"] is RecordingState.NONE


@pytest.mark.parametrize(
    ("level", "code", "state"),
    [
        ("ok", Note.RECORDING, RecordingState.RECORDING),
        ("ok", Note.PAUSED, RecordingState.PAUSED),
        ("warn", Note.INCOMPLETE, RecordingState.INCOMPLETE),
        ("warn", Note.AWAITED, RecordingState.PAUSED),
        ("error", Note.FAILED, RecordingState.FAILED),
    ],
)
def test_state_file_and_size_are_the_recorders(values, level, code, state):
    recording = Recording()
    recording.look(level, code, values, 1.0)
    shown = recording.frame()
    assert shown == {
        **{"state": state, "bag": values["bag"], "bytes": 1024, "missing": 0, "gap": None},
    }


def test_silent_recorder_leaves_a_gap_until_it_reports_again(values):
    recording = Recording()
    for level, weld_s in (("ok", 10.0), ("stale", 14.0), ("stale", 15.0)):
        recording.look(level, "", values, weld_s)
    assert recording.state is RecordingState.SILENT
    assert recording.gaps == [(10.0, 15.0)]
    recording.look("ok", "", values, 16.0)
    recording.look("ok", "", values, 17.0)
    assert (recording.state, recording.gaps) == (RecordingState.INCOMPLETE, [(10.0, 16.0)])


def test_pause_is_a_gap_but_waiting_for_the_first_topics_is_none(values):
    recording = Recording()
    for code, weld_s in (
        (Note.AWAITED, nan),
        (Note.AWAITED, 1.0),
        (Note.RECORDING, 2.0),
        (Note.PAUSED, 3.0),
        (Note.PAUSED, 4.0),
        (Note.RECORDING, 5.0),
        (Note.RECORDING, 6.0),
    ):
        recording.look("ok", code, values, weld_s)
    assert recording.gaps == [(2.0, 5.0)]


def test_recorder_that_is_silent_from_before_the_first_tick_leaves_a_gap_from_it_on(values):
    recording = Recording()
    for level, weld_s in (("ok", nan), ("stale", nan), ("stale", 1.7e9), ("ok", 1.7e9 + 2.0)):
        recording.look(level, "", values, weld_s)
    assert recording.gaps == [(1.7e9, 1.7e9 + 2.0)]


def test_lost_messages_are_one_gap_while_more_are_lost(values):
    recording = Recording()
    for lost, weld_s in ((0, 1.0), (2, 2.0), (3, 3.0), (3, 4.0), (4, 5.0)):
        recording.look("warn", "", values | {"lost": str(lost)}, weld_s)
    assert recording.gaps == [(1.0, 3.0), (4.0, 5.0)]


def test_bag_with_its_metadata_is_complete(values, tmp_path):
    recording = Recording()
    recording.look("ok", "", values, 1.0)
    (tmp_path / "metadata.yaml").touch()
    recording.look("stale", "", values, 5.0)
    assert (recording.state, recording.gaps) == (RecordingState.CLOSED, [])


def test_recorder_that_takes_long_to_close_its_bag_has_left_no_gap(values, tmp_path):
    recording = Recording()
    for level, weld_s in (("ok", 1.0), ("stale", 1.5)):
        recording.look(level, "", values, weld_s)
    assert (recording.state, recording.gaps) == (RecordingState.SILENT, [(1.0, 1.5)])
    (tmp_path / "metadata.yaml").touch()
    recording.look("stale", "", values, 1.5)
    assert (recording.state, recording.gaps) == (RecordingState.CLOSED, [])


@pytest.mark.parametrize("reports", [["warn"], ["ok", "stale", "ok"]], ids=" ".join)
def test_bag_that_is_closed_after_gaps_is_not_complete(values, tmp_path, reports):
    recording = Recording()
    for weld_s, level in enumerate(reports, 1):
        recording.look(level, "", values, float(weld_s))
    (tmp_path / "metadata.yaml").touch()
    for weld_s in (8.0, 9.0):
        recording.look("stale", "", values, weld_s)
    assert recording.state is RecordingState.CLOSED_WITH_GAPS


@pytest.mark.parametrize(
    "reports",
    [
        [("error", Note.FAILED)],
        [("error", Note.FAILED), ("stale", Note.FAILED)],
        [("warn", Note.AWAITED)],
        [("ok", Note.RECORDING), *[("stale", Note.RECORDING)] * 20],
    ],
    ids=["failed", "failed and silent", "nothing was there", "silent for long"],
)
def test_bag_of_a_recorder_that_recorded_nothing_for_a_while_is_closed_with_gaps(
    values, tmp_path, reports
):
    recording = Recording()
    for weld_s, (level, code) in enumerate(reports, 1):
        recording.look(level, code, values, float(weld_s))
    (tmp_path / "metadata.yaml").touch()
    for weld_s in (30.0, 31.0):
        recording.look("stale", reports[-1][1], values, weld_s)
        assert recording.state is RecordingState.CLOSED_WITH_GAPS


def test_recorder_after_one_that_failed_leaves_a_gap_between_them(values):
    recording = Recording()
    for level, code, weld_s in (
        ("ok", Note.RECORDING, 1.0),
        ("error", Note.FAILED, 2.0),
        ("error", Note.FAILED, 3.0),
        ("ok", Note.RECORDING, 4.0),
    ):
        recording.look(level, code, values, weld_s)
    assert recording.gaps == [(1.0, 4.0)]
    recording.look("ok", Note.RECORDING, values | {"bag": "another"}, 5.0)
    assert recording.state is RecordingState.INCOMPLETE


@pytest.mark.parametrize(
    "odd",
    [
        {},
        {"bag": "\0", "bytes": "many", "lost": "-1"},
        {"bag": "x" * 5000},
    ],
)
def test_odd_reports_of_others_leave_the_page_alive(odd):
    recording = Recording()
    for level, weld_s in (("ok", 1.0), ("stale", 2.0)):
        recording.look(level, "", odd, weld_s)
    assert recording.frame()["bytes"] == 0
    assert recording.state is RecordingState.SILENT


def test_bag_that_may_not_be_read_is_not_known_to_be_complete(values, monkeypatch):
    def refuse(*_, **__):
        raise PermissionError

    monkeypatch.setattr("pathlib.Path.is_file", refuse)  # the tests may run as root
    recording = Recording()
    for level, weld_s in (("ok", 1.0), ("stale", 2.0)):
        recording.look(level, "", values, weld_s)
    assert recording.state is RecordingState.SILENT
