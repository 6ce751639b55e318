"""Kinds of clock."""

from enum import IntEnum


class ClockType(IntEnum):
    """Kind of a clock; the values are those of ``rcl_clock_type_t``."""

    UNINITIALIZED = 0
    ROS_TIME = 1
    SYSTEM_TIME = 2
    STEADY_TIME = 3
