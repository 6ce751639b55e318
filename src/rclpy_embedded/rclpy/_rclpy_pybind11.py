"""Exceptions that genuine rclpy has in its extension module, where user code imports them from."""

from __future__ import annotations


class RCUtilsError(RuntimeError):
    """Raised by the utilities below the client library."""


class RMWError(RuntimeError):
    """Raised by the middleware layer."""


class RCLError(RuntimeError):
    """Raised by the client library's core."""


class RCLInvalidROSArgsError(RCLError):
    """Raised when a command line has malformed ROS arguments."""


class UnknownROSArgsError(RuntimeError):
    """Raised when a command line has ROS arguments that nobody knows."""


class NodeNameNonExistentError(RCLError):
    """Raised when a node is asked for that is not in the graph."""


class UnsupportedEventTypeError(RCLError):
    """Raised when the middleware does not offer an event."""


class InvalidHandle(RuntimeError):  # noqa: N818 - the name is the genuine one
    """Raised when an entity is used after it was destroyed."""
