"""Executors: wait for work and run callbacks."""

from __future__ import annotations

import inspect
import os
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from typing import Any

from cyclonedds.core import DDSException
from rclpy._rclpy_pybind11 import RCLError
from rclpy.constants import INT64_MAX
from rclpy.context import Context, context_or_default
from rclpy.exceptions import InvalidHandle, NotInitializedException
from rclpy.impl.wait_set import WaitSet
from rclpy.task import Future, Task
from rclpy.utilities import timeout_sec_to_nsec

# Waitables are asked when nothing else explains a wake-up, and at least this often under constant traffic.
_WAITABLE_PERIOD_NS = 20_000_000
# How often discovery data are taken.
_TIDY_PERIOD_NS = 1_000_000_000
# How often a coroutine is resumed that waits for something other than a Future.
_POLL_NS = 1_000_000


async def await_or_execute(callback: Callable[..., Any] | Coroutine[Any, Any, Any], *args: Any) -> Any:
    """Call a function, or await a coroutine function."""
    if inspect.iscoroutinefunction(callback):
        return await callback(*args)
    return callback(*args)  # type: ignore[operator]


class TimeoutException(Exception):  # noqa: N818
    """Nothing was ready in time."""


class ShutdownException(Exception):  # noqa: N818
    """The executor was shut down."""


class ExternalShutdownException(Exception):  # noqa: N818
    """The context was shut down."""


class ConditionReachedException(Exception):  # noqa: N818
    """The future is done."""


class _Entities:
    """What an executor waits for: entities of its nodes whose callback group lets them start, and its wait set."""

    def __init__(self, wait_set: WaitSet) -> None:
        self.changed = True
        #: whether a callback group keeps an entity out
        self.blocked = False
        self._wait_set = wait_set
        # Timers and guard conditions, which are ready without a condition of DDS; those of waitables; both.
        self._timed: list[tuple[Any, Any]] = []
        self._added_timed: list[Any] = []
        self._all_timed: list[Any] = []
        self._readers: list[tuple[Any, Any]] = []
        self._waitables: list[tuple[Any, Any]] = []
        self._waitables_seen_ns = 0

    def collect(self, nodes: list[Any], can_execute: Callable[[Any], bool]) -> None:
        """Collect the entities again."""
        self.changed = False
        self.blocked = False
        self._timed, self._readers, self._waitables, self._wait_set.added = [], [], [], []
        for node in nodes:
            for target, entities in (
                (self._timed, [*node.timers, *node.guards]),
                (self._readers, [*node.subscriptions, *node.clients, *node.services]),
                (self._waitables, list(node.waitables)),
            ):
                for entity in entities:
                    if can_execute(entity):
                        target.append((entity, node))
                    else:
                        self.blocked = True
        for waitable, _ in self._waitables:
            waitable.add_to_wait_set(self._wait_set)
        self._added_timed = [entity for entity in self._wait_set.added if entity.condition is None]
        self._all_timed = [*self._added_timed, *(entity for entity, _ in self._timed)]
        waking = [*(entity for entity, _ in self._readers), *self._wait_set.added]
        self._wait_set.update([entity.condition for entity in waking if entity.condition is not None])

    def wait(self, timeout_ns: int) -> list[tuple[Any, Any]]:
        """Wait until something is ready, at most a time; return the ready entities with their nodes."""
        waits = [wait_ns for entity in self._all_timed if (wait_ns := entity._wait_ns()) is not None]
        triggered = self._wait_set.wait(min(timeout_ns, *waits) if waits else timeout_ns)
        timed = [one for one in self._timed if one[0]._wait_ns() == 0]
        # Each look at a condition is a call of Cyclone DDS: none after the last that has been triggered.
        ready = list(islice((one for one in self._readers if one[0].condition.is_triggered()), triggered))
        now = time.monotonic_ns()
        unexplained = len(ready) < triggered or any(entity._wait_ns() == 0 for entity in self._added_timed)
        if not unexplained and now - self._waitables_seen_ns <= _WAITABLE_PERIOD_NS:
            return timed + ready
        self._waitables_seen_ns = now
        waitables = [one for one in self._waitables if one[0].is_ready(self._wait_set)]
        return waitables[::-1] + timed + ready


