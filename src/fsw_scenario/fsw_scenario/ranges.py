"""Allowed ranges of what a person can ask of the weld, for scenarios, the command line and their help."""

from fsw_control.ranges import (
    COMMAND_FORCE_KN,
    COMMAND_SPEED_RPM,
    REFERENCE_DEPTH_MM,
    REFERENCE_TEMPERATURE_C,
    WELD_RATE_DEPTH_MM_PER_S,
    WELD_RATE_TEMPERATURE_C_PER_S,
    Range,
)
from fsw_plant.event_schema import (
    DISTURBANCE_AMPLITUDE,
    DURATION_S,
    FAULT_DELAY_S,
    FAULT_MAGNITUDE,
    WITH_MAGNITUDE,
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
    "WELD_ANGLE_DEG",
    "WELD_LENGTH_MM",
    "WELD_RATE_DEPTH_MM_PER_S",
    "WELD_RATE_TEMPERATURE_C_PER_S",
    "WELD_SPEED_MM_PER_MIN",
    "WITH_MAGNITUDE",
    "Range",
]

SINE_DEPTH_MM = Range(-1.0, 1.0, "mm")
SINE_TEMPERATURE_C = Range(-50.0, 50.0, "degC")
#: programme of a whole weld, chosen: largest step of a set-point; the tool's path
WELD_STEP_DEPTH_MM, WELD_STEP_TEMPERATURE_C = 0.2, 10.0
WELD_ANGLE_DEG = Range(0.0, 720.0, "deg")
WELD_LENGTH_MM = Range(0.0, 10_000.0, "mm")
WELD_SPEED_MM_PER_MIN = Range(10.0, 300.0, "mm/min")
