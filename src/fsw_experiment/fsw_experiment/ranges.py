"""Allowed ranges of what a person can ask of the weld, for scenarios, the command line and their help."""

from fsw_control import weld
from fsw_plant.event_schema import (
    DISTURBANCE_AMPLITUDE,
    DURATION_S,
    FAULT_DELAY_S,
    FAULT_MAGNITUDE,
    Range,
)
from fsw_plant.events import DISTURBANCE_SHAPES, FAULT_KINDS

__all__ = [
    "COMMAND_FORCE_KN",
    "COMMAND_SPEED_RPM",
    "DISTURBANCE_AMPLITUDE",
    "DISTURBANCE_SHAPES",
    "DURATION_S",
    "FAULT_DELAY_S",
    "FAULT_KINDS",
    "FAULT_MAGNITUDE",
    "REFERENCE_DEPTH_MM",
    "REFERENCE_TEMPERATURE_C",
    "SINE_DEPTH_MM",
    "SINE_TEMPERATURE_C",
    "Range",
]

#: set-points, chosen about the paper's operating point
REFERENCE_DEPTH_MM = Range(1.5, 4.0, "mm")
REFERENCE_TEMPERATURE_C = Range(750.0, 950.0, "degC")
SINE_DEPTH_MM = Range(-1.0, 1.0, "mm")
SINE_TEMPERATURE_C = Range(-50.0, 50.0, "degC")
#: commands by hand, as far as the drives go
COMMAND_FORCE_KN = Range(weld.FORCE_MIN_KN, weld.FORCE_MAX_KN, "kN")
COMMAND_SPEED_RPM = Range(weld.SPEED_MIN_RPM, weld.SPEED_MAX_RPM, "rpm")
