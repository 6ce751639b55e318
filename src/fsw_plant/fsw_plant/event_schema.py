"""What a disturbance and a fault of a scenario may look like: keys, ranges and error messages, once for all readers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from fsw_control.ranges import Range
from fsw_control.weld import TICK_S
from fsw_control.yaml_text import load_yaml
from fsw_plant.events import (
    CHANNELS,
    DISTURBANCE_SHAPES,
    FAULT_KINDS,
    MAX_DELAY_S,
    Disturbance,
    DisturbanceError,
    Fault,
)

#: length of a scenario, and of everything in it
DURATION_S = Range(TICK_S, 36_000.0, "s")
_AMPLITUDES = {
    "depth": Range(-1.0, 1.0, "mm"),
    "temperature": Range(-100.0, 100.0, "degC"),
    "axial_force": Range(-20.0, 20.0, "kN"),
    "spindle_speed": Range(-100.0, 100.0, "rpm"),
    "torque": Range(-200.0, 200.0, "N m"),
}
#: channel: key of the amplitude, and its range
DISTURBANCE_AMPLITUDE = {name: (f"amplitude_{unit}", _AMPLITUDES[name]) for name, unit in CHANNELS.items()}
#: sensor: unit suffix of a fault's magnitude, and its range (of a drift: per second)
FAULT_MAGNITUDE = {
    "depth": ("mm", Range(-5.0, 5.0, "mm")),
    "torque": ("nm", Range(-2000.0, 2000.0, "N m")),
    "thermocouple": ("c", Range(-1000.0, 1000.0, "degC")),
}
FAULT_DELAY_S = Range(0.0, MAX_DELAY_S, "s")
#: kinds of faults that have a magnitude
WITH_MAGNITUDE = ("spike", "bias", "drift", "delay")
#: a limit is still allowed when it was converted to SI and back
_WIRE_DIGITS = 9
#: keys that a shape needs besides its amplitude
_NEEDED = {"ramp": ("duration_s",), "pulse": ("duration_s",), "sine": ("period_s",)}


@dataclass(frozen=True, slots=True)
class Place:
    """A place in a file of events; reads values there and makes the errors of it.

    Attributes
    ----------
    where : str
        The file.
    path : str
        The place in it, e.g. ``events[2].fault``.
    failure : type
        Of the errors.
    whole : str
        What the file as a whole is called.
    """

    where: str
    path: str = ""
    failure: type[ValueError] = DisturbanceError
    whole: str = "scenario"

    def inside(self, name: str) -> Place:
        """A place one step further in."""
        return Place(self.where, f"{self.path}.{name}" if self.path else name, self.failure, self.whole)

    def error(self, problem: str) -> ValueError:
        """The error to raise when something is wrong here."""
        return self.failure(f"{self.where}: {self.path or self.whole} {problem}")

    def yaml(self, text: str) -> Any:
        """Content of YAML text, in which no key is given twice."""
        try:
            return load_yaml(text)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark
            line = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
            raise self.failure(f"{self.where}{line}: not valid YAML: {error.problem or 'broken'}") from None
        except yaml.YAMLError as error:
            raise self.failure(f"{self.where}: not valid YAML: {' '.join(str(error).split())}") from None

    def keys(self, entry: Mapping[Any, Any], known: Sequence[str], required: Sequence[str] = ()) -> None:
        """Refuse unknown and missing keys."""
        unknown = [str(key) for key in entry if key not in known]
        if unknown:
            raise self.error(f"has unknown key {', '.join(unknown)}; known: {', '.join(known)}")
        missing = [key for key in required if key not in entry]
        if missing:
            raise self.error(f"lacks {', '.join(missing)}")

    def mapping(self, entry: Any) -> dict[str, Any]:
        """The entry, if it is a mapping."""
        if not isinstance(entry, dict):
            raise self.error(f"is {entry!r}, not a mapping")
        return entry

    def list(self, entry: Mapping[str, Any], key: str) -> list[Any]:
        """A list in a mapping; empty when it is not there."""
        value = entry.get(key)
        if value is not None and not isinstance(value, list):
            raise self.inside(key).error(f"is {value!r}, not a list")
        return value or []

    def number(self, entry: Mapping[str, Any], key: str, allowed: Range, default: float | None = None) -> float:
        """A number in a mapping, in its range."""
        value = entry.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.inside(key).error(f"is {value!r}, not a number ({allowed})")
        complaint = allowed.complaint(value)
        if complaint:
            raise self.inside(key).error(f"= {complaint}")
        return float(value)

    def optional(self, entry: Mapping[str, Any], key: str, allowed: Range) -> float | None:
        """A number in a mapping, or None when it is not there."""
        return self.number(entry, key, allowed) if key in entry else None

    def word(self, entry: Mapping[str, Any], key: str, default: str | None = None) -> str:
        """A name in a mapping."""
        value = entry.get(key, default)
        if not isinstance(value, str) or not value.replace("_", "a").isalnum() or not value.isascii():
            raise self.inside(key).error(f"is {value!r}, not a name (letters, digits, _)")
        return value

    def choice(self, entry: Mapping[str, Any], key: str, allowed: Sequence[str]) -> str:
        """One of several words in a mapping."""
        value = entry.get(key)
        if value not in allowed:
            raise self.inside(key).error(f"is {value!r}; one of {', '.join(allowed)}")
        return str(value)


def read_disturbance(entry: Any, at: Place, at_s: float) -> Disturbance:
    """A ``disturbance`` of a scenario; raises the place's error where it is not understood."""
    at.mapping(entry)
    channel = at.choice(entry, "channel", tuple(DISTURBANCE_AMPLITUDE))
    shape = at.choice(entry, "shape", DISTURBANCE_SHAPES)
    key, allowed = DISTURBANCE_AMPLITUDE[channel]
    needed = _NEEDED.get(shape, ())
    optional = ("duration_s",) if shape == "sine" else ()
    at.keys(entry, ("channel", "shape", key, *needed, *optional), () if shape == "none" else (key, *needed))
    amplitude = at.number(entry, key, allowed, 0.0)
    duration_s = at.optional(entry, "duration_s", DURATION_S) or 0.0
    period_s = at.optional(entry, "period_s", DURATION_S) or 0.0
    return Disturbance(channel, shape, amplitude, duration_s, at_s, period_s)


