# ruff: noqa: N818 - the names are the genuine ones
"""Exceptions that genuine rclpy has in its extension module, from where programs import them."""


class RCUtilsError(RuntimeError):
    """An error of the utilities below the client library."""


class RMWError(RuntimeError):
    """An error of the middleware layer."""


class RCLError(RuntimeError):
    """An error of the client library."""


class RCLInvalidROSArgsError(RCLError):
    """A command line has malformed ROS arguments."""


class UnknownROSArgsError(RuntimeError):
    """A command line has unknown ROS arguments."""


class NodeNameNonExistentError(RCLError):
    """A node is not in the graph."""


class UnsupportedEventTypeError(RCLError):
    """The middleware does not have this event."""


class InvalidHandle(RuntimeError):
    """An entity was used after it was destroyed."""
