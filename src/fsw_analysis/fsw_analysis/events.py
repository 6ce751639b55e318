"""Events of a weld for the time line: phases, swaps, modes, interlocks and operators' actions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from fsw_analysis.messages import Kind, Table
from fsw_analysis.weld_signals import FloatArray, WeldEvent
from fsw_control.cause import AlarmChange, Cause, RequestKind, Severity
from fsw_control.reason import Reason

STATE: dict[str, Kind] = {
    "actual_controller": "text",
    "actual_mode": "text",
    "interlocks": "texts",  # as messages; in older bags texts, whose level is not on record
}
#: missing in older bags: causes, the requesting operator, and whether another
#: supervisor took over; and words, which they have instead
STATE_ADDED: dict[str, Kind] = {
    "leader": "text",
    "why": "texts",
    "reason": "text",
    "cause": "number",
    "who": "text",
}
PROGRESS: dict[str, Kind] = {
    "state": "text",
    "phase": "text",
    "depth": "number",
    "temperature": "number",
    "angle": "number",
    "length": "number",
}
ACTION: dict[str, Kind] = {
    "who": "text",
    "action": "text",
    "outcome": "text",
    "message": "text",
}
#: missing in older bags: the holder of control, and the code of the answer
ACTION_ADDED: dict[str, Kind] = {"holder": "text", "kind": "number", "code": "text"}
ALARM: dict[str, Kind] = {
    "priority": "text",
    "text": "text",
    "who": "text",
    "reason": "text",
}
HEALTH: dict[str, Kind] = {"findings": "texts"}  # as messages
#: what became of the alarm, in older bags by its name, and for how long it was shelved
ALARM_CHANGE: dict[str, Kind] = {"kind": "number", "event": "text", "shelved_for": "number"}
#: changes of the alarm journal that are shown; the others follow from them
_SHOWN = (AlarmChange.RAISED, AlarmChange.RE_RAISED, AlarmChange.WORSENED, AlarmChange.SHELVED)
_CHANGES = {change.word: change for change in AlarmChange}
#: by former and present state of the programme
_STATES = {("held", "running"): "resumed"}


def phases(times_s: FloatArray, progress: Table) -> list[tuple[str, float]]:
    """Name and begin of each phase, from the programme's reports."""
    started: list[tuple[str, float]] = []
    for time_s, name in _in_order(times_s, progress, "phase"):
        if name and (not started or started[-1][0] != name):
            started.append((name, time_s))
    return started


def of_progress(times_s: FloatArray, progress: Table) -> Iterator[WeldEvent]:
    """Phases that begin, and the programme held, resumed, aborted and done."""
    for name, time_s in phases(times_s, progress):
        yield WeldEvent(time_s, "phase", name)
    yield from of_programme_states(_in_order(times_s, progress, "state"))


def of_programme_states(states: Iterable[tuple[float, str]]) -> Iterator[WeldEvent]:
    """The programme held, resumed, aborted and done, from times and states of its reports."""
    for (_, before), (time_s, state) in pairwise(states):
        if state != before:
            yield WeldEvent(time_s, "weld", _STATES.get((before, state), state))


def states(times_s: FloatArray, state: Table) -> Iterator[tuple[float, Any]]:
    """The supervisor's reports as :func:`of_states` takes them."""
    for time_s, (name, mode, locks, leader, why, words, cause, who) in _in_order(
        times_s, state, *STATE, *STATE_ADDED
    ):
        reason = Reason.of_messages(why).words or words
        yield time_s, (name, mode, leader, map(_interlock, locks), reason, cause, who)


def of_states(states: Iterable[tuple[float, Any]]) -> Iterator[WeldEvent]:
    """Controllers, modes and leaders that take over, interlocks that trip and clear.

    ``states`` are times and, of each of the supervisor's reports, controller, mode, leader,
    interlocks with their levels, reason, cause and requesting operator.
    """
    before: tuple[str, str, str] | None = None
    present: frozenset[tuple[str, str]] = frozenset()
    for time_s, (controller, mode, leader, interlocks, reason, cause, who) in states:
        active = frozenset(interlocks)
        now, why = (controller, mode, leader), Cause(-1 if np.isnan(cause) else int(cause))
        for kind, old, new in zip(("swap", "mode", "takeover"), before or now, now, strict=True):
            if new != old:
                yield WeldEvent(time_s, kind, new, cause=why, who=who, detail=reason)
        for name, level in [*sorted(active - present), *sorted(present - active)]:
            is_over = (name, level) in present
            yield WeldEvent(time_s, "interlock", name, level, is_over=is_over)
        before, present = now, active


def _interlock(recorded: Any) -> tuple[str, str]:
    """Name and level of an interlock on record; older bags have a text without the level."""
    if isinstance(recorded, str):
        return recorded, Severity.UNKNOWN.word
    return recorded.name, Severity(recorded.level).word


def of_actions(times_s: FloatArray, actions: Table) -> Iterator[WeldEvent]:
    """Requests made on the operator's page, and their outcome."""
    for time_s, (who, action, outcome, message, holder, kind, code) in _in_order(
        times_s, actions, *ACTION, *ACTION_ADDED
    ):
        request = RequestKind(0 if np.isnan(kind) else int(kind))
        data = {"holder": holder, "request": request.word, "code": code}
        yield WeldEvent(time_s, "operator", action, outcome, who=who, detail=message, data=data)


def of_alarms(times_s: FloatArray, journal: Table) -> Iterator[WeldEvent]:
    """Alarms that were raised, raised again, got worse or were shelved, from the alarm journal."""
    fields = (*ALARM, *ALARM_CHANGE)
    for time_s, (priority, text, who, reason, kind, name, shelved_for_s) in _in_order(
        times_s, journal, *fields
    ):
        change = (
            _CHANGES.get(name, AlarmChange.UNKNOWN) if np.isnan(kind) else AlarmChange(int(kind))
        )
        if change in _SHOWN:
            why = f"{shelved_for_s / 60.0:.3g} min: {reason}" if shelved_for_s > 0.0 else reason
            yield WeldEvent(
                time_s,
                "alarm",
                text,
                change.word,
                who=who,
                detail=why,
                data={"priority": priority},
            )


def of_health(times_s: FloatArray, health: Table) -> Iterator[WeldEvent]:
    """Findings of the monitor at their begin and end, by the name of the cause."""
    present: set[str] = set()
    for time_s, findings in _in_order(times_s, health, *HEALTH):
        now = {_cause(finding) for finding in findings}
        for cause in sorted(now ^ present):
            words = cause.replace("_", " ")
            yield WeldEvent(time_s, "finding", cause, is_over=cause in present, detail=words)
        present = now


def _cause(finding: Any) -> str:
    """Name of a recorded finding's cause, which its message type has as a constant."""
    constants = vars(type(finding)).items()
    names = (name for name, value in constants if name.isupper() and value == finding.cause)
    return next(names, "UNKNOWN").lower()


def _in_order(times_s: FloatArray, table: Table, *paths: str) -> list[tuple[float, Any]]:
    """Time and fields of each message, by time; of one field the value itself."""
    order = np.argsort(times_s, kind="stable")
    columns = [table.column(path)[order].tolist() for path in paths]
    values = columns[0] if len(columns) == 1 else zip(*columns, strict=True)
    return list(zip(times_s[order].tolist(), values, strict=True))
