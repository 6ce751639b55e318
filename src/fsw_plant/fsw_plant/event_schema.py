"""Schema of disturbances and faults for scenarios, services, command line and page."""

from __future__ import annotations

from collections.abc import Collection
from typing import Annotated, Any, Literal, get_args

from pydantic import model_validator

from fsw_control.schema.models import InputError, Model, range_of, validate
from fsw_control.schema.ranges import Range
from fsw_control.sensors import DEPTH, SENSORS, TEMPERATURE, TORQUE, SensorName
from fsw_control.weld import TICK_S
from fsw_plant.events import Disturbance, Fault

#: length of a scenario and of its parts
DURATION_S = Range(TICK_S, 36_000.0, "s")
#: time since the scenario's start, or a length that may be 0
TIME_S = Range(0.0, DURATION_S.high, "s")
#: limited, so that few samples are under way
FAULT_DELAY_S = Range(0.0, 60.0, "s")

Channel = Literal["depth", "temperature", "axial_force", "spindle_speed", "torque", "friction"]
Shape = Literal["step", "ramp", "sine", "pulse", "random", "none"]
Kind = Literal[
    "freeze", "dropout", "nan", "spike", "bias", "drift", "delay", "duplicate", "dust", "none"
]
DISTURBANCE_SHAPES, FAULT_KINDS = get_args(Shape), get_args(Kind)
#: kinds of faults that have a magnitude
WITH_MAGNITUDE = ("spike", "bias", "drift", "delay", "dust")
#: times required by a shape
_TIMES = {
    "ramp": {"duration_s"},
    "pulse": {"duration_s"},
    "sine": {"period_s"},
    "random": {"period_s"},
}
#: shapes that a duration ends, if it is given
_ENDED = ("sine", "random")
#: digits that survive the conversion to SI and back, so that limits stay valid
_WIRE_DIGITS = 9


class DisturbanceEntry(Model):
    """A shape over time, added to an output, an input or the tool's torque."""

    channel: Channel
    shape: Shape
    """`none` ends the channel's disturbance"""
    amplitude_mm: Annotated[float, Range(-1.0, 1.0, "mm")] | None = None
    """of `depth`"""
    amplitude_c: Annotated[float, Range(-200.0, 200.0, "degC")] | None = None
    """of `temperature`"""
    amplitude_kn: Annotated[float, Range(-20.0, 20.0, "kN")] | None = None
    """of `axial_force`"""
    amplitude_rpm: Annotated[float, Range(-100.0, 100.0, "rpm")] | None = None
    """of `spindle_speed`"""
    amplitude_nm: Annotated[float, Range(-200.0, 200.0, "N m")] | None = None
    """of `torque`"""
    amplitude_share: Annotated[float, Range(-0.5, 0.5, "share")] | None = None
    """of `friction`: change of the tool's torque, as by argon or oxide on the copper"""
    duration_s: Annotated[float, DURATION_S] | None = None
    """rise time of a `ramp`, length of a `pulse`, `sine` or `random` (without, these two act until
    cleared)"""
    period_s: Annotated[float, DURATION_S] | None = None
    """of a `sine`; mean time between changes of `random`"""

    @model_validator(mode="after")
    def _check_keys(self) -> DisturbanceEntry:
        amplitude = {DISTURBANCE_AMPLITUDE[self.channel][0]}
        needed = amplitude | _TIMES.get(self.shape, set()) if self.shape != "none" else set()
        optional = amplitude if self.shape == "none" else set()
        optional |= {"duration_s"} if self.shape in _ENDED else set()
        _check_keys(
            self, f"{self.channel} {self.shape}", {"channel", "shape"} | needed | optional, needed
        )
        return self

    def event(self, at_s: float) -> Disturbance:
        """The disturbance, starting at a time."""
        amplitude = getattr(self, DISTURBANCE_AMPLITUDE[self.channel][0]) or 0.0
        return Disturbance(
            self.channel, self.shape, amplitude, self.duration_s or 0.0, at_s, self.period_s or 0.0
        )


