"""Contexts: everything between init and shutdown."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from contextlib import ExitStack
from inspect import ismethod
from types import MethodType
from typing import Any
from weakref import WeakMethod

from rclpy._rclpy_pybind11 import RCLError
from rclpy.arguments import Arguments, parse
from rclpy.impl import discovery
from rclpy.impl.handle import WeakMembers
from rclpy.impl.logging_output import system
from rclpy.impl.session import Session

initialized: WeakMembers[Context] = WeakMembers()
_default: Context | None = None
default_lock = threading.RLock()


class Context:
    """The lifecycle of init and shutdown; each context is a participant of its own in the graph."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._callbacks: list[WeakMethod[MethodType] | Callable[[], None]] = []
        self._session: Session | None = None
        self.arguments = Arguments()
        # A signal came: the shutdown, which executors have to report as external, is under way in another thread.
        self._interrupted = False
        self._nodes: WeakMembers[Any] = WeakMembers()
        self._wakers: WeakMembers[Any] = WeakMembers()

    def init(
        self, args: list[str] | None = None, *, initialize_logging: bool = True, domain_id: int | None = None
    ) -> None:
        """Initialize communication.

        What follows ``--ros-args`` in `args` (``sys.argv`` by default) applies to all nodes of this context. The DDS
        domain is `domain_id` or ROS_DOMAIN_ID.
        """
        with self._lock:
            if domain_id is not None and domain_id < 0:
                raise RuntimeError(f"Domain id ({domain_id}) should not be lower than zero.")
            if self._session is not None:
                raise RuntimeError("Context.init() must only be called once")
            self.arguments = parse(list(sys.argv) if args is None else list(args))
            if initialize_logging and not initialized:
                system.configure(self.arguments)
            domain_id = discovery.domain_id() if domain_id is None else domain_id
            self._session = Session(domain_id, self.arguments.enclave or "/")
            initialized.add(self)

    @property
    def session(self) -> Session:
        """The DDS side of this context."""
        if self._session is None:
            raise RuntimeError("Context must be initialized before it can be used")
        return self._session

    @property
    def handle(self) -> Session | None:
        """The DDS side of this context; None before init."""
        return self._session

    def ok(self) -> bool:
        return self._session is not None and not self._session.is_shut_down and not self._interrupted

    def get_domain_id(self) -> int:
        return self.session.domain_id

    def shutdown(self) -> None:
        """Shut it down; RCLError if it is shut down already."""
        if self._session is None:
            raise RuntimeError("Context must be initialized before it can be shutdown")
        if not self._shutdown():
            raise RCLError("failed to shutdown: rcl_shutdown already called on the given context")

    def try_shutdown(self) -> None:
        self._shutdown()

    def destroy(self) -> None:
        """Shut it down and leave the graph, even if it still has nodes."""
        self._shutdown()
        if self._session is not None:
            self._session.close()

    def _shutdown(self) -> bool:
        with self._lock:
            if self._session is None or self._session.is_shut_down:
                return False
            self._session.is_shut_down = True
            initialized.discard(self)
            if not initialized:
                system.finish()
            callbacks, self._callbacks = self._callbacks, []
        with ExitStack() as stack:  # all of it, whatever a callback raises; the last one that is added comes first
            stack.callback(self._close_when_unused)
            stack.callback(self._wake_all)
            for entry in reversed(callbacks):
                if (callback := _alive(entry)) is not None:
                    stack.callback(callback)
        return True

    def _close_when_unused(self) -> None:
        """Leave the graph once it is shut down and its last node is destroyed."""
        if self._session is not None and self._session.is_shut_down and not self._nodes:
            self._session.close(wait=False)

    def _wake_all(self) -> None:
        for waker in self._wakers:
            waker.wake()

    def on_shutdown(self, callback: Callable[[], None]) -> None:
        """Call `callback` at shutdown, or at once if it is shut down already. Methods are held weakly."""
        if not callable(callback):
            raise TypeError(f"callback should be a callable, got {type(callback)}")
        with self._lock:
            if self._session is None or not self._session.is_shut_down:
                # Those of objects that are gone would pile up, e.g. one for each sleep.
                self._callbacks = [entry for entry in self._callbacks if _alive(entry) is not None]
                self._callbacks.append(WeakMethod(callback) if ismethod(callback) else callback)
                return
        callback()

    def __enter__(self) -> Context:
        self.init()
        return self

    def __exit__(self, *_: Any) -> None:
        self.try_shutdown()


def _alive(entry: WeakMethod[MethodType] | Callable[[], None]) -> Callable[[], None] | None:
    return entry() if isinstance(entry, WeakMethod) else entry


def get_default_context(*, shutting_down: bool = False) -> Context:
    """Return the global default context; with `shutting_down` the next call makes a new one."""
    global _default
    with default_lock:
        context = _default or Context()
        _default = None if shutting_down else context
        return context


def context_or_default(context: Context | None) -> Context:
    return get_default_context() if context is None else context
