"""Allowed ranges of what a person can ask of the weld, in one place for scenarios, the command line and their help."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite


@dataclass(frozen=True, slots=True)
class Range:
    """Closed interval with its unit."""

    low: float
    high: float
    unit: str

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g} {self.unit}".rstrip()

    def complaint(self, value: float) -> str | None:
        """Why ``value`` is not allowed, or None when it is."""
        if not isfinite(value) or not self.low <= value <= self.high:
            return f"{value:g} is outside {self}"
        return None


REFERENCE_DEPTH_MM = Range(1.5, 4.0, "mm")
REFERENCE_TEMPERATURE_C = Range(750.0, 950.0, "degC")
COMMAND_FORCE_KN = Range(60.0, 95.0, "kN")
COMMAND_SPEED_RPM = Range(300.0, 500.0, "rpm")
DURATION_S = Range(0.1, 36_000.0, "s")

#: Disturbance channels: name of the amplitude in a scenario, and its range.
DISTURBANCE_AMPLITUDE: dict[str, tuple[str, Range]] = {
    "depth": ("amplitude_mm", Range(-1.0, 1.0, "mm")),
    "temperature": ("amplitude_c", Range(-100.0, 100.0, "degC")),
    "axial_force": ("amplitude_kn", Range(-20.0, 20.0, "kN")),
    "spindle_speed": ("amplitude_rpm", Range(-100.0, 100.0, "rpm")),
}
DISTURBANCE_SHAPES = ("step", "ramp", "sine", "pulse", "none")

FAULT_KINDS = ("freeze", "dropout", "nan", "spike", "bias", "drift", "delay", "duplicate", "none")
#: Fault kinds whose magnitude is in the sensor's unit, in that unit per second, or in seconds; the others have none.
FAULT_IN_UNIT = ("spike", "bias")
#: Sensors: unit suffix of a fault's magnitude, and its range.
FAULT_MAGNITUDE: dict[str, tuple[str, Range]] = {
    "depth": ("mm", Range(-5.0, 5.0, "mm")),
    "torque": ("nm", Range(-2000.0, 2000.0, "N m")),
    "thermocouple": ("c", Range(-1000.0, 1000.0, "degC")),
}
FAULT_DELAY_S = Range(0.0, 10.0, "s")
