"""The list of alarms: present or gone, acknowledged or not, and which came first."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

_RANK = {"high": 0, "medium": 1, "low": 2}


class Alarm(NamedTuple):
    """What is wrong, what to do about it, and how soon: ``high``, ``medium`` or ``low``."""

    text: str
    advice: str
    priority: str


@dataclass(slots=True)
class _Entry:
    alarm: Alarm
    raised_s: float
    changed_s: float
    present: bool = True
    acknowledged: bool = False

    @property
    def state(self) -> str:
        if not self.present:
            return "cleared"
        return "acknowledged" if self.acknowledged else "active"


class AlarmList:
    """Keeps every alarm until it is gone and acknowledged.

    The one of them that came first is marked: most that follow it are consequences. One that comes back before it was
    acknowledged keeps its place; one that comes back after that is new.
    """

    def __init__(self) -> None:
        self._entries: dict[str, _Entry] = {}

    def update(self, present: Mapping[str, Alarm], now_s: float) -> bool:
        """Take the alarms that are present by name; returns whether the list has changed."""
        changed = False
        for name, alarm in present.items():
            entry = self._entries.get(name)
            if entry is None:
                self._entries[name] = _Entry(alarm, now_s, now_s)
                changed = True
            elif not entry.present:
                entry.present, entry.changed_s, entry.alarm = True, now_s, alarm
                changed = True
            elif entry.alarm != alarm:
                changed = True
                if _RANK[alarm.priority] < _RANK[entry.alarm.priority]:  # it has become worse: to be seen again
                    entry.acknowledged, entry.changed_s = False, now_s
                entry.alarm = alarm
        for name, entry in [*self._entries.items()]:
            if name not in present and entry.present:
                changed = True
                entry.present, entry.changed_s = False, now_s
                if entry.acknowledged:
                    del self._entries[name]
        return changed

    def acknowledge(self, names: Iterable[str], now_s: float) -> int:
        """Note that somebody has seen alarms; returns how many that were not acknowledged before."""
        count = 0
        for name in names:
            entry = self._entries.get(name)
            if entry is None or entry.acknowledged:
                continue
            count += 1
            entry.acknowledged, entry.changed_s = True, now_s
            if not entry.present:
                del self._entries[name]
        return count

    def rows(self) -> list[dict[str, Any]]:
        """The list for the page, the most urgent first."""
        first = next(iter(self._entries), None)
        listed = sorted(self._entries.items(), key=lambda item: (_RANK[item[1].alarm.priority], item[1].raised_s))
        return [
            {
                "id": name,
                **entry.alarm._asdict(),
                "state": entry.state,
                "first_out": name == first,
                "raised_s": entry.raised_s,
                "changed_s": entry.changed_s,
            }
            for name, entry in listed
        ]
