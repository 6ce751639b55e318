"""A weld beside earlier ones, and who had control."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from fsw_analysis.procedure import Procedure
from fsw_analysis.weld_signals import WeldEvent
from fsw_control.schema.models import InputError
from fsw_quality.comparison import MOST, accepted_before, compare
from fsw_quality.record import assemble, estimated, times_of_control, told_by_watch
from fsw_quality.record_content import BagFile, Record
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.bag_writer import BagWriter, RecordedTopic
from fsw_recorder.definitions import Definitions, interface_definition, interface_hash
from fsw_test_support.judged_weld import good_weld, short_procedure
from fsw_test_support.sample_weld import SampleTypes


def record(
    number: int, offset_mm: float = 0.0, procedure: Procedure | None = None, sha: str = ""
) -> Record:
    """Record of a weld that is off its depth by some 0.001 mm."""
    weld = good_weld()
    weld = replace(weld, path=Path(f"weld_{number}"), depth_mm=weld.depth_mm + offset_mm)
    file = BagFile(name="weld.mcap", bytes=1, sha256=sha or f"{number:064x}")
    content, _ = assemble(
        replace(weld, custom={"lost_messages": "0"}), procedure or short_procedure(), (file,)
    )
    return content


def keep(folder: Path, *records: Record) -> None:
    for record in records:
        (folder / record.bag).mkdir(parents=True)
        (folder / record.bag / "record.json").write_text(
            record.model_dump_json(exclude_none=True), encoding="utf-8"
        )


def test_accepted_welds_of_the_procedure_are_taken_and_the_latest_only(tmp_path: Path) -> None:
    rejected = record(90, 2.0)
    assert rejected.verdict == "reject"
    others = [record(number, 0.001 * number) for number in range(MOST + 2)]
    foreign = record(91, procedure=short_procedure(revision="other"))
    keep(tmp_path, *others, rejected, foreign, record(99))
    accepted = accepted_before(tmp_path, record(99), pytest.fail)
    assert len(accepted) == MOST and {weld.bag for weld in accepted} <= {
        weld.bag for weld in others
    }


def test_what_is_far_from_the_others_is_named(tmp_path: Path) -> None:
    others = [record(number, 0.001 * number) for number in range(5)]
    figures = {
        (figure.phase, figure.name): figure for figure in compare(record(9, 0.05), others).figures
    }
    far = figures["joint_line", "depth error [mm], mean"]
    assert (far.mean, far.low, far.high) == pytest.approx((0.002, 0.0, 0.004))
    assert far.is_far and far.deviations == pytest.approx(0.048 / 0.00158114, rel=1e-3)
    assert not figures["joint_line", "force [kN], mean"].is_far  # equal in all
    assert not compare(record(9, 0.0025), others).far
    assert all(
        figure.deviations is None for figure in compare(record(9, 0.05), others[:2]).figures
    )
    assert compare(record(9), []).figures == ()


def test_a_record_of_an_earlier_version_is_left_out_and_named(tmp_path: Path) -> None:
    keep(tmp_path, record(1), record(2))
    path, notes = tmp_path / "weld_1" / "record.json", list[str]()
    path.write_text('{"format": "fsw_weld_record", "version": 3, "rules": "other words"}')
    assert [weld.bag for weld in accepted_before(tmp_path, record(9), notes.append)] == ["weld_2"]
    [note] = notes
    assert str(path) in note


def test_two_records_of_one_weld_are_told(tmp_path: Path) -> None:
    keep(tmp_path, record(1, sha="a" * 64), record(2, sha="a" * 64))
    with pytest.raises(InputError, match=r"weld_2/record\.json: .*weld_1/record\.json"):
        accepted_before(tmp_path, record(9), pytest.fail)


def test_what_is_no_record_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=str(tmp_path)):
        accepted_before(tmp_path, record(9), pytest.fail)
    (tmp_path / "record.json").write_text("{}")
    with pytest.raises(InputError, match=r"record\.json: lacks verdict"):
        accepted_before(tmp_path, record(9), pytest.fail)


@pytest.mark.parametrize(
    ("holders", "expected"),
    [
        ([], []),
        ([(1.0, "anna (1)"), (4.0, "")], [("anna (1)", 1.0, 4.0)]),
        ([(1.0, "anna (1)"), (2.0, "anna (1)")], [("anna (1)", 1.0, 9.0)]),
        ([(1.0, "anna (1)"), (3.0, "bo (2)")], [("anna (1)", 1.0, 3.0), ("bo (2)", 3.0, 9.0)]),
        ([(1.0, ""), (2.0, "")], []),
    ],
)
def test_times_of_control(
    holders: list[tuple[float, str]], expected: list[tuple[str, float, float]]
) -> None:
    """Who has control after each request is told with it, whatever was asked for and with which outcome."""
    events = [
        WeldEvent(time_s, "operator", "hold", "refused", data={"holder": holder})
        for time_s, holder in holders
    ]
    assert [
        (span.who, span.begin_s, span.end_s) for span in times_of_control(events, 9.0)
    ] == expected


@pytest.mark.parametrize(
    ("home", "neighbour"), [("", "/cell2"), ("/cell1", "/cell2"), ("/cell1", "/hall/cell1")]
)
def test_what_the_watch_tells_is_on_record_once_each(
    tmp_path: Path, home: str, neighbour: str
) -> None:
    """Diagnostics come every second; what changes is an event, at the weld's time.

    Another weld's do not count.
    """
    identity = {"procedure": "p", "revision": "B", "SHA-256": "ab" * 32}
    facts = {"code": "mode", "mode": "manual", "who": "a key that an event has, too"}
    types, kind = SampleTypes(), "diagnostic_msgs/msg/DiagnosticArray"
    weld = replace(good_weld(), namespace=home)
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic(
            RecordedTopic("/diagnostics", kind, interface_definition(kind), interface_hash(kind))
        )
        for tick, text in enumerate(
            ["no deviation", "no deviation", "mode manual", "mode manual", "no deviation"]
        ):
            stamp_ns = int(weld.stamp_ns[0]) + tick * 10**9
            stamp = {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}
            for cell, shown in ((neighbour, f"of the other weld: {tick}"), (home, text)):
                name = f"{cell}/fsw_procedure: deviations".removeprefix("/")
                status = {"name": name, "message": shown, "level": 2 * (shown != "no deviation")}
                if cell == home and tick > 1:
                    given = identity | (facts if status["level"] else {})
                    status["values"] = [
                        {"key": key, "value": value} for key, value in given.items()
                    ]
                values = {
                    "header": {"stamp": stamp},
                    "status": [{"name": "other", "message": "x"}, status],
                }
                writer.write("/diagnostics", types.serialize(kind, values), stamp_ns, stamp_ns)
    with BagReader(tmp_path / "bag") as reader:
        events = told_by_watch(reader, weld)
    assert [(round(event.time_s, 6), event.kind, event.text) for event in events] == [
        (2.1, "procedure", f"p revision B, SHA-256 {'ab' * 32}"),
        (2.1, "deviation", "mode manual"),
        (4.1, "deviation", "no deviation"),
    ]
    assert [event.data for event in events[1:]] == [facts, {}]


@pytest.mark.parametrize("home", ["", "/cell1"])
def test_last_estimates_of_the_monitor_are_on_record(tmp_path: Path, home: str) -> None:
    """Each as an event with its numbers in a unit that is named; of what was not judged, why.

    An older monitor has none.
    """
    kind, definitions = "fsw_msgs/msg/WeldHealth", Definitions()
    weld, definition = replace(good_weld(), namespace=home), interface_definition(kind)
    wear = {"cause": 45, "size": 0.01, "error": 0.002, "alarm_size": math.inf}
    unknown = {"cause": 48, "reason": 2, "size": math.nan, "error": math.nan}
    sent = [[], [{**wear, "size": 0.5}], [wear, unknown]]
    with BagWriter(tmp_path / "bag") as writer:
        for cell in (home, "/cell2"):
            topic = f"{cell}/fsw/monitor/health"
            writer.add_topic(RecordedTopic(topic, kind, definition, interface_hash(kind)))
            for tick, estimates in enumerate(sent if cell == home else sent[1:2]):
                stamp_ns = int(weld.stamp_ns[0]) + tick * 10**9
                stamp = {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}
                values = {"header": {"stamp": stamp}, "estimates": estimates}
                data = definitions.encode(kind, definition, values)
                writer.write(topic, data, stamp_ns, stamp_ns)
    with BagReader(tmp_path / "bag") as reader:
        events = estimated(reader, weld)
        assert estimated(reader, replace(weld, namespace="/cell3")) == []
    of_wear = {"size": "0.6", "standard_error": "0.12", "unit": "N·m/min"}
    assert [
        (round(event.time_s, 6), event.kind, event.subject, event.data) for event in events
    ] == [
        (2.1, "estimate", "tool_wear", of_wear),
        (2.1, "estimate", "heat_gain", {"not_judged": "heat_unknown"}),
    ]
    assert "+0.6 ± 0.2 N·m/min" in events[0].text
