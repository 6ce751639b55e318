"""Threads and signals that come between any two lines: shutdown, destruction and creation while something else runs."""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import FrameType, SimpleNamespace
from typing import Any

import pytest
import rclpy
from cyclonedds.core import DDSException
from rclpy import signals
from rclpy._rclpy_pybind11 import InvalidHandle, RCLError
from rclpy.action import ActionClient, ActionServer
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.exceptions import NotInitializedException
from rclpy.executors import ExternalShutdownException, ShutdownException, SingleThreadedExecutor
from rclpy.impl import session
from rclpy.impl.wait_set import WaitSet
from std_msgs.msg import String
from std_srvs.srv import SetBool
from test_msgs.action import Fibonacci

SOURCES = (str(Path(rclpy.__file__).parent), "_weakrefset")
#: What an operation may end with when its entity or its context goes meanwhile.
EXPECTED = (InvalidHandle, RCLError, NotInitializedException, ExternalShutdownException, ShutdownException)


def _world(context: Context) -> SimpleNamespace:
    node = rclpy.create_node("raced", context=context, enable_rosout=False, start_parameter_services=False)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    publisher, timer = node.create_publisher(String, "chat", 10), node.create_timer(10.0, lambda: None)
    subscription = node.create_subscription(String, "chat", lambda _: None, 10)
    client = node.create_client(SetBool, "set")
    return SimpleNamespace(
        context=context,
        node=node,
        executor=executor,
        publisher=publisher,
        subscription=subscription,
        timer=timer,
        client=client,
        kept=[],
    )


OPERATIONS: dict[str, Callable[[SimpleNamespace], Any]] = {
    "publish": lambda world: world.publisher.publish(String(data="x")),
    "take": lambda world: world.subscription.take(),
    "count subscriptions": lambda world: world.publisher.get_subscription_count(),
    "count publishers": lambda world: world.subscription.get_publisher_count(),
    "look for a server": lambda world: world.client.service_is_ready(),
    "look at the graph": lambda world: world.node.get_node_names(),
    "reset a timer": lambda world: world.timer.reset(),
    "create a guard condition": lambda world: world.node.create_guard_condition(lambda: None).trigger(),
    "create an action server": lambda world: ActionServer(world.node, Fibonacci, "weld", lambda _: None),
    "create an action client": lambda world: ActionClient(world.node, Fibonacci, "weld"),
    "destroy a subscription": lambda world: world.node.destroy_subscription(world.subscription),
    "spin": lambda world: world.executor.spin_once(timeout_sec=0),
}
EVENTS: dict[str, Callable[[SimpleNamespace], Any]] = {
    "shutdown": lambda world: world.context.try_shutdown(),
    "shutdown of the executor": lambda world: world.executor.shutdown(0),
    "end of the context": lambda world: world.context.destroy(),
    "end of the node": lambda world: world.node.destroy_node(),
    "end of the subscription": lambda world: world.node.destroy_subscription(world.subscription),
    "another executor": lambda world: world.kept.append(SingleThreadedExecutor(context=world.context)),
}

_RECEIVING = ("take", "count publishers", "destroy a subscription", "spin")
_QUICK = [
    ("take", "end of the subscription"),
    ("count subscriptions", "end of the node"),
    ("look for a server", "end of the context"),
    ("reset a timer", "another executor"),
]
PAIRS = [
    *_QUICK,
    *(
        pytest.param(operation, event, marks=pytest.mark.full)
        for operation in OPERATIONS
        for event in ("end of the context", "end of the node", "end of the subscription")
        if (operation, event) not in _QUICK and (operation in _RECEIVING or event != "end of the subscription")
    ),
    pytest.param("spin", "shutdown", marks=pytest.mark.full),
    pytest.param("spin", "shutdown of the executor", marks=pytest.mark.full),
]


