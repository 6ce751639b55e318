"""The time line of a weld: what becomes an event, and when."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest

from fsw_analysis import events
from fsw_analysis.messages import Table
from fsw_analysis.weld_signals import FloatArray
from fsw_control.cause import AlarmChange, Cause, RequestKind, Severity
from fsw_control.reason import Reason, ReasonCode
from fsw_recorder.definitions import Definitions, interface_definition

ANNA = "anna (3f2a)"
#: time and interlocks of bags before ``Interlock.msg``
OLDER = ((0.0, ()), (1.0, ["depth_high:warn"]))


class Interlock(NamedTuple):
    name: str
    level: int


REQUESTED = SimpleNamespace(
    **Reason(ReasonCode.REQUESTED, subject="decentral").fields
)  # as a message


def table(names: Sequence[str], *rows: tuple[Any, ...]) -> tuple[FloatArray, Table]:
    """Times [s] and a table of messages, each given as its time and its fields."""
    columns = {name: np.empty(len(rows), object) for name in names}
    for index, row in enumerate(rows):
        for name, value in zip(names, row[1:], strict=True):
            columns[name][index] = value
    times = np.array([row[0] for row in rows], float)
    return times, Table([(0, 0, 0)] * len(rows), columns)


def finding(cause: int) -> Any:
    """A finding of the monitor as it is read from a bag."""
    kind, definitions = "fsw_msgs/msg/WeldFinding", Definitions()
    definition = interface_definition(kind)
    data = definitions.encode(kind, definition, {"cause": cause})
    return definitions.decode(kind, definition, data)


def told(events_found: Any) -> list[tuple[Any, ...]]:
    """Time, kind and subject, and who and what became of it where there are any."""
    events = list(events_found)
    assert all(event.text for event in events)
    return [
        (
            event.time_s,
            event.kind,
            event.subject,
            *filter(None, (event.who, event.state, event.is_over)),
        )
        for event in events
    ]


def test_phases_and_states_of_a_programme_whatever_the_order_of_its_reports() -> None:
    times, progress = table(
        ["state", "phase"],
        (0.0, "running", "dwell"),
        (2.0, "running", "start"),
        (1.0, "running", "dwell"),
        (3.0, "held", "start"),
        (5.0, "running", "start"),
        (6.0, "aborted", "start"),
    )
    assert events.phases(times, progress) == [("dwell", 0.0), ("start", 2.0)]
    assert told(events.of_progress(times, progress)) == [
        (0.0, "phase", "dwell"),
        (2.0, "phase", "start"),
        (3.0, "weld", "held"),
        (5.0, "weld", "resumed"),
        (6.0, "weld", "aborted"),
    ]


def test_state_changes_are_events_except_the_initial_state() -> None:
    warned, start = (Interlock("depth_high", Severity.WARN),), int(Cause.READY)
    times, state = table(
        [
            "actual_controller",
            "actual_mode",
            "leader",
            "interlocks",
            "why",
            "reason",
            "cause",
            "who",
        ],
        (0.0, "nmpc", "auto", "a", (), (), "", start, ""),
        (1.0, "nmpc", "auto", "a", warned, (), "", start, ""),
        (
            2.0,
            "decentral",
            "auto",
            "a",
            warned,
            (REQUESTED,),
            "",
            int(Cause.SWAP_REQUESTED),
            "anna (3f2a)",
        ),
        (
            2.5,
            "decentral",
            "auto",
            "b",
            warned,
            (REQUESTED,),
            "",
            int(Cause.SWAP_REQUESTED),
            "anna (3f2a)",
        ),
        (
            3.0,
            "",
            "safe_stop",
            "b",
            (Interlock("depth_high", Severity.TRIP),),
            (),
            "depth_high",
            int(Cause.INTERLOCK_TRIP),
            "",
        ),
        (4.0, "nmpc", "auto", "b", (), (), "", np.nan, ""),
    )
    listed = list(events.of_states(events.states(times, state)))
    assert told(listed) == [
        (1.0, "interlock", "depth_high", "warn"),
        (2.0, "swap", "decentral", ANNA),
        (2.5, "takeover", "b", ANNA),
        (3.0, "swap", ""),
        (3.0, "mode", "safe_stop"),
        (3.0, "interlock", "depth_high", "trip"),
        (3.0, "interlock", "depth_high", "warn", True),
        (4.0, "swap", "nmpc"),
        (4.0, "mode", "auto"),
        (4.0, "interlock", "depth_high", "trip", True),
    ]
    assert [event.cause for event in listed if event.kind == "swap"] == [
        Cause.SWAP_REQUESTED,
        Cause.INTERLOCK_TRIP,
        Cause.UNKNOWN,
    ]


def test_level_of_an_interlock_in_an_older_bag_is_unknown() -> None:
    """It was in a text, which nothing reads; the judgement counts it as a trip."""
    names = [*events.STATE, *events.STATE_ADDED]
    rows = ((time_s, "nmpc", "auto", locks, "a", (), "", 1.0, "") for time_s, locks in OLDER)
    changed = [
        (event.subject, event.state, event.is_over)
        for event in events.of_states(events.states(*table(names, *rows)))
    ]
    assert changed == [("depth_high:warn", "unknown", False)]


def test_a_cause_is_a_fact_whatever_its_words_say() -> None:
    """A failed controller's own words are no request: they turned a review into an acceptance."""
    times, state = table(
        [
            "actual_controller",
            "actual_mode",
            "leader",
            "interlocks",
            "why",
            "reason",
            "cause",
            "who",
        ],
        (0.0, "nmpc", "auto", "a", (), (), "", int(Cause.READY), ""),
        (
            1.0,
            "decentral",
            "auto",
            "a",
            (),
            (),
            "no feasible point (start infeasible)",
            int(Cause.SWAP_FAILED),
            "",
        ),
    )
    [swap] = events.of_states(events.states(times, state))
    assert not swap.cause.on_request and not swap.cause.at_start


