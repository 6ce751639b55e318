"""Futures, and the tasks an executor runs."""

from __future__ import annotations

import inspect
import sys
import threading
import warnings
import weakref
from collections.abc import Callable, Coroutine, Generator
from typing import Any


class Future:
    """The result of an operation that may still be under way. Awaitable in callbacks and tasks."""

    def __init__(self, *, executor: Any = None) -> None:
        self._done = False
        self._cancelled = False
        self._result: Any = None
        self._exception: BaseException | None = None
        self._exception_fetched = False
        self._callbacks: list[Callable[[Future], Any]] = []
        # Called at once and in the thread that completes the future: must only wake an executor or a thread.
        self._wakers: list[Callable[[], None]] = []
        self._lock = threading.Lock()
        self._set_executor(executor)

    def __del__(self) -> None:
        if self._exception is not None and not self._exception_fetched:
            print(f"The following exception was never retrieved: {self._exception}", file=sys.stderr)

    def __await__(self) -> Generator[Future, None, Any]:
        while not self._done:
            yield self
        return self.result()

    def cancel(self) -> None:
        """Request cancellation, unless it is done already."""
        with self._lock:
            if not self._done:
                self._cancelled = True
        self._run_callbacks()

    def cancelled(self) -> bool:
        return self._cancelled

    def done(self) -> bool:
        return self._done

    def result(self) -> Any:
        """Return the result (None while there is none), or raise the exception it ended with."""
        if self._exception is not None:
            self._exception_fetched = True
            raise self._exception
        return self._result

    def exception(self) -> BaseException | None:
        self._exception_fetched = True
        return self._exception

    def set_result(self, result: Any) -> None:
        self._result = result
        self._finish()

    def set_exception(self, exception: BaseException) -> None:
        self._exception = exception
        self._exception_fetched = False
        self._finish()

    def _finish(self) -> None:
        with self._lock:
            self._done = True
            self._cancelled = False
        self._run_callbacks()

    def _run_callbacks(self) -> None:
        with self._lock:
            executor = self._executor()
            callbacks, self._callbacks = self._callbacks, []
            wakers, self._wakers = self._wakers, []
        for waker in wakers:
            waker()
        for callback in callbacks:
            if executor is not None:
                executor.create_task(callback, self)
                continue
            try:
                callback(self)
            except Exception as error:  # the other callbacks still have to run
                warnings.warn(f"Unhandled exception in done callback: {error}", stacklevel=2)

    def _set_executor(self, executor: Any) -> None:
        self._executor: Callable[[], Any] = (lambda: None) if executor is None else weakref.ref(executor)

    def _add_waker(self, waker: Callable[[], None]) -> None:
        with self._lock:
            if not self._done:
                if waker not in self._wakers:
                    self._wakers.append(waker)
                return
        waker()

    def _wait(self, timeout_sec: float | None = None) -> Any:
        """Wait in this thread until it is done, and return its result; None if it is not done in time."""
        event = threading.Event()
        self._add_waker(event.set)
        event.wait(timeout_sec)
        return self.result()

    def add_done_callback(self, callback: Callable[[Future], Any]) -> None:
        """Call `callback` with this future when it is done; at once if it is done already."""
        with self._lock:
            if not self._done:
                self._callbacks.append(callback)
                return
            executor = self._executor()
        if executor is not None:
            executor.create_task(callback, self)
        else:
            callback(self)


class Task(Future):
    """A function or coroutine that an executor runs; created by executors only."""

    def __init__(
        self,
        handler: Callable[..., Any] | Coroutine[Any, Any, Any],
        args: Any = None,
        kwargs: Any = None,
        executor: Any = None,
    ) -> None:
        super().__init__(executor=executor)
        self._handler: Any = handler
        self._args = args or ()
        self._kwargs = kwargs or {}
        if inspect.iscoroutinefunction(handler):
            self._handler = handler(*self._args, **self._kwargs)
        # False while it awaits a future that is not done: then there is no point in resuming it.
        self._resumable = True
        self._running = threading.Lock()

    def __call__(self) -> None:
        if self._done or not self._running.acquire(blocking=False):
            return
        try:
            if not self._done:
                self._run()
        except Exception as error:
            self._handler = None
            self.set_exception(error)
        finally:
            self._running.release()

    def _run(self) -> None:
        if inspect.iscoroutine(self._handler):
            try:
                awaited = self._handler.send(None)
            except StopIteration as stop:
                result = stop.value
            else:
                if isinstance(awaited, Future):
                    self._resumable = False
                    awaited._add_waker(self._wake)
                return
        else:
            result = self._handler(*self._args, **self._kwargs)
        self._handler, self._args, self._kwargs = None, (), {}
        self.set_result(result)

    def _wake(self) -> None:
        self._resumable = True
        executor = self._executor()
        if executor is not None:
            executor.wake()

    def executing(self) -> bool:
        return self._running.locked()
