"""What a person can ask for on the page: read from untrusted JSON, checked, and in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fsw_control.contract import BUILT_IN_SOURCES, SENSORS
from fsw_control.ranges import (
    COMMAND_FORCE_KN,
    COMMAND_SPEED_RPM,
    REFERENCE_DEPTH_MM,
    REFERENCE_TEMPERATURE_C,
    Range,
)
from fsw_plant.event_schema import (
    DISTURBANCE_AMPLITUDE,
    DISTURBANCE_SHAPES,
    DURATION_S,
    FAULT_KINDS,
    FAULT_MAGNITUDE,
    read_disturbance,
    read_fault,
)
from fsw_plant.place import Place

MODES = ("auto", *BUILT_IN_SOURCES)
WELD_ACTIONS = ("hold", "resume", "abort")
WAIT_S = Range(0.0, 10.0, "s")
_MOST_ALARMS, _LONGEST = 200, 100


class RequestError(ValueError):
    """A request that is not carried out; the message says why."""


@dataclass(frozen=True, slots=True)
class Action:
    """Something to be carried out in the graph."""

    def __str__(self) -> str:
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class SafeStop(Action):
    """The safe state, at once."""

    def __str__(self) -> str:
        return "safe stop"


@dataclass(frozen=True, slots=True)
class AcknowledgeStop(Action):
    """The safe stop has been seen, and may be left."""

    def __str__(self) -> str:
        return "acknowledge the safe stop"


@dataclass(frozen=True, slots=True)
class SetReference(Action):
    """New set-points, at once or as a ramp from those in force."""

    depth_mm: float
    temperature_c: float
    ramp: bool

    def __str__(self) -> str:
        return f"set-points {self.depth_mm:g} mm, {self.temperature_c:g} degC{', ramp' if self.ramp else ''}"


@dataclass(frozen=True, slots=True)
class Switch(Action):
    """Another controller, waited for as long as ``wait_s``."""

    controller: str
    wait_s: float

    def __str__(self) -> str:
        return f"switch to {self.controller}"


@dataclass(frozen=True, slots=True)
class ChangeMode(Action):
    """Another mode; force and speed are for ``manual``, else None."""

    mode: str
    force_kn: float | None = None
    speed_rpm: float | None = None

    def __str__(self) -> str:
        values = "" if self.force_kn is None else f" {self.force_kn:g} kN, {self.speed_rpm:g} rpm"
        return f"mode {self.mode}{values}"


@dataclass(frozen=True, slots=True)
class Programme(Action):
    """Hold, resume or abort the programme of the weld."""

    verb: str

    def __str__(self) -> str:
        return f"weld {self.verb}"


@dataclass(frozen=True, slots=True)
class Acknowledge(Action):
    """Alarms that have been seen."""

    ids: tuple[str, ...]

    def __str__(self) -> str:
        return f"acknowledge {', '.join(self.ids[:3])}{' ...' if len(self.ids) > 3 else ''}"


@dataclass(frozen=True, slots=True)
class Disturb(Action):
    """A disturbance of the emulated plant; the amplitude in the paper's unit of the channel."""

    channel: str
    shape: str
    amplitude: float
    duration_s: float
    period_s: float

    def __str__(self) -> str:
        return f"disturb {self.channel} {self.shape} {self.amplitude:g}"


@dataclass(frozen=True, slots=True)
class Fail(Action):
    """A fault of a sensor of the emulated plant."""

    sensor: str
    kind: str
    magnitude: float
    duration_s: float

    def __str__(self) -> str:
        return f"fault {self.sensor} {self.kind} {self.magnitude:g}"


def read(message: Mapping[str, Any]) -> Action:
    """The action that a request asks for.

    Raises
    ------
    RequestError
        When there is none of this name, or a value is missing, of the wrong type or out of range.
    """
    do = message.get("do")
    reader = _READERS.get(do) if isinstance(do, str) else None
    if reader is None:
        raise RequestError("there is no such request")
    return reader(message)


def _safe_stop(_: Mapping[str, Any]) -> Action:
    return SafeStop()


def _acknowledge_stop(_: Mapping[str, Any]) -> Action:
    return AcknowledgeStop()


def _set_reference(message: Mapping[str, Any]) -> Action:
    depth_mm = number(message, "depth_mm", REFERENCE_DEPTH_MM)
    temperature_c = number(message, "temperature_c", REFERENCE_TEMPERATURE_C)
    ramp = message.get("ramp", False)
    if not isinstance(ramp, bool):
        raise RequestError("ramp: must be true or false")
    return SetReference(depth_mm, temperature_c, ramp)


