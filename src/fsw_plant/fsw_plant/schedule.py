"""Timed disturbances and faults, applied at their tick."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import yaml

from fsw_control import SENSORS
from fsw_plant.disturbances import CHANNELS, SHAPES, Disturbance, DisturbanceError
from fsw_plant.faults import KINDS, Fault

#: Unit suffix of a fault's magnitude by sensor.
SENSOR_UNITS = {"depth": "mm", "torque": "nm", "thermocouple": "c"}
#: Events of a scenario that are not for the plant.
_OTHERS = ("reference", "switch", "command")


@dataclass(frozen=True, slots=True)
class PlantEvent:
    """A disturbance on a channel or a fault of a sensor, from ``at_s`` on.

    Attributes
    ----------
    at_s : float
        It acts on the first tick whose time is not before.
    target : str
        Channel of a disturbance or sensor of a fault.
    kind : str
        Shape of a disturbance or kind of a fault.
    amount : float
        Amplitude or magnitude, in mm, degC, kN, rpm, N m (drift: per s; delay: s).
    duration_s, period_s : float
        As in `Disturbance` and `Fault`.
    is_fault : bool
    """

    at_s: float
    target: str
    kind: str
    amount: float = 0.0
    duration_s: float = 0.0
    period_s: float = 0.0
    is_fault: bool = False

    def disturbance(self) -> Disturbance:
        """The disturbance that begins."""
        return Disturbance(self.kind, self.amount, self.duration_s, self.period_s, self.at_s)

    def fault(self) -> Fault:
        """The fault that begins."""
        return Fault(self.kind, self.amount, self.duration_s, self.at_s)


class PlantSchedule:
    """The events of a scenario that concern the plant, in order of time.

    Parameters
    ----------
    events : sequence of PlantEvent
        In any order; those of one time are applied in the order given.
    """

    def __init__(self, events: Sequence[PlantEvent] = ()) -> None:
        self.events = tuple(sorted(events, key=lambda event: event.at_s))
        self._next = 0
        self.next_s = self.events[0].at_s if self.events else float("inf")

    def due(self, time_s: float) -> list[PlantEvent]:
        """Take the events that a tick at ``time_s`` has reached."""
        due: list[PlantEvent] = []
        while self.next_s <= time_s + 1e-9:
            due.append(self.events[self._next])
            self._next += 1
            self.next_s = self.events[self._next].at_s if self._next < len(self.events) else float("inf")
        return due

    @classmethod
    def from_events(cls, events: Any, where: str = "events") -> PlantSchedule:
        """Read a scenario's list of events; those for others (reference, switch, command) are passed over.

        Raises
        ------
        DisturbanceError
            If an event is not understood; the message says which and what is allowed.
        """
        if not isinstance(events, Sequence) or isinstance(events, str):
            raise DisturbanceError(f"{where}: must be a list of events, each with at_s and disturbance or fault")
        read = [_event(event, f"{where}[{i}]") for i, event in enumerate(events)]
        return cls([event for event in read if event is not None])

    @classmethod
    def from_yaml(cls, text: str, where: str = "scenario") -> PlantSchedule:
        """Read YAML text: a list of events or a scenario with ``events``; errors as :meth:`from_events`."""
        try:
            data = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise DisturbanceError(f"{where}: not valid YAML: {' '.join(str(error).split())}") from None
        if isinstance(data, Mapping):
            data = data.get("events", [])
        return cls.from_events([] if data is None else data, f"{where}: events")

    @classmethod
    def from_text_or_file(cls, source: str) -> PlantSchedule:
        """Read YAML text (if it has a line break or brackets) or the file of that path; empty: no events."""
        if not source.strip():
            return cls()
        if "\n" in source or source.lstrip()[0] in "[{":
            return cls.from_yaml(source)
        try:
            return cls.from_yaml(Path(source).read_text(encoding="utf-8"), source)
        except (OSError, UnicodeDecodeError) as error:
            raise DisturbanceError(f"scenario: cannot read {source}: {error}") from None


def _event(event: Any, where: str) -> PlantEvent | None:
    if not isinstance(event, Mapping):
        raise DisturbanceError(f"{where}: must be a mapping with at_s and disturbance or fault")
    kinds = [key for key in event if key != "at_s"]
    if len(kinds) != 1 or kinds[0] not in ("disturbance", "fault", *_OTHERS):
        known = ", ".join(("disturbance", "fault", *_OTHERS))
        raise DisturbanceError(f"{where}: needs at_s and exactly one of {known}; has {', '.join(map(str, event))}")
    at_s = _number(event.get("at_s"), f"{where}.at_s")
    if at_s < 0:
        raise DisturbanceError(f"{where}.at_s is {at_s:g}: must be >= 0")
    if kinds[0] in _OTHERS:
        return None
    where = f"{where}.{kinds[0]}"
    content = event[kinds[0]]
    if not isinstance(content, Mapping):
        raise DisturbanceError(f"{where}: must be a mapping")
    read = _fault if kinds[0] == "fault" else _disturbance
    try:
        return read(at_s, dict(content), where)
    except DisturbanceError as error:
        raise DisturbanceError(str(error) if str(error).startswith(where) else f"{where}: {error}") from None


def _disturbance(at_s: float, content: dict[str, Any], where: str) -> PlantEvent:
    channel = _choice(content.pop("channel", None), CHANNELS, f"{where}.channel")
    shape = _choice(content.pop("shape", None), SHAPES, f"{where}.shape")
    amount_key = f"amplitude_{CHANNELS[channel]}"
    numbers = _numbers(content, (amount_key, "duration_s", "period_s"), where)
    if shape != "none" and amount_key not in numbers:
        raise DisturbanceError(f"{where}: lacks {amount_key}")
    amount = numbers.get(amount_key, 0.0)
    made = PlantEvent(at_s, channel, shape, amount, numbers.get("duration_s", 0.0), numbers.get("period_s", 0.0))
    made.disturbance()
    return made


def _fault(at_s: float, content: dict[str, Any], where: str) -> PlantEvent:
    sensor = _choice(content.pop("sensor", None), SENSORS, f"{where}.sensor")
    kind = _choice(content.pop("kind", None), KINDS, f"{where}.kind")
    keys = ("magnitude", f"magnitude_{SENSOR_UNITS[sensor]}", "magnitude_s", "duration_s")
    numbers = _numbers(content, keys, where)
    given = [key for key in keys[:3] if key in numbers]
    if len(given) > 1:
        raise DisturbanceError(f"{where}: give one of {', '.join(given)}")
    if kind in ("spike", "bias", "drift", "delay") and not given:
        raise DisturbanceError(f"{where}: {kind} lacks {keys[2] if kind == 'delay' else keys[1]}")
    amount = numbers[given[0]] if given else 0.0
    made = PlantEvent(at_s, sensor, kind, amount, numbers.get("duration_s", 0.0), is_fault=True)
    made.fault()
    return made


def _choice(value: Any, allowed: Any, where: str) -> str:
    if value not in allowed:
        raise DisturbanceError(f"{where}: {value!r} is none of {', '.join(allowed)}")
    return str(value)


def _numbers(content: dict[str, Any], keys: Sequence[str], where: str) -> dict[str, float]:
    unknown = [str(key) for key in content if key not in keys]
    if unknown:
        raise DisturbanceError(f"{where}: unknown {', '.join(unknown)}; allowed here: {', '.join(keys)}")
    return {key: _number(value, f"{where}.{key}") for key, value in content.items()}


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise DisturbanceError(f"{where} is {value!r}: give a finite number")
    return float(value)
