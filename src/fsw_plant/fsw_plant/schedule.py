"""Timed disturbances and faults, applied at their tick."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from typing import Annotated, Any

from pydantic import ConfigDict, model_validator

from fsw_control.schema.models import Many, Model, content_of, read_text, validate
from fsw_plant.event_schema import TIME_S, DisturbanceEntry, FaultEntry
from fsw_plant.events import EPSILON_S, PlantEvent
from fsw_plant.tool_path import Waypoint, check_order


class EventEntry(Model):
    """An event of a scenario: its time and exactly one kind; the first two are for the plant."""

    at_s: Annotated[float, TIME_S]
    disturbance: DisturbanceEntry | None = None
    fault: FaultEntry | None = None
    reference: Any = None
    switch: Any = None
    command: Any = None

    @model_validator(mode="after")
    def _check_kind(self) -> EventEntry:
        kinds = list(EventEntry.model_fields)[1:]
        present = [kind for kind in kinds if getattr(self, kind) is not None]
        if len(present) != 1:
            raise ValueError(
                f"needs exactly one of {', '.join(kinds)}, "
                f"has {' and '.join(present) or 'none of them'}"
            )
        return self

    def plant_event(self) -> PlantEvent | None:
        """The plant's part of the event; None if it is not for the plant."""
        entry = self.disturbance or self.fault
        return None if entry is None else entry.event(self.at_s)


class _Scenario(Model):
    """A scenario, of which the plant reads only the events and the tool's path."""

    model_config = ConfigDict(extra="ignore")

    events: Many[EventEntry] = ()
    path: Many[Waypoint] = ()

    @model_validator(mode="after")
    def _check_path(self) -> _Scenario:
        check_order(self.path)
        return self


class PlantSchedule:
    """The events of a scenario that concern the plant.

    Parameters
    ----------
    events : iterable of PlantEvent
        In any order; events at the same time are applied in the given order.
    path : sequence of Waypoint
        Path of the tool, for a plant on a canister.
    """

    def __init__(self, events: Iterable[PlantEvent] = (), path: Sequence[Waypoint] = ()) -> None:
        #: future events, in order of time
        self.events = deque(sorted(events, key=lambda event: event.at_s))
        self.path = tuple(path)

    @property
    def path_end_s(self) -> float:
        """Time of the last point of the path."""
        return self.path[-1].at_s if self.path else 0.0

    def due(self, time_s: float) -> list[PlantEvent]:
        """Remove and return the events that are due at a tick at ``time_s``."""
        due: list[PlantEvent] = []
        while self.events and self.events[0].at_s <= time_s + EPSILON_S:
            due.append(self.events.popleft())
        return due

    @classmethod
    def of(cls, entries: Iterable[EventEntry], path: Sequence[Waypoint] = ()) -> PlantSchedule:
        """The schedule of a scenario's events, without those that are not for the plant."""
        planned = (entry.plant_event() for entry in entries)
        return cls((event for event in planned if event is not None), path)

    @classmethod
    def from_yaml(cls, text: str, where: str = "scenario") -> PlantSchedule:
        """Read YAML text: a list of events, or a scenario; ignores events of other parts.

        Raises
        ------
        fsw_control.schema.models.InputError
            If an event is invalid; the message says where and what is allowed.
        """
        content = content_of(text, where)
        scenario = validate(
            _Scenario, content if isinstance(content, dict) else {"events": content}, where
        )
        return cls.of(scenario.events, scenario.path)

    @classmethod
    def from_text_or_file(cls, source: str) -> PlantSchedule:
        """Read YAML text (recognised by line breaks or brackets) or a file by its path."""
        if not source.strip():
            return cls()
        if "\n" in source or source.lstrip()[0] in "[{":
            return cls.from_yaml(source)
        return cls.from_yaml(read_text(source, "scenario"), source)
