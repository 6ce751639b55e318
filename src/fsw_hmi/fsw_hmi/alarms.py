"""Alarms after ISA-18.2: state, acknowledgement, shelving, first-out marks; texts by kind.

The texts are in ``alarms.yaml``: one cause, one consequence, one action each.

All times are of a steady clock (``now_s``); only for people they become those of the wall clock.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Any, Literal

from pydantic import BaseModel

from fsw_control.cause import AlarmChange, Cause
from fsw_control.schema.yaml_text import load_yaml
from fsw_hmi.answers import Answer, Code
from fsw_hmi.limits import Flag

Priority = Literal["high", "medium", "low"]
RANK = {"high": 0, "medium": 1, "low": 2}
#: chosen, after the usual definition of a flood: more new ones of a group in this time are one
#: alarm
_FLOOD, _FLOOD_S = 10, 10.0
FLOOD_ID = "flood:"
STOP_ID = "safe_stop"
#: alarms that led to a trip came at most so long before it, and went at most so long before it
#: (chosen)
_LED_S, _JUST_GONE_S = 60.0, 10.0
#: entries at most; one of high priority is always listed, alone or in a flood
_MOST = 300


#: states in the order of the list, and what the page gets of an alarm and of its entry
_PLACE = ("active", "acknowledged", "cleared", "shelved")
_OF_ALARM = ("text", "what", "why", "cause", "consequence", "advice", "action", "priority")
_OF_ENTRY = ("state", "count", "first", "shelved")


@dataclass(frozen=True, slots=True)
class Alarm:
    """One cause, one consequence, one action."""

    what: str  #: is wrong
    consequence: str
    advice: str
    priority: Priority  #: one of high priority cannot be shelved
    trip: bool = False  #: it stops the weld, so that what came first before it is marked
    on_s: float = 0.0  #: how long the cause must last before that counts
    off_s: float = 1.0  #: and how long be gone
    why: str = ""  #: where more than one cause is possible
    cause: str = ""  #: code of this one; figures in ``why`` that change are no other cause
    action: str = ""  #: code of the advice

    @property
    def text(self) -> str:
        """Cause and reason."""
        return f"{self.what}: {self.why}" if self.why else self.what


@dataclass(slots=True)
class Entry:
    """An alarm in the list."""

    alarm: Alarm
    first_s: float  #: when it was raised for the first time
    raised_s: float  #: and for the last
    number: int  #: in the order of raising
    count: int = 1
    present: bool = True
    acknowledged: bool = False
    absent_s: float | None = None  #: since when the cause is gone
    shelved_until_s: float | None = None
    shelved: str = ""  #: by whom, until when and why
    first: str = ""  #: of a trip: what came first
    led_to: str = ""  #: the trip that this one came first of
    news: int = 0  #: number of what is to be seen again, after it was raised

    @property
    def newest(self) -> int:
        """Number of the last thing that a person should have seen of it."""
        return max(self.number, self.news)

    @property
    def state(self) -> str:
        """``active``, ``acknowledged``, ``cleared`` (not acknowledged) or ``shelved``."""
        if self.shelved_until_s is not None:
            return "shelved"
        if not self.present:
            return "cleared"
        return "acknowledged" if self.acknowledged else "active"

    def show_again(self, number: int) -> None:
        """Who has seen the list before has not seen this; its place among the first stays."""
        self.acknowledged, self.news = False, number

    def show_if_high(self) -> None:
        """Unshelve alarms that have become high."""
        if self.alarm.priority == "high":
            self.shelved_until_s, self.shelved = None, ""


def _group(name: str, alarm: Alarm) -> str:
    """Group of an alarm in a flood: low ones are one group, others never hide another kind."""
    return "low" if alarm.priority == "low" else f"{alarm.priority}:{name.partition(':')[0]}"


class AlarmList:
    """List of alarms: each stays until it is gone and acknowledged.

    One that comes back before it was acknowledged has a new time and a count. Of each trip the
    alarm that came first is marked until the trip is acknowledged: most that follow are
    consequences. ``flood`` makes the alarm that stands for so many of a group that come at once; a
    trip is always listed. ``journal`` gets each change: the alarm's name, what changed, its entry,
    and, for operator actions, who, why and for how long [s].
    """

    def __init__(
        self,
        flood: Callable[[int, Priority], Alarm],
        journal: Callable[..., object] = lambda *_: None,
    ) -> None:
        self._flood, self._journal = flood, journal
        self.entries: dict[str, Entry] = {}
        self._coming_s: dict[str, float] = {}
        self._new_s: dict[str, deque[float]] = {}
        self.grouped: dict[str, str] = {}  #: present, but only counted in a flood
        self._number = 0

    # ---------------------------------------------------------------- what is present

    def update(self, present: Mapping[str, Alarm], now_s: float) -> bool:
        """Take the alarms that are present by name; returns whether the list has changed."""
        changed = self._unshelve_expired(now_s)
        self._coming_s = {name: self._coming_s.get(name, now_s) for name in present}
        listed = self._without_flood(present, now_s)
        # what led to a trip before it
        for name, alarm in sorted(listed.items(), key=lambda item: item[1].trip):
            changed = self._take(name, alarm, now_s) or changed
        for name, entry in [*self.entries.items()]:
            if name not in listed and entry.present:
                changed = self._leave(name, entry, now_s) or changed
        return changed

    def _without_flood(self, present: Mapping[str, Alarm], now_s: float) -> dict[str, Alarm]:
        """Alarms to be listed, with a flood as one alarm."""
        listed: dict[str, Alarm] = {}
        grouped: dict[str, str] = {}
        room = _MOST - len(self.entries)
        for name, alarm in present.items():
            entry = self.entries.get(name)
            known = entry is not None and entry.present
            if not known and now_s - self._coming_s[name] < alarm.on_s:
                continue
            if not known and not alarm.trip:
                group = _group(name, alarm)
                new_s = self._new_s.setdefault(group, deque(maxlen=_FLOOD))
                if entry is None and room <= 0 and alarm.priority != "high":
                    grouped[name] = alarm.priority
                    continue
                flooded = len(new_s) == _FLOOD and now_s - new_s[0] <= _FLOOD_S
                if flooded or self.grouped.get(name) == group:
                    grouped[name] = group
                    continue
                new_s.append(now_s)
            room -= entry is None
            listed[name] = alarm
        self.grouped = grouped
        priorities = {group: present[name].priority for name, group in grouped.items()}
        for group, count in Counter(grouped.values()).items():
            listed[f"{FLOOD_ID}{group}"] = self._flood(count, priorities[group])
        return listed

    def _take(self, name: str, alarm: Alarm, now_s: float) -> bool:
        entry = self.entries.get(name)
        if entry is None or not entry.present:
            self._raise(name, alarm, entry, now_s)
            return True
        entry.absent_s = None
        if entry.alarm == alarm:
            return False
        before, entry.alarm = entry.alarm, alarm
        self._unshelve_if_other(name, entry, before)
        if RANK[alarm.priority] < RANK[before.priority]:  # it has become worse: to be seen again
            self._number += 1
            entry.show_again(self._number)
            entry.show_if_high()
            self._journal(name, AlarmChange.WORSENED, entry)
        if alarm.trip and not before.trip:
            self._mark_first(name, entry, now_s)
        return True

    def _raise(self, name: str, alarm: Alarm, entry: Entry | None, now_s: float) -> None:
        self._number += 1
        again = entry is not None
        if entry is None:
            self.entries[name] = entry = Entry(alarm, now_s, now_s, self._number)
        else:
            before, entry.alarm, entry.present = entry.alarm, alarm, True
            entry.acknowledged, entry.absent_s = False, None
            self._unshelve_if_other(name, entry, before)
            entry.raised_s, entry.number, entry.count = now_s, self._number, entry.count + 1
            entry.show_if_high()
        self._journal(name, AlarmChange.RE_RAISED if again else AlarmChange.RAISED, entry)
        if alarm.trip:
            self._mark_first(name, entry, now_s)

    def _unshelve_if_other(self, name: str, entry: Entry, before: Alarm) -> None:
        """Who shelved an alarm has judged its cause then; with another cause it comes back."""
        if entry.shelved_until_s is not None and entry.alarm.cause != before.cause:
            self.unshelve(name, "")

    def _leave(self, name: str, entry: Entry, now_s: float) -> bool:
        if entry.absent_s is None:
            entry.absent_s = now_s
        if now_s - entry.absent_s < entry.alarm.off_s:
            return False
        entry.present = False
        self._journal(name, AlarmChange.CLEARED, entry)
        if entry.acknowledged and entry.shelved_until_s is None:
            del self.entries[name]
        return True

    def _mark_first(self, name: str, trip: Entry, now_s: float) -> None:
        """Mark the first of the alarms that led to a trip."""
        led = [
            entry
            for entry in self.entries.values()
            if entry is trip
            or (
                RANK[entry.alarm.priority] < RANK["low"]
                and now_s - entry.raised_s <= _LED_S
                and (entry.present or now_s - (entry.absent_s or 0.0) <= _JUST_GONE_S)
            )
        ]
        self._unmark_first(name)
        first = min(led, key=lambda entry: entry.number)
        first.led_to, trip.first = name, first.alarm.text

    def _unmark_first(self, trip: str) -> None:
        for entry in self.entries.values():
            if entry.led_to == trip:
                entry.led_to = ""

    # ---------------------------------------------------------------- what people do

    def acknowledge(self, names: Iterable[str], who: str) -> int:
        """Acknowledge alarms; returns the number of those not acknowledged before."""
        count = 0
        for name in names:
            entry = self.entries.get(name)
            if entry is None or entry.state not in ("active", "cleared"):
                continue
            count += 1
            entry.acknowledged, entry.first = True, ""
            self._journal(name, AlarmChange.ACKNOWLEDGED, entry, who)
            self._unmark_first(name)
            if not entry.present:
                del self.entries[name]
        return count

    def waiting(self, up_to: int) -> list[str]:
        """Unacknowledged alarms raised before a person has seen the list, by its newest number."""
        seen = {name: entry.state for name, entry in self.entries.items() if entry.newest <= up_to}
        return [name for name, state in seen.items() if state in ("active", "cleared")]

    def shelve(self, name: str, minutes: float, who: str, reason: str, now_s: float) -> Answer:
        """Shelve an alarm for some time."""
        entry = self.entries.get(name)
        if entry is None:
            return Code.NOT_LISTED.refused()
        if entry.alarm.priority == "high":
            return Code.HIGH_PRIORITY.refused()
        entry.shelved_until_s, entry.shelved = now_s + 60.0 * minutes, f"{who}: {reason}"
        self._journal(name, AlarmChange.SHELVED, entry, who, reason, 60.0 * minutes)
        return Code.SHELVED.done()

    def unshelve(self, name: str, who: str) -> Answer:
        """Unshelve an alarm."""
        entry = self.entries.get(name)
        if entry is None or entry.shelved_until_s is None:
            return Code.NOT_SHELVED.refused()
        entry.shelved_until_s, entry.shelved = None, ""
        self._journal(name, AlarmChange.UNSHELVED, entry, who)
        if entry.present:
            self._number += 1
            entry.show_again(self._number)
        else:
            del self.entries[name]
        return Code.UNSHELVED.done()

    def _unshelve_expired(self, now_s: float) -> bool:
        until_s = {name: entry.shelved_until_s for name, entry in self.entries.items()}
        over = [name for name, end_s in until_s.items() if end_s is not None and now_s >= end_s]
        for name in over:
            self.unshelve(name, "")
        return bool(over)

    # ---------------------------------------------------------------- for the page

    def rows(self, now_s: float, wall_s: float) -> list[dict[str, Any]]:
        """The list: unacknowledged first, then by priority, then in the order of raising.

        What to do in a stop stands with the stop, so that it comes before what led to it.
        """
        listed = sorted(
            self.entries.items(),
            key=lambda item: (
                _PLACE.index(item[1].state),
                RANK[item[1].alarm.priority],
                item[0] != STOP_ID,
                item[1].number,
            ),
        )
        shift_s = wall_s - now_s
        return [
            {"id": name}
            | {key: getattr(entry.alarm, key) for key in _OF_ALARM}
            | {key: getattr(entry, key) for key in _OF_ENTRY}
            | {
                "number": entry.newest,
                "first_out": bool(entry.led_to),
                "first_s": round(entry.first_s + shift_s, 3),
                "raised_s": round(entry.raised_s + shift_s, 3),
                "shelved_until_s": entry.shelved_until_s
                and round(entry.shelved_until_s + shift_s),
            }
            for name, entry in listed
        ]


#: advice that only helps while the weld is controlled
_OF_SET_POINTS = ("raise_temperature", "lower_temperature", "lower_depth")


class _Texts(BaseModel):
    """Content of ``alarms.yaml``."""

    kinds: dict[str, Alarm]
    sensors: dict[str, str]
    interlocks: dict[str, tuple[str, str]]
    limits: dict[str, tuple[str, str]]
    standby: dict[str, str]
    expected: dict[str, frozenset[str]]
    actions: dict[str, str]
    next_of_bag: dict[str, str]


def _texts() -> _Texts:
    content = load_yaml(files("fsw_hmi").joinpath("alarms.yaml").read_text(encoding="utf-8"))
    for kind in content["kinds"].values():
        kind["advice"] = ""  # by its code, when the alarm is made
    return _Texts(**content)


TEXTS = _texts()
#: by code: what to do, and by state of the recording the code when the weld is over
ACTIONS, NEXT_OF_BAG = TEXTS.actions, TEXTS.next_of_bag


def alarm(kind: str, cause: object = "", /, **values: object) -> Alarm:
    """An alarm of a kind, with ``values`` in its texts.

    ``cause`` is a code where there are several.
    """
    text = TEXTS.kinds[kind]
    parts = {key: getattr(text, key).format(**values) for key in ("what", "why", "action")}
    advice = ACTIONS[parts["action"]].format(**values)
    return replace(text, **parts, advice=advice, cause=str(cause))


def of_interlock(name: str, level: str) -> Alarm:
    """The alarm of an interlock that warns or has tripped."""
    what, action = TEXTS.interlocks.get(name, (name, "see_supervisor"))
    kind = level if level in ("warn", "trip") else "warn"
    if kind == "trip" and action in _OF_SET_POINTS:  # no set-point helps a stopped weld
        action = "inspect_first"
    return alarm(kind, name, what=what, action=action)


def of_limit(kind: str, flag: Flag) -> Alarm:
    """The alarm of a value outside a limit by which the weld is judged, or off its command."""
    what, unit = TEXTS.limits[flag["variable"]]
    low, high = flag["min"], flag["max"]
    if high is None:
        why = f"below {low:g}"
    elif low is None:
        why = f"above {high:g}"
    else:
        why = f"outside {low:g} to {high:g}"
    return alarm(kind, what=what, why=f"{why} {unit}")


def of_errors(node: str, errors: Sequence[tuple[str, str]]) -> Alarm:
    """The alarm of a node that reports errors, by part; the first is told."""
    (what, text), more = errors[0], len(errors) - 1
    why = (f"{what}: {text}" if what else text) + (f"; {more} more of its parts" if more else "")
    return alarm("part_error", what, node=node, why=why)


def flood(count: int, priority: Priority) -> Alarm:
    """The alarm that stands for so many of a priority."""
    return replace(alarm("flood", count=count), priority=priority)


def tripped(state: Mapping[str, Any]) -> str:
    """What the interlock says by which the weld stops; empty if another cause does."""
    if state["cause"] is not Cause.INTERLOCK_TRIP:
        return ""
    # not those that are tripped now: most of them are the stop's consequences
    names = [name for name in state["tripped"] if name in TEXTS.interlocks]
    return ", ".join(TEXTS.interlocks[name][0] for name in names)
