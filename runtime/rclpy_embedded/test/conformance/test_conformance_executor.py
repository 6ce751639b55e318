"""The executor, futures and tasks."""

from __future__ import annotations

import contextlib
import gc
import threading
import time
import weakref
from typing import Any

import pytest
import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, ShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.task import Future
from std_msgs.msg import String


def test_spin_once_runs_one_callback(node: Any, spinner: Any) -> None:
    got: list[str] = []
    node.create_subscription(String, "chat", lambda message: got.append(message.data), 10)
    publisher = node.create_publisher(String, "chat", 10)
    for text in "abc":
        publisher.publish(String(data=text))
    for count in (1, 2, 3):
        spinner.executor.spin_once(timeout_sec=120)
        assert len(got) == count
    assert got == ["a", "b", "c"]


def test_spin_once_times_out(spinner: Any) -> None:
    for timeout in (0, 0.05):
        start = time.monotonic()
        spinner.executor.spin_once(timeout_sec=timeout)
        assert time.monotonic() - start >= timeout


def test_global_spin_functions(domain_id: int) -> None:
    rclpy.init(args=[])
    try:
        node = rclpy.create_node("global_spin")
        future: Future = Future()
        calls: list[int] = []
        node.create_timer(0.01, lambda: (calls.append(1), future.set_result("done")))
        rclpy.spin_until_future_complete(node, future, timeout_sec=120)
        assert future.result() == "done"
        rclpy.spin_once(node, timeout_sec=120)
        assert len(calls) == 2
        assert rclpy.get_global_executor() is node.executor
        node.create_timer(0.01, rclpy.shutdown)
        rclpy.spin(node)
        assert not rclpy.ok()
        node.destroy_node()
    finally:
        rclpy.try_shutdown()


def test_spin_until_future_complete_times_out(spinner: Any) -> None:
    future: Future = Future()
    start = time.monotonic()
    spinner.executor.spin_until_future_complete(future, timeout_sec=0.1)
    assert not future.done()
    assert time.monotonic() - start >= 0.1


def test_future_completed_by_another_thread_ends_the_spin(spinner: Any) -> None:
    future: Future = Future()
    threading.Timer(0.05, future.set_result, [1]).start()
    spinner.executor.spin_until_future_complete(future)
    assert future.result() == 1


def test_nodes_and_entities_come_and_go_while_spinning(context: Context, node: Any, wait_until: Any) -> None:
    executor = SingleThreadedExecutor(context=context)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    got: list[str] = []
    try:
        assert executor.add_node(node)
        assert not executor.add_node(node)
        assert executor.get_nodes() == [node]
        publisher = node.create_publisher(String, "chat", 10)
        for _ in range(20):
            subscription = node.create_subscription(String, "chat", lambda message: got.append(message.data), 10)
            publisher.publish(String(data="x"))
            assert wait_until(lambda: got)
            assert node.destroy_subscription(subscription)
            got.clear()
        other = rclpy.create_node("other", context=context)
        executor.add_node(other)
        other.create_timer(0.001, lambda: got.append("tick"))
        assert wait_until(lambda: len(got) > 3)
        executor.remove_node(other)
        cycles: list[int] = []
        node.create_timer(0.001, lambda: cycles.append(len(got)))
        assert wait_until(lambda: len(cycles) > 50)
        # A call that was under way when the node left may still come.
        assert len(set(cycles[3:])) == 1
        other.destroy_node()
    finally:
        executor.shutdown()
        thread.join(120)
    assert not thread.is_alive()


def test_node_moves_between_executors(context: Context, node: Any) -> None:
    first, second = SingleThreadedExecutor(context=context), SingleThreadedExecutor(context=context)
    first.add_node(node)
    second.add_node(node)
    assert first.get_nodes() == [] and second.get_nodes() == [node]
    assert node.executor is second
    node.executor = None
    assert second.get_nodes() == []
    first.shutdown()
    second.shutdown()