def read_fault(entry: Any, at: Place, at_s: float) -> Fault:
    """A ``fault`` of a scenario; raises the place's error where it is not understood."""
    at.mapping(entry)
    sensor = at.choice(entry, "sensor", tuple(FAULT_MAGNITUDE))
    kind = at.choice(entry, "kind", FAULT_KINDS)
    unit, allowed = FAULT_MAGNITUDE[sensor] if kind != "delay" else ("s", FAULT_DELAY_S)
    magnitude = (f"magnitude_{unit}",) if kind in WITH_MAGNITUDE else ()
    at.keys(entry, ("sensor", "kind", "duration_s", *magnitude), magnitude)
    amount = at.number(entry, magnitude[0], allowed) if magnitude else 0.0
    duration_s = at.number(entry, "duration_s", Range(0.0, DURATION_S.high, "s"), 0.0)
    return Fault(sensor, kind, amount, duration_s, at_s)


def check_disturbance(
    channel: str, shape: str, amplitude: float, duration_s: float = 0.0, period_s: float = 0.0
) -> None:
    """Refuse a disturbance asked for at runtime that no scenario may hold; what its shape does not use may be anything.

    Raises
    ------
    DisturbanceError
        The message says what and what is allowed.
    """
    entry: dict[str, Any] = {"channel": channel, "shape": shape}
    if shape != "none":
        entry[DISTURBANCE_AMPLITUDE.get(channel, ("amplitude",))[0]] = round(amplitude, _WIRE_DIGITS)
    times = {"duration_s": duration_s, "period_s": period_s}
    used = (*_NEEDED.get(shape, ()), *(("duration_s",) if shape == "sine" and duration_s else ()))
    read_disturbance(entry | {key: times[key] for key in used}, Place("request", whole="disturbance"), 0.0)


def check_fault(sensor: str, kind: str, magnitude: float = 0.0, duration_s: float = 0.0) -> None:
    """The same for a fault."""
    entry: dict[str, Any] = {"sensor": sensor, "kind": kind, "duration_s": duration_s}
    if kind in WITH_MAGNITUDE:
        unit = "s" if kind == "delay" else FAULT_MAGNITUDE.get(sensor, ("",))[0]
        entry[f"magnitude_{unit}"] = round(magnitude, _WIRE_DIGITS)
    read_fault(entry, Place("request", whole="fault"), 0.0)
