"""Limits of the process that hold whoever controls: sensors that may be used, interlocks that trip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from math import isfinite
from typing import Any

from fsw_control.contract import SENSORS, Command
from fsw_control.units import kw_from_w, rad_s_from_rpm
from fsw_control.validity import SensorGuard, sensor_limits
from fsw_supervisor.state_machine import Level, Machine, Trigger
from fsw_supervisor.tick import NANOSECONDS, Tick


class Severity(StrEnum):
    """State of one interlock."""

    OK = "ok"
    WARN = "warn"
    TRIP = "trip"


_KEYS = ("warn", "trip", "hysteresis")
_LOG_LEVELS = {Severity.OK: Level.INFO, Severity.WARN: Level.WARN, Severity.TRIP: Level.ERROR}


@dataclass(frozen=True, slots=True)
class Interlock:
    """One limit.

    Attributes
    ----------
    name : str
        E.g. ``temperature_high``; a name that ends in ``_low`` guards against low values.
    quantity : str
        Key of the value that it watches, with the unit in the name.
    warn, trip : float
        Limits in that unit.
    hysteresis : float
        How far the value must come back before the level falls.
    """

    name: str
    quantity: str
    warn: float
    trip: float
    hysteresis: float

    def __post_init__(self) -> None:
        if not all(map(isfinite, (self.warn, self.trip, self.hysteresis))) or self.hysteresis < 0.0:
            raise ValueError(
                f"interlock {self.name}: warn, trip and hysteresis must be finite, hysteresis not negative"
            )
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


#: The defaults of the parameters ``interlocks.*``, where their sources are named.
DEFAULT_INTERLOCKS = (
    Interlock("temperature_low", "temperature_c", 800.0, 790.0, 2.0),
    Interlock("temperature_high", "temperature_c", 900.0, 910.0, 2.0),
    Interlock("depth_high", "depth_mm", 3.4, 3.7, 0.02),
    Interlock("force_high", "force_kn", 95.5, 97.0, 0.5),
    Interlock("torque_high", "torque_nm", 1400.0, 1600.0, 20.0),
    Interlock("power_high", "power_kw", 60.0, 66.0, 1.0),
)


def interlocks_from(values: Mapping[str, Any]) -> tuple[Interlock, ...]:
    """Table of the interlocks from the parameters; ValueError when they contradict each other."""
    return tuple(
        Interlock(item.name, item.quantity, *(values[f"interlocks.{item.name}.{key}"] for key in _KEYS))
        for item in DEFAULT_INTERLOCKS
    )


class SafetyMonitor:
    """Judges the process at every tick: sensors and interlocks.

    Parameters
    ----------
    machine : Machine
        For the log and the transition into a safe stop.
    interlocks : tuple of Interlock, optional
        What to watch.

    Attributes
    ----------
    invalid_sensors : tuple of str
        Sensors that may not be used at present.
    """

    def __init__(self, machine: Machine, interlocks: tuple[Interlock, ...] = DEFAULT_INTERLOCKS) -> None:
        self.invalid_sensors: tuple[str, ...] = ()
        self._machine = machine
        self._guard = SensorGuard()
        self._interlocks = interlocks
        self._persistence_ticks = 3
        self._levels = dict.fromkeys((item.name for item in interlocks), Severity.OK)
        self._worse = dict.fromkeys(self._levels, 0)

    def configure(self, values: Mapping[str, Any]) -> None:
        """Judge by the node's parameters from now on, without forgetting."""
        self._guard.configure(sensor_limits(values))
        self._interlocks = interlocks_from(values)
        self._persistence_ticks = values["interlocks.persistence_ticks"]

    def forget_time(self) -> None:
        """The clock went back: what the sensors showed before means nothing any more."""
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

    def judge(self, tick: Tick, acting: Command | None) -> None:
        """Judge the samples of a tick, and fire the interlocks that trip.

        Parameters
        ----------
        tick : Tick
            Is told which sensors are absent that were good before.
        acting : Command or None
            Force and speed that act, as far as known.
        """
        before, reasons = self.invalid_sensors, self._guard.reasons
        tick.judged = True
        tick.absent = tuple(name for name in SENSORS if name not in tick.samples and not reasons[name])
        measurement = self._guard.measure(tick.stamp_ns / NANOSECONDS, tick.samples, acting)
        self.invalid_sensors = measurement.invalid_sensors()
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
            }
        )

    def watch(self, values: Mapping[str, float]) -> None:
        """Hold the tick's values against the interlocks; one that is not finite leaves its interlocks as they are.

        A worse level must last ``interlocks.persistence_ticks`` before it is believed: a spike is no trip.
        """
        order = list(Severity)
        for item in self._interlocks:
            value, present = values[item.quantity], self._levels[item.name]
            if not isfinite(value):
                continue
            level = item.level(value, present)
            if order.index(level) > order.index(present):
                self._worse[item.name] += 1
                if self._worse[item.name] < self._persistence_ticks:
                    continue
            self._worse[item.name] = 0
            if level is present:
                continue
            self._levels[item.name] = level
            text = f"{item.name} is {level}: {item.quantity} {value:.4g}"
            self._machine.log(_LOG_LEVELS[level], "interlock", text)
            if level is Severity.TRIP:
                self._machine.fire(Trigger.INTERLOCK_TRIP, text, "interlock")
