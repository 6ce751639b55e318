"""Helpers around the default context and the command line."""

import inspect
import time
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.arguments import parse
from rclpy.constants import S_TO_NS
from rclpy.context import Context, context_or_default
from rclpy.context import get_default_context as get_default_context

# How often it is looked whether something is there that no event tells of.
_POLL_S = 0.01


def remove_ros_args(args: Sequence[str] | None = None) -> list[str]:
    return parse(args).remaining


def ok(*, context: Context | None = None) -> bool:
    """Return whether a context (default: the global one) is initialized and not shut down."""
    return context_or_default(context).ok()


def shutdown(*, context: Context | None = None) -> None:
    (get_default_context(shutting_down=True) if context is None else context).shutdown()


def try_shutdown(*, context: Context | None = None) -> None:
    """Shut down a context (default: the global one) unless it is shut down already."""
    (get_default_context(shutting_down=True) if context is None else context).try_shutdown()


def get_rmw_implementation_identifier() -> str:
    """Return the middleware this runtime is compatible with."""
    return "rmw_cyclonedds_cpp"


def get_available_rmw_implementations() -> set[str]:
    return {get_rmw_implementation_identifier()}


def timeout_sec_to_nsec(timeout_sec: float | None) -> int:
    """Convert seconds to nanoseconds; None and negative values mean no limit, which is -1."""
    return -1 if timeout_sec is None or timeout_sec < 0 else int(float(timeout_sec) * S_TO_NS)


def wait_until(condition: Callable[[], Any], timeout_sec: float | None, context: Context | None = None) -> bool:
    """Wait in this thread until a condition is true; return whether it is.

    Without a timeout there is no limit, and a negative one means 0; the shutdown of the `context` ends the wait.
    """
    end = None if timeout_sec is None else time.monotonic() + timeout_sec
    while not condition():
        if (context is not None and not context.ok()) or (end is not None and time.monotonic() >= end):
            return False
        time.sleep(_POLL_S)
    return True


def takes(callback: Callable[..., Any], arguments: int) -> bool:
    """Return whether a callback accepts this number of arguments; True if it has no signature."""
    try:
        inspect.signature(callback).bind(*range(arguments))
    except TypeError:
        return False
    except ValueError:  # a function in C without a signature
        return True
    return True
