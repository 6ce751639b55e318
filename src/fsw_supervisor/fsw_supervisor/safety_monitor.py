"""Limits of the process whichever controller is active: sensors that may be used, interlocks that trip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from math import inf, isfinite, nan
from typing import Any

from fsw_control import weld
from fsw_control.contract import SENSORS, Command
from fsw_control.parameters import defaults, load
from fsw_control.units import NANOSECONDS, kw_from_w, rad_s_from_rpm
from fsw_control.validity import SensorGuard, sensor_limits
from fsw_supervisor.persistence import Persistence
from fsw_supervisor.state_machine import Level, Machine, Mode, Trigger
from fsw_supervisor.tick import GAP_S, Tick


class Severity(StrEnum):
    """State of one interlock."""

    OK = "ok"
    WARN = "warn"
    TRIP = "trip"


_ORDER = tuple(Severity)
_LOG_LEVELS = {Severity.OK: Level.INFO, Severity.WARN: Level.WARN, Severity.TRIP: Level.ERROR}
#: by interlock, the value that it watches
_QUANTITIES = {
    "temperature_low": "temperature_c",
    "temperature_high": "temperature_c",
    "depth_high": "depth_mm",
    "force_high": "force_kn",
    "torque_high": "torque_nm",
    "power_high": "power_kw",
}
#: by value, the sensor that it needs
_SENSOR = {"temperature_c": "thermocouple", "depth_mm": "depth", "torque_nm": "torque", "power_kw": "torque"}


@dataclass(frozen=True, slots=True)
class Interlock:
    """A limit on one quantity."""

    name: str  #: e.g. ``temperature_high``; a name that ends in ``_low`` guards against low values
    quantity: str  #: key of the value that it watches, with the unit in the name
    #: limits in that unit
    warn: float
    trip: float
    hysteresis: float  #: how far the value must come back before the level falls

    def __post_init__(self) -> None:
        if not (self.warn > self.trip if self.name.endswith("_low") else self.warn < self.trip):
            raise ValueError(f"interlock {self.name}: warn {self.warn} must come before trip {self.trip}")

    def level(self, value: float, present: Severity) -> Severity:
        """Level that ``value`` means when the level is ``present``."""
        sign = 1.0 if self.trip > self.warn else -1.0
        excess_warn, excess_trip = sign * (value - self.warn), sign * (value - self.trip)
        if excess_trip >= 0.0 or (present is Severity.TRIP and excess_trip > -self.hysteresis):
            return Severity.TRIP
        if excess_warn >= 0.0 or (present is not Severity.OK and excess_warn > -self.hysteresis):
            return Severity.WARN
        return Severity.OK


def interlocks_from(values: Mapping[str, Any]) -> tuple[Interlock, ...]:
    """Table of the interlocks from the parameters; ValueError when they contradict each other."""
    return tuple(
        Interlock(name, quantity, *(values[f"interlocks.{name}.{key}"] for key in ("warn", "trip", "hysteresis")))
        for name, quantity in _QUANTITIES.items()
    )


class SafetyMonitor:
    """Judges the process at every tick: sensors and interlocks."""

    def __init__(self, machine: Machine) -> None:
        self.invalid_sensors: tuple[str, ...] = ()  #: those that may not be used at present
        #: since when there is one of them (``Machine.time_ns``), each of which an interlock needs; None: there is none
        self.blind_since_ns: int | None = None
        self.hold_s = 0.0  #: time for which the last good sample replaces a bad one
        self._machine = machine
        self._judged = False  #: anything has been measured
        self._guard = SensorGuard()
        self.configure(defaults(load("fsw_supervisor", "supervisor.yaml")))
        self._levels = dict.fromkeys(_QUANTITIES, Severity.OK)
        self._runs = {name: {level: Persistence() for level in _ORDER} for name in _QUANTITIES}
        self._leaving = {name: Persistence() for name in _QUANTITIES}
        self._judged_ns: int | None = None
        self._causes = dict.fromkeys(_QUANTITIES, "")

    def configure(self, values: Mapping[str, Any]) -> None:
        """Apply new parameters of the node, keeping the state."""
        self.hold_s = values["validity.hold"]
        self._guard.configure(sensor_limits(values))
        self._interlocks = interlocks_from(values)
        self._persistence_s = values["interlocks.persistence_s"]

    def forget_time(self) -> None:
        """The clock went back: earlier readings do not count any more."""
        self._guard.reset()

    @property
    def sensor_reasons(self) -> dict[str, str]:
        """By sensor, why its last sample was not used; empty where it was."""
        return self._guard.reasons

    @property
    def active(self) -> tuple[str, ...]:
        """Active warnings and trips, e.g. ``temperature_high:warn``."""
        return tuple(f"{name}:{level}" for name, level in self._levels.items() if level is not Severity.OK)

    @property
    def tripped(self) -> tuple[str, ...]:
        """Names of the tripped interlocks."""
        return tuple(name for name, level in self._levels.items() if level is Severity.TRIP)

    @property
    def causes(self) -> str:
        """The tripped interlocks with the values at which they tripped, in words."""
        return "; ".join(self._causes[name] for name in self.tripped)

    @property
    def blind(self) -> str:
        """Which sensors are invalid and why, in words; empty when all values that interlocks watch are known."""
        if not self._judged:
            return "nothing has been measured yet"
        return "; ".join(f"sensor {name} is invalid ({self.sensor_reasons[name]})" for name in self.invalid_sensors)

    def judge(self, tick: Tick, acting: Command | None) -> None:
        """Judge the samples of a tick; ``acting``: force and speed that act. A trip leads to a safe stop."""
        before, reasons = self.invalid_sensors, self._guard.reasons
        tick.judged = self._judged = True
        tick.dropouts = tuple(name for name in SENSORS if name not in tick.samples and not reasons[name])
        measurement = self._guard.measure(tick.stamp_ns / NANOSECONDS, tick.samples, acting)
        self.invalid_sensors = measurement.invalid_sensors()
        if not self.invalid_sensors:
            self.blind_since_ns = None
        elif self.blind_since_ns is None:
            self.blind_since_ns = self._machine.time_ns
        for name in self.invalid_sensors:
            if name not in before:
                self._machine.log(Level.WARN, "sensors", f"sensor {name} is invalid: {reasons[name]}")
        for name in before:
            if name not in self.invalid_sensors:
                self._machine.log(Level.INFO, "sensors", f"sensor {name} is valid again")
        self.watch(
            {
                "depth_mm": measurement.depth_mm,
                "torque_nm": measurement.torque_nm,
                "temperature_c": measurement.temperature_c,
                "force_kn": measurement.force_kn,
                "power_kw": kw_from_w(measurement.torque_nm * rad_s_from_rpm(measurement.speed_rpm)),
            },
            measurement.held,
            self._since_judged_s(),
        )
        if self.invalid_sensors and self._machine.acknowledged:
            self._machine.renew()  # from now on it is unknown whether a cause is present

    def _since_judged_s(self) -> float:
        """Time since the last tick that was judged; one tick period for the first, and after a gap."""
        before_ns, self._judged_ns = self._judged_ns, self._machine.time_ns
        elapsed_s = inf if before_ns is None else (self._machine.time_ns - before_ns) / NANOSECONDS
        return elapsed_s if elapsed_s <= GAP_S else self._machine.settings.tick_period_s

    def watch(self, values: Mapping[str, float], held: tuple[str, ...] = (), elapsed_s: float = weld.TICK_S) -> None:
        """Compare values by quantity with the interlocks; a missing or non-finite value changes nothing.

        A level takes effect when the values of the last ``interlocks.persistence_s``, two at least, were each at that
        level or worse: a spike does not trip. A trip is gone after as long without it, not counting the time of sensors
        that are ``held``: a single value does not free a safe stop. It acts for as long as it lasts, in every mode,
        not only when it begins. ``elapsed_s`` is the time since the values before.
        """
        for item in self._interlocks:
            value = values.get(item.quantity, nan)
            if isfinite(value):
                self._judge(item, value, _SENSOR.get(item.quantity) in held, elapsed_s)
        if not self.tripped:
            return
        if self._machine.mode is Mode.SAFE_STOP:
            if self._machine.acknowledged:
                self._machine.renew()
        else:
            self._machine.fire(Trigger.INTERLOCK_TRIP, self.causes, "interlock")

    def _judge(self, item: Interlock, value: float, is_held: bool, elapsed_s: float) -> None:
        """Determine the level of an interlock."""
        present, runs = self._levels[item.name], self._runs[item.name]
        period_s, limit_s, leaving = self._machine.settings.tick_period_s, self._persistence_s, self._leaving[item.name]
        shown = item.level(value, present)
        for level in _ORDER:
            runs[level].note(_ORDER.index(shown) >= _ORDER.index(level), elapsed_s, period_s)
        leaves = present is Severity.TRIP and shown is not Severity.TRIP
        if not (leaves and is_held):
            leaving.note(leaves, elapsed_s, period_s)
        if leaves and not leaving.reaches(limit_s, period_s):
            return
        lasting = (level for level in _ORDER if level is present or runs[level].reaches(limit_s, period_s))
        level = min(shown, max(lasting, key=_ORDER.index), key=_ORDER.index)
        if level is present:
            return
        self._levels[item.name] = level
        text = f"{item.name} is {level}: {item.quantity} {value:.4g}"
        self._causes[item.name] = text
        self._machine.log(_LOG_LEVELS[level], "interlock", text)
