"""Helpers around the default context and the command line."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from rclpy.arguments import parse
from rclpy.constants import S_TO_NS
from rclpy.context import Context

_default_context: Context | None = None
_context_lock = threading.RLock()


def get_default_context(*, shutting_down: bool = False) -> Context:
    """Return the global default context; with `shutting_down` the next call makes a new one."""
    global _default_context
    with _context_lock:
        if _default_context is None:
            _default_context = Context()
        context = _default_context
        if shutting_down:
            _default_context = None
        return context


def remove_ros_args(args: Sequence[str] | None = None) -> list[str]:
    """Return the arguments (``sys.argv`` by default) that are not for ROS."""
    return parse(args).remaining


def ok(*, context: Context | None = None) -> bool:
    """Return whether a context (default: the global one) is initialized and not shut down."""
    return (get_default_context() if context is None else context).ok()


def shutdown(*, context: Context | None = None) -> None:
    """Shut down a context (default: the global one)."""
    (get_default_context(shutting_down=True) if context is None else context).shutdown()


def try_shutdown(*, context: Context | None = None) -> None:
    """Shut down a context (default: the global one) unless that was done already."""
    global _default_context
    if context is not None:
        context.try_shutdown()
        return
    with _context_lock:
        get_default_context().try_shutdown()
        _default_context = None


def get_rmw_implementation_identifier() -> str:
    """Return the middleware this runtime is compatible with."""
    return "rmw_cyclonedds_cpp"


def get_available_rmw_implementations() -> set[str]:
    """Return the one middleware there is."""
    return {get_rmw_implementation_identifier()}


def timeout_sec_to_nsec(timeout_sec: float | None) -> int:
    """Convert seconds to nanoseconds; None and negative mean for ever, which is -1."""
    return -1 if timeout_sec is None or timeout_sec < 0 else int(float(timeout_sec) * S_TO_NS)