class Executor:
    """Base class of the executors."""

    def __init__(self, *, context: Context | None = None) -> None:
        self.context = context_or_default(context)
        if self.context.handle is None:
            raise NotInitializedException("cannot create executor")
        self._nodes: dict[Any, None] = {}
        self._lock = threading.RLock()
        self._tasks: list[Task] = []
        # Tasks that run before the next wait, the newest at the end; None once they have run.
        self._due: list[Task] | None = None
        self._ready: deque[tuple[Any, Any]] = deque()
        with self.context.session.using("failed to create executor"):
            self._wait_set = WaitSet(self.context.session)
        self._is_shutdown = False
        self._working = threading.RLock()
        self._entities = _Entities(self._wait_set)
        self._tidied_ns = 0
        self.context._wakers.add(self)

    def create_task(self, callback: Callable[..., Any] | Coroutine[Any, Any, Any], *args: Any, **kwargs: Any) -> Task:
        """Run a function or coroutine while spinning; the returned task is a future of its result.

        Every task runs once between two waits, the newest first.
        """
        task = Task(callback, args, kwargs, executor=self)
        with self._lock:
            self._tasks.append(task)
        self.wake()
        return task

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Shut down; return whether a running callback finished in time."""
        self._is_shutdown = True
        self.wake()
        timeout = -1 if timeout_sec is None or timeout_sec < 0 else timeout_sec
        if not self._working.acquire(timeout=timeout):
            return False
        try:
            with self._lock:
                for node in list(self._nodes):
                    self.remove_node(node)
                self.context._wakers.discard(self)
                self._wait_set.close()
        finally:
            self._working.release()
        return True

    def __del__(self) -> None:
        try:
            self._wait_set.close()
        except (AttributeError, TypeError):  # never made, or the interpreter is ending and half of it is gone
            pass

    def add_node(self, node: Any) -> bool:
        """Add a node; return whether it is new to this executor."""
        with self._lock:
            if node in self._nodes:
                return False
            self._nodes[node] = None
            node.executor = self
        self._notice()
        return True

    def remove_node(self, node: Any) -> None:
        with self._lock:
            if node not in self._nodes:
                return
            del self._nodes[node]
        self._notice()

    def get_nodes(self) -> list[Any]:
        with self._lock:
            return list(self._nodes)

    def wake(self) -> None:
        """End the present wait, so that changes take effect."""
        self._wait_set.wake()

    def _notice(self) -> None:
        self._entities.changed = True
        self.wake()

    # Spinning

    def spin(self) -> None:
        while self.context.ok() and not self._is_shutdown:
            self.spin_once()

    def spin_until_future_complete(self, future: Future, timeout_sec: float | None = None) -> None:
        """Run callbacks until a future is done or the time is over."""
        end = None if timeout_sec is None or timeout_sec < 0 else time.monotonic() + timeout_sec
        while self.context.ok() and not future.done() and not self._is_shutdown:
            self.spin_once_until_future_complete(future, timeout_sec)
            if end is not None:
                timeout_sec = end - time.monotonic()
                if timeout_sec <= 0:
                    return

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait for one callback and run it, without a limit by default; with 0, only if one is ready.

        An exception that the callback raises comes out here.
        """
        self._spin_once(timeout_sec, lambda: False)

    def spin_once_until_future_complete(self, future: Future, timeout_sec: float | None = None) -> None:
        """Wait for one callback and run it, unless the future is done first."""
        future._add_waker(self.wake)
        self._spin_once(timeout_sec, future.done)

    def _spin_once(self, timeout_sec: float | None, condition: Callable[[], bool]) -> None:
        with self._working:
            try:
                task, entity, _ = self.wait_for_ready_callbacks(timeout_sec, None, condition)
            except (ShutdownException, TimeoutException, ConditionReachedException):
                return
            task()
            if entity is not None and not task.done():
                with self._lock:
                    self._tasks.append(task)
                # The group may be closed to its other entities now: do not wait for those.
                self._entities.changed = True
            if task.exception() is not None:
                raise task.exception()  # type: ignore[misc]

    # Waiting

    def can_execute(self, entity: Any) -> bool:
        """Return whether the callback group of an entity allows it to start."""
        return bool(entity.callback_group.can_execute(entity))

    def wait_for_ready_callbacks(
        self,
        timeout_sec: float | None = None,
        nodes: list[Any] | None = None,
        condition: Callable[[], bool] = lambda: False,
    ) -> tuple[Task, Any, Any]:
        """Wait for a callback; return the task that runs it, its entity and its node."""
        timeout_ns = timeout_sec_to_nsec(timeout_sec)
        deadline = INT64_MAX if timeout_ns < 0 else time.monotonic_ns() + timeout_ns
        looked = False
        while True:
            if self._is_shutdown:
                raise ShutdownException()
            if condition():
                raise ConditionReachedException()
            work = self._next(nodes)
            if work is not None:
                return work
            remaining = max(0, deadline - time.monotonic_ns())
            if looked and remaining == 0:
                raise TimeoutException()
            looked = True
            try:
                self._collect(remaining)
            except DDSException:
                # An entity was destroyed by another thread between two calls, or the participant is gone.
                self._entities.changed = True
                if self.context.session._closed:
                    raise ExternalShutdownException() from None
            if not self.context.ok() and not self._is_shutdown:
                raise ExternalShutdownException()

    def _next(self, nodes: list[Any] | None) -> tuple[Task, Any, Any] | None:
        while self._ready:
            entity, node = self._ready.popleft()
            if node in self._nodes and (nodes is None or node in nodes) and self.can_execute(entity):
                made = self._task_of(entity)
                if made is not None:
                    return made, entity, node
        if self._due is None:
            self._due = []
            if self._tasks:
                with self._lock:
                    self._tasks = [task for task in self._tasks if not task.done()]
                    self._due = [task for task in self._tasks if task._resumable]
        while self._due:
            task = self._due.pop()
            if task._resumable and not task.done() and not task.executing():
                return task, None, None
        return None

    def _task_of(self, entity: Any) -> Task | None:
        """Take what there is for an entity's callback; None if that is nothing or the callback must not start.

        Taken in the thread that waits: otherwise the same message would wake it again before another one takes it.
        """
        group, callback = entity.callback_group, None
        if not group.beginning_execution(entity):
            return None
        try:
            callback = entity._take()
        except (InvalidHandle, RCLError):  # destroyed in the meantime
            return None
        finally:
            if callback is None:
                group.ending_execution(entity)
        return None if callback is None else Task(self._call(callback, entity), executor=self)

    async def _call(self, callback: Callable[[], Any], entity: Any) -> None:
        try:
            for future in getattr(entity, "_futures", ()):
                future._set_executor(self)
            result = callback()
            if inspect.iscoroutine(result):
                await result
        finally:
            entity.callback_group.ending_execution(entity)
            if self._entities.blocked:
                self._entities.changed = True

    def _collect(self, timeout_ns: int) -> None:
        """Wait until something is ready, and queue it."""
        if self._entities.changed:
            self._entities.collect(self.get_nodes(), self.can_execute)
        if self._tasks and any(task._resumable and not task.executing() for task in self._tasks):
            timeout_ns = min(timeout_ns, _POLL_NS)
        ready = self._entities.wait(timeout_ns)
        self._due = None
        self._ready.extend(ready)
        if (now := time.monotonic_ns()) - self._tidied_ns > _TIDY_PERIOD_NS:
            self._tidied_ns = now
            self.context.session.graph.tidy()

    def __enter__(self) -> Executor:
        return self

    def __exit__(self, *_: Any) -> None:
        self.shutdown()


