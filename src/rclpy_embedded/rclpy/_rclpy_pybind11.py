"""The names that user code imports from the genuine extension module."""

from rclpy.exceptions import (
    InvalidHandle,
    NodeNameNonExistentError,
    RCLError,
    RCLInvalidROSArgsError,
    RCUtilsError,
    RMWError,
    UnknownROSArgsError,
    UnsupportedEventTypeError,
)

__all__ = [
    "InvalidHandle",
    "NodeNameNonExistentError",
    "RCLError",
    "RCLInvalidROSArgsError",
    "RCUtilsError",
    "RMWError",
    "UnknownROSArgsError",
    "UnsupportedEventTypeError",
]
