"""Which set-points held when, whatever the order in which a recorder received them."""

from dataclasses import replace
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fsw_analysis import kpi
from fsw_analysis.signals import HELD, SENT, UNKNOWN_ORDER, SetPoint, load_weld, timeline
from fsw_recorder.bag_writer import BagWriter
from fsw_recorder.definitions import interface_definition
from fsw_test_support.sample_weld import SampleTypes, sample_messages, sample_topics

REFERENCE = "fsw_msgs/msg/WeldReference"
S = 1_000_000_000
#: a recording of 10 s from weld time 60 s on, in simulated time and on the wall clock
WALL = 1_700_000_000 * S
STAMPS = np.arange(600, 700, dtype=np.int64) * S // 10
LOGS = WALL + np.arange(100, dtype=np.int64) * S // 10


def point(
    depth_mm: float, issued_s: float, stamp_s: float = 0.0, log_s: float = 0.0, base: int = 0
) -> SetPoint:
    """Times relative to the weld's beginning, 60 s before the recording; 0 is no stamp."""
    stamp = base + round(stamp_s * S) if stamp_s else 0
    return SetPoint(
        WALL + round(log_s * S), WALL + round((issued_s - 60.0) * S), stamp, depth_mm, 816.4
    )


def depths(
    sent: list[SetPoint], held: list[SetPoint], base: int = 0
) -> tuple[list[float], list[str]]:
    """Depths in force at the first tick, and from 65 s on."""
    problems: list[str] = []
    points = timeline(sent, held, STAMPS + base, LOGS, problems)
    result = []
    for time_ns in (60 * S, 65 * S):
        begun = [set_point.depth_mm for begins, set_point in points if begins <= time_ns + base]
        result.append(begun[-1] if begun else float("nan"))
    return result, problems


@pytest.mark.parametrize("base", [0, WALL - 60 * S])
def test_late_recorder_sees_what_the_controllers_see_in_any_order_of_receipt(base: int) -> None:
    sent = point(2.6, 0.0), point(2.7, 0.1, 40.0, base=base), point(2.8, 0.2, 64.0, base=base)
    for order in permutations(sent):
        received = [set_point._replace(log_ns=WALL + i) for i, set_point in enumerate(order)]
        assert depths(received, [], base) == ([2.7, 2.8], [])


@pytest.mark.parametrize("base", [0, WALL - 60 * S])
def test_what_was_sent_by_hand_later_voids_what_was_sent_ahead(base: int) -> None:
    ahead, by_hand = (
        [point(2.7, 0.0, 40.0, base=base), point(2.8, 0.0, 64.0, base=base)],
        point(2.9, 50.0, base=base),
    )
    assert depths([*ahead, by_hand], [], base) == ([2.9, 2.9], [])
    assert depths([by_hand, *ahead], [], base) == ([2.9, 2.9], [])


def test_set_points_received_on_the_way_hold_from_the_next_tick() -> None:
    sent = [point(2.6, 0.0), point(2.9, 64.0, log_s=4.0)]
    assert depths(sent, []) == ([2.6, 2.9], [])


def test_supervisor_is_believed_for_the_beginning() -> None:
    wrong, ahead = point(2.6, 0.0), point(2.8, 0.2, 64.0)
    held = point(2.75, 0.1, 55.0)
    assert depths([wrong, ahead], [held]) == ([2.75, 2.8], [])
    assert depths([], [held, point(2.85, 64.0, 64.0, 4.0)]) == ([2.75, 2.85], [])
    newer = point(2.75, 55.0, 55.0)  # what was sent ahead before it is void
    assert depths([wrong, ahead], [newer]) == ([2.75, 2.75], [])
    late = point(2.75, 0.1, 62.0, 2.0)  # it began after the recording
    assert depths([wrong, ahead], [late]) == ([2.6, 2.8], [])


def test_unknown_order_is_reported() -> None:
    untimed = [
        set_point._replace(issued_ns=set_point.log_ns)
        for set_point in (point(2.7, 0.0, 40.0), point(2.6, 0.0, log_s=0.01))
    ]
    assert depths(untimed, []) == ([2.6, 2.6], [UNKNOWN_ORDER])
    assert depths(untimed, [point(2.7, 40.0, 40.0)]) == ([2.7, 2.7], [])
    alone = [set_point._replace(issued_ns=set_point.log_ns) for set_point in (point(2.6, 0.0),)]
    assert depths(alone, []) == ([2.6, 2.6], [])


def bag_from_mid_weld(
    bag: Path, order: tuple[int, ...], topics: tuple[str, ...] = (SENT,)
) -> Path:
    """The last 2 s of a weld whose set-points were all sent before the recording began."""
    definition = interface_definition(REFERENCE)
    types = SampleTypes({REFERENCE: definition})
    latched = [
        (0, 2.6e-3, 0.0),
        (1, 2.66e-3, 10.0),
        (2, 2.67e-3, 20.0),
    ]  # sent then, depth, stamp after the start
    with BagWriter(bag) as writer:
        for topic in sample_topics():
            if topic.name == SENT:
                topic = replace(topic, definition=definition)
                writer.add_topic(replace(topic, name=HELD))
            writer.add_topic(topic)
        begin_ns = 0
        for name, time_ns, data in sample_messages(320):
            begin_ns = begin_ns or time_ns - time_ns % S
            if name == SENT or time_ns < begin_ns + 30 * S:
                continue
            if latched:
                rows = [latched[i] for i in order]
                latched.clear()
                for topic_name in topics:
                    for sent_s, depth, stamp_s in (
                        rows if topic_name == SENT else [rows[order.index(2)]]
                    ):
                        stamp = (
                            {"sec": begin_ns // S + round(stamp_s), "nanosec": 0}
                            if stamp_s
                            else {}
                        )
                        header: dict[str, Any] = {"stamp": stamp}
                        values: dict[str, Any] = {
                            "header": header,
                            "depth": depth,
                            "temperature": 816.0,
                        }
                        if topic_name == HELD:
                            values["issued"] = {"sec": begin_ns // S + sent_s, "nanosec": 0}
                        payload = types.serialize(REFERENCE, values)
                        writer.write(topic_name, payload, time_ns - 1000, begin_ns + sent_s * S)
            writer.write(name, data, time_ns, time_ns)
    return bag


@pytest.mark.parametrize("topics", [(SENT,), (HELD,), (SENT, HELD)])
def test_figures_of_merit_of_a_bag_from_mid_weld(tmp_path: Path, topics: tuple[str, ...]) -> None:
    for i, order in enumerate([(0, 1, 2), (2, 1, 0)]):
        signals = load_weld(bag_from_mid_weld(tmp_path / f"bag{i}", order, topics))
        assert set(signals.reference_depth_mm) == {2.67} and signals.problems == []
        error = float(np.abs(signals.truth.depth_mm - 2.67).mean()) if signals.truth else 0.0
        assert kpi.compute(signals)["iae_depth_mm_s"] == pytest.approx(error * 2.0, rel=1e-6)