class SingleThreadedExecutor(Executor):
    """Runs callbacks in the thread that spins."""


class MultiThreadedExecutor(Executor):
    """Waits in the thread that spins and runs callbacks in a pool of threads.

    Callbacks of a `ReentrantCallbackGroup`, and those of different groups, overlap. An exception of a callback comes
    out of the thread that spins.

    Parameters
    ----------
    num_threads : int, optional
        How many callbacks may run at a time; as many as the process has processors by default.
    context : Context, optional
    """

    def __init__(self, num_threads: int | None = None, *, context: Context | None = None) -> None:
        super().__init__(context=context)
        if num_threads == 1:
            warnings.warn(
                "MultiThreadedExecutor is used with a single thread. Use the SingleThreadedExecutor instead.",
                stacklevel=2,
            )
        self._executor = ThreadPoolExecutor(num_threads or len(os.sched_getaffinity(0)), "rclpy")
        # The tasks in the pool, each with its thread as soon as it runs.
        self._at_work: dict[Task, int] = {}
        self._finished = threading.Condition()
        self._failed: deque[Task] = deque()

    def shutdown(self, timeout_sec: float | None = None, *, wait_for_threads: bool = True) -> bool:
        """Shut down; return whether all running callbacks finished in time.

        Without `wait_for_threads` the threads may end later. A callback that calls this does not wait for itself.
        """
        self._is_shutdown = True
        self.wake()
        timeout = None if timeout_sec is None or timeout_sec < 0 else timeout_sec
        own = threading.get_ident()
        with self._finished:
            if not self._finished.wait_for(lambda: not set(self._at_work.values()) - {own}, timeout):
                return False
        inside = own in self._at_work.values()
        self._executor.shutdown(wait=wait_for_threads and not inside)
        return super().shutdown(timeout_sec)

    def _spin_once(self, timeout_sec: float | None, condition: Callable[[], bool]) -> None:
        with self._working:
            try:
                task, entity, _ = self.wait_for_ready_callbacks(
                    timeout_sec, None, lambda: condition() or bool(self._failed)
                )
                if entity is not None and not self.can_execute(entity):
                    self._entities.changed = True  # nor any other of its group: do not wait for those
                self._submit(task)
            except (ShutdownException, TimeoutException, ConditionReachedException):
                pass
            if self._failed:
                raise self._failed.popleft().exception()  # type: ignore[misc]

    def _submit(self, task: Task) -> None:
        task._resumable = False  # not twice
        with self._finished:
            self._at_work[task] = 0
        try:
            self._executor.submit(self._work, task)
        except RuntimeError:  # shut down in the meantime
            self._end(task)

    def _work(self, task: Task) -> None:
        with self._finished:
            self._at_work[task] = threading.get_ident()
        task._resumable = True
        try:
            task()
        except BaseException as error:  # SystemExit, too, belongs to the thread that spins
            task.set_exception(error)
        if not task.done():
            with self._lock:
                if task not in self._tasks:
                    self._tasks.append(task)
        elif task._exception is not None:
            self._failed.append(task)
        self._end(task)

    def _end(self, task: Task) -> None:
        with self._finished:
            del self._at_work[task]
            self._finished.notify_all()
        self._entities.changed = True  # its group may be open again
        self.wake()