def test_operator_actions_are_events() -> None:
    times, actions = table(
        [*events.ACTION, *events.ACTION_ADDED],
        (
            1.0,
            ANNA,
            "switch decentral",
            "refused",
            "decentral is not ready",
            ANNA,
            int(RequestKind.SWITCH),
            "not_ready",
        ),
        (2.0, ANNA, "safe_stop", "done", "", "", np.nan, ""),
    )
    listed = list(events.of_actions(times, actions))
    assert [event.data["request"] for event in listed] == ["switch", "unknown"], (
        "the last is of an older bag"
    )
    assert [event.data["code"] for event in listed] == ["not_ready", ""]
    assert told(listed) == [
        (1.0, "operator", "switch decentral", ANNA, "refused"),
        (2.0, "operator", "safe_stop", ANNA, "done"),
    ]


@pytest.mark.parametrize("is_old", [False, True])
def test_alarms_that_came_and_were_shelved(is_old: bool) -> None:
    def alarm_row(
        change: AlarmChange, who: str = "", reason: str = "", shelved_for_s: float = 0.0
    ) -> tuple[Any, ...]:
        kind = (np.nan, change.word) if is_old else (int(change), "")
        return ("medium", "Depth", who, reason, *kind, shelved_for_s)

    times, journal = table(
        [*events.ALARM, *events.ALARM_CHANGE],
        (1.0, *alarm_row(AlarmChange.RAISED)),
        (2.0, *alarm_row(AlarmChange.SHELVED, ANNA, "known", 300.0)),
        (3.0, *alarm_row(AlarmChange.CLEARED)),
        (4.0, *alarm_row(AlarmChange.RE_RAISED)),
        (5.0, *alarm_row(AlarmChange.ACKNOWLEDGED, ANNA)),
    )
    assert told(events.of_alarms(times, journal)) == [
        (1.0, "alarm", "Depth", "raised"),
        (2.0, "alarm", "Depth", ANNA, "shelved"),
        (4.0, "alarm", "Depth", "re-raised"),
    ]


def test_monitor_findings_begin_and_end_once() -> None:
    times, health = table(
        list(events.HEALTH),
        (1.0, []),
        (2.0, [finding(40)]),
        (3.0, [finding(40)]),
        (4.0, [finding(45)]),
    )
    changed = list(events.of_health(times, health))
    assert {(event.time_s, event.subject, event.is_over) for event in changed} == {
        (2.0, "thermocouple_drift", False),
        (4.0, "tool_wear", False),
        (4.0, "thermocouple_drift", True),
    }
    assert changed[0].text == "monitor: thermocouple drift"


def test_nothing_happens_where_nothing_was_recorded() -> None:
    journal = (events.ALARM | events.ALARM_CHANGE, events.of_alarms)
    for names, events_of in (
        (events.PROGRESS, events.of_progress),
        journal,
        (events.HEALTH, events.of_health),
    ):
        assert told(events_of(*table(list(names)))) == []