def _at_line(number: int, operation: Callable[[], Any], event: Callable[[], Any]) -> tuple[bool, list[BaseException]]:
    """Run an operation in a thread, and an event in another one before the line of that number.

    Returns whether there was such a line, and unexpected errors. If the event has to wait for the operation, e.g. for a
    lock, the operation goes on first.
    """
    errors: list[BaseException] = []
    lines, others = 0, []

    def guarded(work: Callable[[], Any]) -> None:
        try:
            work()
        except EXPECTED:
            pass
        except BaseException as error:
            errors.append(error)

    def trace(frame: FrameType, what: str, _: Any) -> Any:
        nonlocal lines
        if not any(source in frame.f_code.co_filename for source in SOURCES):
            return None
        if what == "line":
            lines += 1
            if lines == number + 1:
                others.append(threading.Thread(target=guarded, args=(event,), daemon=True))
                others[0].start()
                others[0].join(0.05)
        return trace

    def traced() -> None:
        sys.settrace(trace)
        try:
            guarded(operation)
        finally:
            sys.settrace(None)

    thread = threading.Thread(target=traced, daemon=True)
    thread.start()
    for either in (thread, *others):
        either.join(60.0)
        assert not either.is_alive(), f"line {number}: a deadlock"
    for other in others:
        other.join(60.0)
        assert not other.is_alive(), f"line {number}: a deadlock"
    return bool(others), errors


#: Events after which a context cannot be used again, so that each line needs another one; of many lines only some are
#: tried then. Cyclone DDS 11.0.1 deletes topics in a thread of its own, some time after their context has ended, and
#: crashes now and then if others are made meanwhile.
_FINAL = ("shutdown", "shutdown of the executor", "end of the context")


