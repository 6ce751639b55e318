"""Timed disturbances and faults, applied at their tick."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from fsw_control.ranges import Range
from fsw_plant.event_schema import DURATION_S, Place, read_disturbance, read_fault
from fsw_plant.events import EPSILON_S, DisturbanceError, PlantEvent

#: Events of a scenario, those for the plant first.
EVENT_KINDS = ("disturbance", "fault", "reference", "switch", "command")
_READERS = {"disturbance": read_disturbance, "fault": read_fault}


class PlantSchedule:
    """The events of a scenario that concern the plant.

    Parameters
    ----------
    events : iterable of PlantEvent
        In any order; those of one time are applied in the order given.

    Attributes
    ----------
    events : deque of PlantEvent
        Those to come, in order of time.
    """

    def __init__(self, events: Iterable[PlantEvent] = ()) -> None:
        self.events = deque(sorted(events, key=lambda event: event.at_s))

    def due(self, time_s: float) -> list[PlantEvent]:
        """Take the events that a tick at ``time_s`` has reached."""
        due: list[PlantEvent] = []
        while self.events and self.events[0].at_s <= time_s + EPSILON_S:
            due.append(self.events.popleft())
        return due

    @classmethod
    def from_yaml(cls, text: str, where: str = "scenario") -> PlantSchedule:
        """Read YAML text: a list of events or a scenario with ``events``; those for others than the plant are ignored.

        Raises
        ------
        DisturbanceError
            If an event is not understood; the message says where and what is allowed.
        """
        at = Place(where)
        content = at.yaml(text)
        entries = at.list(content if isinstance(content, dict) else {"events": content}, "events")
        read = (read_event(entry, at.inside(f"events[{i}]")) for i, entry in enumerate(entries))
        return cls(event for event in read if event is not None)

    @classmethod
    def from_text_or_file(cls, source: str) -> PlantSchedule:
        """Read YAML text (if it has a line break or brackets) or the file of that path, see :meth:`from_yaml`."""
        if not source.strip():
            return cls()
        if "\n" in source or source.lstrip()[0] in "[{":
            return cls.from_yaml(source)
        try:
            return cls.from_yaml(Path(source).read_text(encoding="utf-8"), source)
        except (OSError, UnicodeDecodeError) as error:
            raise DisturbanceError(f"scenario: cannot read {source}: {error}") from None


def read_event(entry: Any, at: Place, latest: Range = DURATION_S) -> PlantEvent | None:
    """One event of a scenario, at the upper end of ``latest`` at the latest; None when it is not for the plant.

    Of an event that is not for the plant only time and kind are checked.
    """
    at_s, kind = event_head(entry, at, latest)
    return _READERS[kind](entry[kind], at.inside(kind), at_s) if kind in _READERS else None


def event_head(entry: Any, at: Place, latest: Range) -> tuple[float, str]:
    """Time and kind of an event, which has ``at_s`` and exactly one of ``EVENT_KINDS``."""
    at.mapping(entry)
    at.keys(entry, ("at_s", *EVENT_KINDS), required=("at_s",))
    kinds = [kind for kind in EVENT_KINDS if kind in entry]
    if len(kinds) != 1:
        raise at.error(f"needs exactly one of {', '.join(EVENT_KINDS)}, has {', '.join(kinds) or 'none'}")
    return at.number(entry, "at_s", Range(0.0, latest.high, latest.unit)), kinds[0]