def test_exception_in_callback_comes_out(node: Any, spinner: Any) -> None:
    calls: list[int] = []

    def fail() -> None:
        calls.append(1)
        raise ValueError("on purpose")

    timer = node.create_timer(0.001, fail)
    with pytest.raises(ValueError, match="on purpose"):
        spinner.until(lambda: False)
    timer.cancel()
    # The group is free again.
    node.create_timer(0.001, lambda: calls.append(2))
    assert spinner.until(lambda: 2 in calls)


def test_keyboard_interrupt_frees_the_group(node: Any, spinner: Any) -> None:
    def interrupt() -> None:
        timer.cancel()
        raise KeyboardInterrupt

    timer = node.create_timer(0.001, interrupt)
    with pytest.raises(KeyboardInterrupt):
        spinner.until(lambda: False)
    calls: list[int] = []
    node.create_timer(0.001, lambda: calls.append(1))
    assert spinner.until(lambda: calls)


def test_exception_in_async_callback_comes_out(node: Any, spinner: Any) -> None:
    gate: Future = Future()
    begun: list[int] = []

    async def fail() -> None:
        timer.cancel()
        begun.append(1)
        await gate
        raise ValueError("later")

    timer = node.create_timer(0.001, fail)
    assert spinner.until(lambda: begun)
    gate.set_result(None)
    with pytest.raises(ValueError, match="later"):
        spinner.until(lambda: False)


def test_create_task(spinner: Any) -> None:
    executor = spinner.executor
    plain = executor.create_task(lambda a, b=0: a + b, 1, b=2)
    assert spinner.until(plain.done)
    assert plain.result() == 3

    async def add(a: int, b: int) -> int:
        return a + b

    assert spinner.until(executor.create_task(add, 3, 4).done)
    coroutine = executor.create_task(add(5, 6))
    assert spinner.until(coroutine.done)
    assert coroutine.result() == 11


def test_newest_task_runs_first(spinner: Any) -> None:
    order: list[int] = []
    tasks = [spinner.executor.create_task(order.append, number) for number in range(5)]
    assert spinner.until(lambda: all(task.done() for task in tasks))
    assert order == [4, 3, 2, 1, 0]


def test_task_awaits_task(spinner: Any) -> None:
    gate: Future = Future()

    async def inner() -> str:
        return f"inner {await gate}"

    async def outer() -> str:
        return f"outer {await spinner.executor.create_task(inner)}"

    task = spinner.executor.create_task(outer)
    spinner.rest(5)
    assert not task.done()
    gate.set_result(1)
    assert spinner.until(task.done)
    assert task.result() == "outer inner 1"


def test_task_that_only_yields_does_not_starve_the_rest(node: Any, spinner: Any) -> None:
    class Yield:
        def __await__(self) -> Any:
            yield

    async def forever() -> None:
        while not calls:
            await Yield()

    calls: list[int] = []
    task = spinner.executor.create_task(forever)
    node.create_timer(0.01, lambda: calls.append(1))
    assert spinner.until(task.done)


def test_task_exception_comes_out(spinner: Any) -> None:
    def fail() -> None:
        raise ValueError("task")

    task = spinner.executor.create_task(fail)
    with pytest.raises(ValueError, match="task"):
        spinner.until(task.done)
    assert isinstance(task.exception(), ValueError)


def test_mutually_exclusive_group_holds_back_others(node: Any, spinner: Any) -> None:
    gate: Future = Future()
    group = MutuallyExclusiveCallbackGroup()
    calls: list[str] = []

    async def hold() -> None:
        holder.cancel()
        calls.append("begin")
        await gate
        calls.append("end")

    holder = node.create_timer(0.001, hold, callback_group=group)
    assert spinner.until(lambda: calls == ["begin"])
    node.create_timer(0.001, lambda: calls.append("same"), callback_group=group)
    node.create_timer(0.001, lambda: calls.append("other"), callback_group=ReentrantCallbackGroup())
    assert spinner.until(lambda: "other" in calls)
    spinner.rest(30)
    assert "same" not in calls
    gate.set_result(None)
    assert spinner.until(lambda: "same" in calls)
    assert calls.index("end") < calls.index("same")
    assert group.has_entity(holder)


