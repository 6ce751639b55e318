"""What happened, who asked for it and why."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import StrEnum


class Level(StrEnum):
    """How loud an event is."""

    INFO = "info"
    WARN = "warn"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class Event:
    """One line of the log.

    Attributes
    ----------
    stamp_ns : int
        Stamp of the tick during which it happened.
    level : Level
        Severity.
    who : str
        ``operator``, ``failover``, ``interlock``, ``start`` or the name of a controller.
    text : str
        What happened and why, in words.
    """

    stamp_ns: int
    level: Level
    who: str
    text: str


class EventLog:
    """The latest events; ``take`` hands over those not yet seen."""

    def __init__(self, length: int = 200) -> None:
        self._history: deque[Event] = deque(maxlen=length)
        self._new: deque[Event] = deque(maxlen=length)

    def add(self, event: Event) -> None:
        """Record one event."""
        self._history.append(event)
        self._new.append(event)

    def take(self) -> list[Event]:
        """Events since the last call."""
        events = list(self._new)
        self._new.clear()
        return events

    @property
    def history(self) -> tuple[Event, ...]:
        """The latest events, oldest first."""
        return tuple(self._history)