class FaultEntry(Model):
    """A fault between a sensor and its topic."""

    sensor: SensorName
    kind: Kind
    """`none` ends the sensor's fault"""
    magnitude_mm: Annotated[float, DEPTH.fault] | None = None
    """of a depth: `spike`, `bias`, `drift` (per s), `dust`"""
    magnitude_nm: Annotated[float, TORQUE.fault] | None = None
    """of a torque: `spike`, `bias`, `drift` (per s), `dust`"""
    magnitude_c: Annotated[float, TEMPERATURE.fault] | None = None
    """of a temperature: `spike`, `bias`, `drift` (per s), `dust`"""
    magnitude_s: Annotated[float, FAULT_DELAY_S] | None = None
    """of `delay`"""
    duration_s: Annotated[float, TIME_S] = 0.0
    """0: until cleared; of a `spike`: one sample"""

    @model_validator(mode="after")
    def _check_keys(self) -> FaultEntry:
        needed = {_magnitude_key(self.sensor, self.kind)} if self.kind in WITH_MAGNITUDE else set()
        _check_keys(
            self, f"{self.sensor} {self.kind}", {"sensor", "kind", "duration_s"} | needed, needed
        )
        return self

    def event(self, at_s: float) -> Fault:
        """The fault, starting at a time."""
        magnitude = getattr(self, _magnitude_key(self.sensor, self.kind)) or 0.0
        return Fault(self.sensor, self.kind, magnitude, self.duration_s, at_s)


_AMPLITUDES = {
    "depth": "amplitude_mm",
    "temperature": "amplitude_c",
    "axial_force": "amplitude_kn",
    "spindle_speed": "amplitude_rpm",
    "torque": "amplitude_nm",
    "friction": "amplitude_share",
}
#: by channel, key and range of the amplitude
DISTURBANCE_AMPLITUDE = {
    channel: (_AMPLITUDES[channel], range_of(DisturbanceEntry, _AMPLITUDES[channel]))
    for channel in get_args(Channel)
}
#: by sensor, key and range of a fault's magnitude (per second for a drift)
FAULT_MAGNITUDE = {
    name: (f"magnitude_{row.quantity.suffix}", row.quantity.fault) for name, row in SENSORS.items()
}


def disturbance(
    channel: str, shape: str, amplitude: float, duration_s: float = 0.0, period_s: float = 0.0
) -> Disturbance:
    """A disturbance requested at runtime; fields not used by its shape are ignored.

    Raises
    ------
    fsw_control.schema.models.InputError
        If a scenario could not contain it; the message says what is allowed.
    """
    entry: dict[str, Any] = {"channel": channel, "shape": shape}
    if shape != "none":
        _check_some(amplitude, "amplitude", "disturbance")
        entry[DISTURBANCE_AMPLITUDE.get(channel, ("amplitude_mm",))[0]] = round(
            amplitude, _WIRE_DIGITS
        )
    times = {"duration_s": duration_s, "period_s": period_s}
    used = _TIMES.get(shape, set()) | ({"duration_s"} if shape in _ENDED and duration_s else set())
    entry |= {key: times[key] for key in sorted(used)}
    return validate(DisturbanceEntry, entry, "disturbance").event(0.0)


def fault(sensor: str, kind: str, magnitude: float = 0.0, duration_s: float = 0.0) -> Fault:
    """A fault requested at runtime, like :func:`disturbance`."""
    entry: dict[str, Any] = {"sensor": sensor, "kind": kind, "duration_s": duration_s}
    if kind in WITH_MAGNITUDE:
        _check_some(magnitude, "magnitude", "fault")
        entry[_magnitude_key(sensor, kind)] = round(magnitude, _WIRE_DIGITS)
    return validate(FaultEntry, entry, "fault").event(0.0)


def amplitude_unit(channel: str) -> str:
    """Unit of a disturbance; empty if there is no such channel."""
    return DISTURBANCE_AMPLITUDE[channel][1].unit if channel in DISTURBANCE_AMPLITUDE else ""


def magnitude_unit(sensor: str, kind: str) -> str:
    """Unit of a fault (per second for a drift); empty if there is no such sensor."""
    return (
        range_of(FaultEntry, _magnitude_key(sensor, kind)).unit
        if sensor in FAULT_MAGNITUDE
        else ""
    )


def _magnitude_key(sensor: str, kind: str) -> str:
    return "magnitude_s" if kind == "delay" else FAULT_MAGNITUDE.get(sensor, ("magnitude_mm",))[0]


def _check_some(size: float, name: str, what: str) -> None:
    """Reject requests without effect."""
    if size == 0.0:
        raise InputError(f"{what}: {name} = 0 has no effect; 'none' ends a {what}")


def _check_keys(
    entry: Model, what: str, allowed: Collection[str], needed: Collection[str]
) -> None:
    """Reject missing keys and keys that are not used."""
    present = {key for key, value in entry if value is not None}
    problems = []
    if lacking := sorted(set(needed) - present):
        problems.append(f"lacks {', '.join(lacking)}, which {what} needs")
    if unused := sorted(present - set(allowed)):
        problems.append(f"has {', '.join(unused)}, which {what} does not use")
    if problems:
        raise ValueError(" and ".join(problems))