def _switch(message: Mapping[str, Any]) -> Action:
    return Switch(word(message, "controller"), number(message, "wait_s", WAIT_S, 0.0))


def _mode(message: Mapping[str, Any]) -> Action:
    mode = choice(message, "mode", MODES)
    if mode != "manual":
        return ChangeMode(mode)
    force_kn = number(message, "force_kn", COMMAND_FORCE_KN)
    return ChangeMode(mode, force_kn, number(message, "speed_rpm", COMMAND_SPEED_RPM))


def _weld(message: Mapping[str, Any]) -> Action:
    return Programme(choice(message, "action", WELD_ACTIONS))


def _acknowledge(message: Mapping[str, Any]) -> Action:
    ids = message.get("ids")
    if not isinstance(ids, list) or not 0 < len(ids) <= _MOST_ALARMS:
        raise RequestError("ids: must be a list of alarms")
    if not all(isinstance(one, str) and one.isascii() and one.isprintable() and len(one) <= _LONGEST for one in ids):
        raise RequestError("ids: must be names of alarms")
    return Acknowledge(tuple(ids))


def _disturb(message: Mapping[str, Any]) -> Action:
    channel = choice(message, "channel", tuple(DISTURBANCE_AMPLITUDE))
    shape = choice(message, "shape", DISTURBANCE_SHAPES)
    key, allowed = DISTURBANCE_AMPLITUDE[channel]
    entry: dict[str, Any] = {"channel": channel, "shape": shape}
    if shape != "none":
        entry[key] = number(message, "amplitude", allowed)
    if shape in ("ramp", "pulse"):
        entry["duration_s"] = number(message, "duration_s", DURATION_S)
    if shape == "sine":
        entry["period_s"] = number(message, "period_s", DURATION_S)
        duration_s = number(message, "duration_s", Range(0.0, DURATION_S.high, "s"), 0.0)
        entry |= {"duration_s": duration_s} if duration_s else {}
    one = _checked(read_disturbance, entry)
    return Disturb(channel, shape, one.amount, one.duration_s, one.period_s)


def _fault(message: Mapping[str, Any]) -> Action:
    sensor = choice(message, "sensor", SENSORS)
    kind = choice(message, "kind", FAULT_KINDS)
    entry: dict[str, Any] = {"sensor": sensor, "kind": kind}
    if kind in ("spike", "bias", "drift"):
        key, allowed = FAULT_MAGNITUDE[sensor]
        entry[key] = number(message, "magnitude", allowed)
    elif kind == "delay":
        entry["magnitude_s"] = number(message, "magnitude", Range(0.0, DURATION_S.high, "s"))
    entry["duration_s"] = number(message, "duration_s", Range(0.0, DURATION_S.high, "s"), 0.0)
    one = _checked(read_fault, entry)
    return Fail(sensor, kind, one.amount, one.duration_s)


def _checked(reader: Callable[[Any, Place, float], Any], entry: Mapping[str, Any]) -> Any:
    """The plant's own reading of an entry."""
    try:
        return reader(entry, Place("request", failure=RequestError), 0.0)
    except ValueError as error:
        raise RequestError(str(error)) from None


_READERS: dict[str, Callable[[Mapping[str, Any]], Action]] = {
    "safe_stop": _safe_stop,
    "acknowledge_stop": _acknowledge_stop,
    "set_reference": _set_reference,
    "switch": _switch,
    "mode": _mode,
    "weld": _weld,
    "acknowledge": _acknowledge,
    "disturb": _disturb,
    "fault": _fault,
}


def number(message: Mapping[str, Any], key: str, allowed: Range, default: float | None = None) -> float:
    """A number of a request in its range; null counts as missing."""
    value = message.get(key)
    value = default if value is None else value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise RequestError(f"{key}: must be a number, {allowed}")
    if not allowed.low <= value <= allowed.high:  # before float(), which an enormous integer would break
        raise RequestError(f"{key}: must be {allowed}")
    return float(value)


def choice(message: Mapping[str, Any], key: str, allowed: Sequence[str]) -> str:
    """One of several words."""
    value = message.get(key)
    if not isinstance(value, str) or value not in allowed:
        raise RequestError(f"{key}: must be one of {', '.join(allowed)}")
    return value


def word(message: Mapping[str, Any], key: str) -> str:
    """A name of letters, digits and _."""
    value = message.get(key)
    if not isinstance(value, str) or len(value) > _LONGEST or not value.isascii():
        raise RequestError(f"{key}: must be a name")
    if not value.replace("_", "a").isalnum():
        raise RequestError(f"{key}: must be a name of letters, digits and _")
    return value
