"""The executor with a pool of threads: what overlaps, what never does, and how it ends."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import pytest
import rclpy
from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.executors import MultiThreadedExecutor
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import SetBool

PATIENCE_S = 240.0


@contextmanager
def spinning(context: Context, *nodes: Any, threads: int = 4) -> Iterator[MultiThreadedExecutor]:
    """The nodes spin in a thread of their own."""
    executor = MultiThreadedExecutor(threads, context=context)
    for node in nodes:
        executor.add_node(node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    try:
        yield executor
    finally:
        executor.shutdown()
        thread.join(PATIENCE_S)
        assert not thread.is_alive()


def spun(executor: MultiThreadedExecutor, condition: Callable[[], Any]) -> bool:
    """Spin until a condition holds; returns whether it does."""
    end = time.monotonic() + PATIENCE_S
    while not condition() and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
    return bool(condition())


@pytest.mark.parametrize("groups", ["reentrant", "two exclusive ones"])
def test_callbacks_run_side_by_side(context: Context, node: Any, groups: str) -> None:
    met = threading.Barrier(2, timeout=PATIENCE_S)
    done = [threading.Event(), threading.Event()]

    def meet(event: threading.Event, first: threading.Semaphore) -> None:
        if first.acquire(blocking=False):  # no other call waits: nobody would come for it
            met.wait()  # broken unless the other one is in its callback, too
            event.set()

    one = ReentrantCallbackGroup()
    pair = (one, one) if groups == "reentrant" else (MutuallyExclusiveCallbackGroup(), MutuallyExclusiveCallbackGroup())
    for event, group in zip(done, pair, strict=True):
        node.create_timer(0.01, partial(meet, event, threading.Semaphore(1)), callback_group=group)
    with spinning(context, node):
        assert all(event.wait(PATIENCE_S) for event in done)


def test_a_reentrant_callback_overlaps_with_itself(context: Context, node: Any) -> None:
    first = threading.Semaphore(3)
    met, done = threading.Barrier(3, timeout=PATIENCE_S), threading.Event()

    def meet() -> None:
        if first.acquire(blocking=False):
            met.wait()
            done.set()

    node.create_timer(0.01, meet, callback_group=ReentrantCallbackGroup())
    with spinning(context, node):
        assert done.wait(PATIENCE_S)


def test_callbacks_of_an_exclusive_group_never_overlap(context: Context, node: Any) -> None:
    group, inside, overlaps, calls = MutuallyExclusiveCallbackGroup(), threading.Lock(), [], []
    enough = threading.Event()

    def work(*_: Any) -> None:
        if not inside.acquire(blocking=False):
            overlaps.append(1)
            return
        threading.Event().wait(0.0005)  # others have the chance
        calls.append(threading.get_ident())
        inside.release()
        if len(calls) >= 300:
            enough.set()

    publisher = node.create_publisher(String, "chat", 100)
    for _ in range(3):
        node.create_subscription(String, "chat", work, 100, callback_group=group)
        node.create_timer(0.001, work, callback_group=group)
    node.create_timer(0.001, lambda: publisher.publish(String()), callback_group=ReentrantCallbackGroup())
    with spinning(context, node, threads=8):
        assert enough.wait(PATIENCE_S)
    assert not overlaps


@pytest.mark.parametrize("make", [MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup])
def test_every_message_comes_once(context: Context, node: Any, make: type[CallbackGroup]) -> None:
    got: list[str] = []
    node.create_subscription(String, "chat", lambda message: got.append(message.data), 1000, callback_group=make())
    publisher = node.create_publisher(String, "chat", 1000)
    sent = [str(i) for i in range(200)]
    with spinning(context, node) as executor:
        for text in sent:
            publisher.publish(String(data=text))
        end = time.monotonic() + PATIENCE_S
        while len(got) < len(sent) and time.monotonic() < end:
            executor.create_task(lambda: None)
            threading.Event().wait(0.01)
    assert sorted(got, key=int) == sent


def test_a_callback_waits_for_a_service_of_the_same_node(context: Context, node: Any) -> None:
    answers: list[Any] = []
    done = threading.Event()

    def answer(request: Any, response: Any) -> Any:
        response.success, response.message = request.data, "answered"
        return response

    node.create_service(SetBool, "ask", answer, callback_group=MutuallyExclusiveCallbackGroup())
    client = node.create_client(SetBool, "ask", callback_group=MutuallyExclusiveCallbackGroup())

    def ask() -> None:
        timer.cancel()
        assert client.wait_for_service(PATIENCE_S)
        answers.append(client.call(SetBool.Request(data=True), PATIENCE_S))
        done.set()

    timer = node.create_timer(0.01, ask, callback_group=MutuallyExclusiveCallbackGroup())
    with spinning(context, node):
        assert done.wait(PATIENCE_S)
    assert (answers[0].success, answers[0].message) == (True, "answered")


def test_coroutines_are_resumed(context: Context, node: Any) -> None:
    gate, done = Future(), threading.Event()

    async def wait() -> None:
        timer.cancel()
        assert await gate == 7
        done.set()

    timer = node.create_timer(0.01, wait)
    with spinning(context, node) as executor:
        task = executor.create_task(lambda: 3)
        node.create_timer(0.05, lambda: gate.set_result(7), callback_group=ReentrantCallbackGroup())
        assert done.wait(PATIENCE_S)
        executor.create_task(lambda: None)
    assert task.done() and task.result() == 3


def test_an_exception_comes_out_of_the_thread_that_spins(context: Context, node: Any) -> None:
    executor = MultiThreadedExecutor(2, context=context)
    executor.add_node(node)

    def fail() -> None:
        raise ValueError("as a test")

    node.create_timer(0.01, fail)
    with pytest.raises(ValueError, match="as a test"):
        executor.spin()
    executor.shutdown()


def test_shutdown_waits_for_callbacks_as_long_as_it_may(context: Context, node: Any, genuine: bool) -> None:
    if genuine:
        pytest.skip("rclpy 7.1 returns at once and says that it has waited")
    begun, go_on, ended = threading.Event(), threading.Event(), threading.Event()

    def work() -> None:
        timer.cancel()
        begun.set()
        assert go_on.wait(PATIENCE_S)
        ended.set()

    timer = node.create_timer(0.01, work)
    executor = MultiThreadedExecutor(2, context=context)
    executor.add_node(node)
    assert spun(executor, begun.is_set)
    assert not executor.shutdown(timeout_sec=0.05)
    go_on.set()
    assert executor.shutdown(timeout_sec=PATIENCE_S)
    assert ended.is_set()


def test_spinning_until_a_future_is_done(context: Context, node: Any) -> None:
    future: Future = Future()
    node.create_timer(0.01, lambda: future.set_result("done"))
    executor = MultiThreadedExecutor(2, context=context)
    executor.add_node(node)
    executor.spin_until_future_complete(future, timeout_sec=PATIENCE_S)
    assert future.result() == "done"
    executor.shutdown()


def test_nodes_come_and_go_while_it_spins(context: Context, node: Any) -> None:
    with spinning(context, node) as executor:
        for i in range(5):
            ticked = threading.Event()
            other = rclpy.create_node(f"other_{i}", context=context)
            other.create_timer(0.001, ticked.set)
            executor.add_node(other)
            assert ticked.wait(PATIENCE_S)
            executor.remove_node(other)
            other.destroy_node()
        assert executor.get_nodes() == [node]


def test_a_single_thread_is_warned_of(context: Context) -> None:
    with pytest.warns(UserWarning, match="SingleThreadedExecutor"):
        MultiThreadedExecutor(1, context=context).shutdown()


def test_a_callback_may_shut_its_executor_down(context: Context, node: Any, genuine: bool) -> None:
    if genuine:
        pytest.skip("rclpy waits for the callback that waits")
    executor = MultiThreadedExecutor(2, context=context)
    executor.add_node(node)
    answers: list[bool] = []
    node.create_timer(0.01, lambda: answers.append(executor.shutdown()))
    executor.spin()
    end = time.monotonic() + PATIENCE_S
    while not answers and time.monotonic() < end:
        threading.Event().wait(0.01)
    assert answers == [True]