def test_guard_condition(node: Any, spinner: Any) -> None:
    calls: list[int] = []
    guard = node.create_guard_condition(lambda: calls.append(1))
    guard.trigger()
    guard.trigger()
    spinner.rest()
    assert calls == [1]
    threading.Timer(0.02, guard.trigger).start()
    assert spinner.until(lambda: calls == [1, 1])
    assert node.destroy_guard_condition(guard)
    with pytest.raises(InvalidHandle):
        guard.trigger()


def test_executor_shutdown_ends_spin(context: Context, node: Any, wait_until: Any) -> None:
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    threading.Timer(0.05, executor.shutdown).start()
    executor.spin()
    assert wait_until(lambda: executor.get_nodes() == [])
    with pytest.raises(ShutdownException):
        executor.wait_for_ready_callbacks(0)


def test_context_shutdown_ends_spin(context: Context, spinner: Any) -> None:
    threading.Timer(0.05, context.shutdown).start()
    # As with genuine rclpy, a spin that was not waiting just then ends without an exception.
    with contextlib.suppress(ExternalShutdownException):
        spinner.executor.spin()
    assert not context.ok()


def test_waiting_after_the_shutdown_of_the_context_is_an_error(context: Context, spinner: Any) -> None:
    context.shutdown()
    # Genuine rclpy fails before it waits.
    with pytest.raises((ExternalShutdownException, RCLError)):
        spinner.executor.spin_once(timeout_sec=30)


def test_wait_for_ready_callbacks(node: Any, spinner: Any) -> None:
    with pytest.raises(TimeoutException):
        spinner.executor.wait_for_ready_callbacks(0)
    calls: list[int] = []
    timer = node.create_timer(0.001, lambda: calls.append(1))
    handler, entity, owner = spinner.executor.wait_for_ready_callbacks(120)
    assert entity is timer and owner is node and not calls
    handler()
    assert calls == [1]


def test_executor_is_a_context_manager(context: Context, node: Any) -> None:
    with SingleThreadedExecutor(context=context) as executor:
        executor.add_node(node)
    assert executor.get_nodes() == []


def test_forgotten_node_leaves_the_graph(context: Context, node: Any, wait_until: Any) -> None:
    other = rclpy.create_node("forgotten", context=context)
    reference = weakref.ref(other)
    assert wait_until(lambda: "forgotten" in node.get_node_names())
    del other
    gc.collect()
    assert reference() is None
    assert wait_until(lambda: "forgotten" not in node.get_node_names())


def test_future() -> None:
    future: Future = Future()
    called: list[Future] = []
    future.add_done_callback(called.append)
    assert not future.done() and not future.cancelled() and future.result() is None
    future.set_result(7)
    assert future.done() and future.result() == 7 and future.exception() is None
    future.add_done_callback(called.append)
    assert called == [future, future]


def test_future_exception() -> None:
    future: Future = Future()
    future.set_exception(ValueError("x"))
    assert future.done() and isinstance(future.exception(), ValueError)
    with pytest.raises(ValueError):
        future.result()


def test_future_cancel() -> None:
    future: Future = Future()
    future.cancel()
    assert future.cancelled() and not future.done()


def test_failing_done_callback_is_a_warning() -> None:
    future: Future = Future()
    called: list[Future] = []

    def fail(_: Future) -> None:
        raise ValueError("callback")

    future.add_done_callback(fail)
    future.add_done_callback(called.append)
    with pytest.warns(UserWarning, match="callback"):
        future.set_result(1)
    assert called == [future]


def test_unretrieved_exception_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    future: Future = Future()
    future.set_exception(ValueError("lost"))
    del future
    gc.collect()
    assert "never retrieved: lost" in capsys.readouterr().err