@pytest.mark.parametrize(("operation", "event"), PAIRS)
def test_something_else_happens_between_any_two_lines(
    domain_id: int, context: Context, operation: str, event: str
) -> None:
    def fresh() -> Context:
        other = Context()  # the fixture's context keeps the domain
        other.init(args=[], domain_id=domain_id)
        return other

    lasting = None if event in _FINAL else fresh()

    def race(number: int) -> bool:
        other = lasting or fresh()
        world = _world(other)
        try:
            was_there, errors = _at_line(number, lambda: OPERATIONS[operation](world), lambda: EVENTS[event](world))
        finally:
            world.node.destroy_node()
            if lasting is None:
                other.destroy()
        assert errors == [], f"{event} before line {number} of {operation}"
        return was_there

    try:
        assert race(0)
        number = 1
        while race(number):  # until there are no more lines
            number += max(1, number // (10 if event in _FINAL else 100))
    finally:
        if lasting is not None:
            lasting.destroy()


class WatchedLock:
    """A reentrant lock that tells when somebody has to wait for it."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self.waited_for = threading.Event()

    def __enter__(self) -> None:
        if not self._lock.acquire(blocking=False):
            self.waited_for.set()
            self._lock.acquire()

    def __exit__(self, *_: Any) -> None:
        self._lock.release()


def test_no_topic_is_deleted_while_another_one_is_made(
    context: Context, node: Any, domain_id: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cyclone DDS 11.0.1 crashes then: it reads its table of types without a lock."""
    other, lock, order = Context(), WatchedLock(), []
    other.init(args=[], domain_id=domain_id)
    monkeypatch.setattr(session, "_topics_lock", lock)
    delete, closing = session.delete, threading.Thread(target=other.destroy)

    def record(entity: Any) -> None:
        if entity is other.session.participant or entity in other.session._topics.values():
            order.append("deleted")
        delete(entity)

    class SlowTopic(session.Topic):  # type: ignore[misc, type-arg]
        def __init__(self, *args: Any) -> None:
            closing.start()
            assert lock.waited_for.wait(60.0)
            super().__init__(*args)
            order.append("made")

    monkeypatch.setattr(session, "delete", record)
    monkeypatch.setattr(session, "Topic", SlowTopic)
    node.create_publisher(String, "new", 1)
    closing.join(60.0)
    assert order[0] == "made" and set(order[1:]) == {"deleted"}


def test_node_that_the_garbage_collector_ends_while_its_session_closes(
    context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in a process whose node's constructor has raised: the collector may run in a thread that deletes."""
    delete = session.delete

    def delete_and_collect(entity: Any) -> None:
        context._close_when_unused()
        delete(entity)

    _world(context).node.destroy_node()
    monkeypatch.setattr(session, "delete", delete_and_collect)
    closing = threading.Thread(target=context.destroy, daemon=True)
    closing.start()
    closing.join(60.0)
    assert not closing.is_alive()


def test_a_topic_stays_until_its_context_ends(context: Context, node: Any) -> None:
    """The garbage collector would delete it at any time, in any thread."""
    for _ in range(3):
        assert node.destroy_publisher(node.create_publisher(String, "short", 1))
    gc.collect()
    (topic,) = (topic for (name, _), topic in context.session._topics.items() if name == "rt/short")
    assert topic.name == "rt/short"
    node.destroy_node()
    context.destroy()
    with pytest.raises(DDSException):
        _ = topic.name


def test_all_callbacks_of_a_shutdown_run_even_if_one_raises(context: Context, node: Any, spinner: Any) -> None:
    called: list[str] = []

    def fail() -> None:
        called.append("fails")
        raise ValueError("on purpose")

    context.on_shutdown(fail)
    context.on_shutdown(lambda: called.append("next"))
    node.destroy_node()
    with pytest.raises(ValueError, match="on purpose"):
        context.shutdown()
    assert called == ["fails", "next"]
    assert spinner.executor._wait_set._woken and context.session._closed


def test_a_signal_shuts_down_every_context(
    domain_id: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail() -> None:
        raise ValueError("on purpose")

    contexts = [Context(), Context()]
    for context in contexts:
        context.init(args=[], domain_id=domain_id)
        context.on_shutdown(fail)
    read_end, write_end = os.pipe()
    monkeypatch.setitem(signals._previous, signal.SIGTERM, None)
    os.write(write_end, bytes([signal.SIGTERM]))
    os.close(write_end)
    signals._watch(read_end)
    assert all(context.session._closed for context in contexts)
    assert capsys.readouterr().err.count("ValueError: on purpose") == 2


def test_callbacks_of_a_shutdown_may_wait_for_a_thread_that_asks_for_it(domain_id: int) -> None:
    rclpy.init(args=[])
    thread = threading.Thread(target=rclpy.ok, daemon=True)
    ended: list[bool] = []

    def wait() -> None:
        thread.start()
        thread.join(60.0)
        ended.append(not thread.is_alive())

    rclpy.get_default_context().on_shutdown(wait)
    rclpy.try_shutdown()
    assert ended == [True]


def test_callbacks_for_the_shutdown_do_not_pile_up(context: Context, node: Any) -> None:
    for _ in range(20):
        node.get_clock().sleep_for(Duration(nanoseconds=1), context)
        gc.collect()
    assert len(context._callbacks) <= 2


def test_nobody_sleeps_after_a_rate_is_destroyed(node: Any) -> None:
    rate = node.create_rate(0.001)
    others: list[threading.Thread] = []

    class Event(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            result = super().wait(timeout)
            others.append(threading.Thread(target=rate.destroy))
            others[0].start()  # between the end of the wait and what follows it
            return result

        def clear(self) -> None:
            others[0].join(0.05)  # it waits for a lock, if there is one
            super().clear()

    rate._event = Event()
    rate._event.set()
    rate.sleep()
    others[0].join(60.0)
    # Who had looked before the rate was destroyed waits for the event now.
    assert rate._event.is_set()


def test_an_interrupt_while_the_guard_is_reset_does_not_leave_it_set(context: Context) -> None:
    conditions = WaitSet(context.session)
    guard, interrupted = conditions._guard, []

    class Guard:
        def set(self, value: bool) -> None:
            guard.set(value)
            if not value and not interrupted:
                interrupted.append(True)
                raise KeyboardInterrupt

    conditions._guard = Guard()
    conditions.wake()
    with pytest.raises(KeyboardInterrupt):
        conditions.wait(0)
    conditions.wait(0)
    assert conditions.wait(0) == 0 and not conditions._woken and not guard.read()
    conditions.wake()
    assert guard.read()
    conditions._guard = guard
    conditions.close()
