"""A context: what happens between init and shutdown."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from inspect import ismethod
from types import MethodType
from typing import TYPE_CHECKING, Any
from weakref import WeakMethod, WeakSet

from rclpy import logging
from rclpy._rclpy_pybind11 import RCLError

if TYPE_CHECKING:
    from rclpy.arguments import Arguments
    from rclpy.impl.session import Session

_initialized: WeakSet[Context] = WeakSet()


class Context:
    """The lifecycle of init and shutdown; each context is a participant of its own in the graph."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._callbacks: list[WeakMethod[MethodType] | Callable[[], None]] = []
        self._session: Session | None = None
        self._arguments: Arguments | None = None
        # A signal came, and its shutdown is under way in another thread.
        self._interrupted = False
        # After a signal, executors have to report the shutdown as external.
        self._signaled = False
        self._nodes: WeakSet[Any] = WeakSet()
        self._wakers: WeakSet[Any] = WeakSet()

    def init(
        self, args: list[str] | None = None, *, initialize_logging: bool = True, domain_id: int | None = None
    ) -> None:
        """Initialize communication.

        Parameters
        ----------
        args : list of str, optional
            Command line, ``sys.argv`` by default; what follows ``--ros-args`` applies to all nodes of this context.
        initialize_logging : bool
            Whether log levels of the command line are applied.
        domain_id : int, optional
            DDS domain; ROS_DOMAIN_ID by default.

        Raises
        ------
        RuntimeError
            If it was initialized before or the domain is out of range.
        """
        from rclpy.arguments import parse
        from rclpy.impl import discovery
        from rclpy.impl.session import Session

        with self._lock:
            if domain_id is not None and domain_id < 0:
                raise RuntimeError(f"Domain id ({domain_id}) should not be lower than zero.")
            if self._session is not None:
                raise RuntimeError("Context.init() must only be called once")
            self._arguments = parse(list(sys.argv) if args is None else list(args))
            if initialize_logging and not _initialized:
                logging.configure(self._arguments)
            domain = discovery.domain_id() if domain_id is None else domain_id
            self._session = Session(domain, self._arguments.enclave or "/")
            _initialized.add(self)

    @property
    def arguments(self) -> Arguments:
        """The parsed command line."""
        assert self._arguments is not None
        return self._arguments

    @property
    def session(self) -> Session:
        """The DDS side of this context."""
        if self._session is None:
            raise RuntimeError("Context must be initialized before it can be used")
        return self._session

    @property
    def handle(self) -> Session | None:
        """What the middleware knows this context by; None before init."""
        return self._session

    def ok(self) -> bool:
        """Return whether it is initialized and not shut down."""
        return self._session is not None and not self._session.is_shut_down and not self._interrupted

    def get_domain_id(self) -> int:
        """Return the DDS domain.

        Raises
        ------
        RuntimeError
            Before init.
        """
        if self._session is None:
            raise RuntimeError("Context must be initialized before it can have a domain id")
        return self._session.domain_id

    def shutdown(self) -> None:
        """Shut it down.

        Raises
        ------
        RuntimeError
            If it is not initialized (RuntimeError) or was shut down before (RCLError).
        """
        if self._session is None:
            raise RuntimeError("Context must be initialized before it can be shutdown")
        if not self._shutdown():
            raise RCLError("failed to shutdown: rcl_shutdown already called on the given context")

    def try_shutdown(self) -> None:
        """Shut it down unless that was done already."""
        self._shutdown()

    def destroy(self) -> None:
        """Shut it down and leave the graph, with whatever nodes are left."""
        self._shutdown()
        if self._session is not None:
            self._session.close()

    def _shutdown(self, *, by_signal: bool = False) -> bool:
        with self._lock:
            if self._session is None or self._session.is_shut_down:
                return False
            self._session.is_shut_down = True
            self._signaled = by_signal
            _initialized.discard(self)
            if not _initialized:
                logging.finish()
            callbacks, self._callbacks = self._callbacks, []
        for entry in callbacks:
            callback = entry() if isinstance(entry, WeakMethod) else entry
            if callback is not None:
                callback()
        self._wake_all()
        self._close_when_unused()
        return True

    def _close_when_unused(self) -> None:
        """Leave the graph once it is shut down and its last node is destroyed."""
        if self._session is not None and self._session.is_shut_down and not self._nodes:
            self._session.close()

    def _wake_all(self) -> None:
        for waker in list(self._wakers):
            waker.wake()

    def on_shutdown(self, callback: Callable[[], None]) -> None:
        """Have `callback` called at shutdown; at once if that has happened. Methods are held weakly.

        Raises
        ------
        TypeError
            If it is not callable.
        """
        if not callable(callback):
            raise TypeError(f"callback should be a callable, got {type(callback)}")
        with self._lock:
            if self._session is None or not self._session.is_shut_down:
                self._callbacks.append(WeakMethod(callback) if ismethod(callback) else callback)
                return
        callback()

    def __enter__(self) -> Context:
        self.init()
        return self

    def __exit__(self, *_: Any) -> None:
        self.try_shutdown()


def interrupt_all() -> None:
    """Let no context be ok any more; takes no lock, so a signal handler may call it."""
    for context in list(_initialized):
        context._interrupted = True


def shutdown_all() -> None:
    """Shut down every context because of a signal."""
    for context in list(_initialized):
        context._shutdown(by_signal=True)
