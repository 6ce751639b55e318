"""The global context of the process."""

import threading

from rclpy.context import Context

_context: Context | None = None
lock = threading.RLock()


def get_default_context(*, shutting_down: bool = False) -> Context:
    """Return the global default context; with `shutting_down` the next call makes a new one."""
    global _context
    with lock:
        context = _context or Context()
        _context = None if shutting_down else context
        return context


def context_or_default(context: Context | None) -> Context:
    """Return the context, or the global one instead of None."""
    return get_default_context() if context is None else context
