"""What only this runtime has: its own state, checked from inside, and what it says about what is missing."""

from __future__ import annotations

import ctypes
import os
import threading
import time
from types import SimpleNamespace
from typing import Any

import pytest
import rclpy
from rclpy import executors
from rclpy.context import Context
from rclpy.impl import dds, memory, session
from rclpy.impl.dds import matched
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import TimerInfo
from rclpy.wait_for_message import wait_for_message
from rclpy.waitable import Waitable
from std_msgs.msg import String


def test_leaves_the_graph_when_shut_down_and_nodes_destroyed(context: Context) -> None:
    node = rclpy.create_node("last", context=context)
    context.shutdown()
    assert not context.session._closed
    node.destroy_node()
    assert context.session._closed


def test_endpoints_are_deleted_side_by_side_at_the_end(context: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each writer waits up to a second for a reader that has died; one after the other a node would take many."""
    node = rclpy.create_node("last", context=context)
    publishers = [node.create_publisher(String, f"topic{i}", 10) for i in range(4)]
    met, all_at_once = [], threading.Barrier(len(publishers))

    def delete(entity: Any) -> None:
        if getattr(getattr(entity, "topic", None), "name", "").startswith("rt/topic"):
            met.append(all_at_once.wait(timeout=240.0))
        dds.delete(entity)

    monkeypatch.setattr(session, "delete", delete)
    context.shutdown()
    node.destroy_node()
    assert sorted(met) == [0, 1, 2, 3]


def test_waiting_for_a_message_sleeps_until_it_comes(node: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    looks = []
    take = Subscription.take
    monkeypatch.setattr(Subscription, "take", lambda self: looks.append(time.monotonic()) or take(self))
    assert wait_for_message(String, node, "never", time_to_wait=0.3) == (False, None)
    assert len(looks) <= 3  # at the beginning, at the end, and once more for a wait that ends early


def test_a_shutdown_ends_the_wait_for_a_message(context: Context, node: Any, wait_until: Any) -> None:
    found: list[tuple[bool, Any]] = []
    thread = threading.Thread(target=lambda: found.append(wait_for_message(String, node, "never")))
    thread.start()
    assert wait_until(lambda: node.count_subscribers("never") == 1)
    context.shutdown()
    thread.join(240.0)
    assert found == [(False, None)]


def test_rmw_identifier() -> None:
    assert rclpy.get_rmw_implementation_identifier() == "rmw_cyclonedds_cpp"


def test_bad_domain_in_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "seven")
    with pytest.raises(RuntimeError, match="ROS_DOMAIN_ID"):
        Context().init(args=[])


def test_timer_info(node: Any, spinner: Any) -> None:
    infos: list[TimerInfo] = []
    node.create_timer(0.01, infos.append)
    assert spinner.until(lambda: infos)
    assert infos[0].actual_call_time >= infos[0].expected_call_time


def test_missed_calls_are_not_made_up_for(node: Any, manual_clock: Any) -> None:
    clock, set_ms = manual_clock
    timer = node.create_timer(0.1, lambda: None, clock=clock)
    set_ms(1050)
    info = timer.call()
    assert info.expected_call_time.nanoseconds == 100_000_000
    assert info.actual_call_time.nanoseconds == 1_050_000_000
    assert not timer.is_ready()
    assert timer.time_until_next_call() == 50_000_000


def test_waiting_task_does_not_burn_cpu(spinner: Any) -> None:
    gate: Future = Future()

    async def wait() -> None:
        await gate

    spinner.executor.create_task(wait)
    spinner.rest(2)
    start = time.thread_time()
    spinner.executor.spin_once(timeout_sec=0.5)
    assert time.thread_time() - start < 0.25


def test_no_drift_over_1000_ticks(node: Any, manual_clock: Any) -> None:
    clock, set_ms = manual_clock
    timer = node.create_timer(0.1, lambda: None, clock=clock)
    for tick in range(1, 1001):
        # Each call comes 30 ms late; the next one is due on the grid all the same.
        set_ms(tick * 100 + 30)
        assert timer.is_ready()
        timer.call()
        assert timer.time_until_next_call() == 70_000_000
        assert timer.time_since_last_call() == 0


def test_simulated_time_that_jumps_back(node: Any, manual_clock: Any) -> None:
    clock, set_ms = manual_clock
    set_ms(10_000)
    timer = node.create_timer(0.1, lambda: None, clock=clock)
    set_ms(10_100)
    timer.call()
    set_ms(500)
    assert timer.time_until_next_call() == 100_000_000
    assert timer.time_since_last_call() == 0


def test_a_tick_that_nobody_slept_for_ends_the_next_sleep(node: Any) -> None:
    rate = node.create_rate(0.001)
    rate._timer.callback()
    sleeper = threading.Thread(target=rate.sleep, daemon=True)
    sleeper.start()
    sleeper.join(120)
    assert not sleeper.is_alive()
    node.destroy_rate(rate)


def test_one_topic_from_many_threads(context: Context, node: Any, wait_until: Any) -> None:
    def create() -> None:
        for _ in range(20):
            try:
                made.append(node.create_subscription(String, "crowded", lambda _: None, 10))
            except Exception as error:
                errors.append(error)

    made: list[Any] = []
    errors: list[Exception] = []
    threads = [threading.Thread(target=create) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    assert len(made) == 80
    assert wait_until(lambda: node.count_subscribers("crowded") == 80)


def test_matches_that_come_while_counting() -> None:
    answers = [IndexError("invalid index"), IndexError("invalid index"), [1, 2]]

    def handles() -> list[int]:
        answer = answers.pop(0)
        if isinstance(answer, IndexError):
            raise answer
        return answer

    assert matched(handles) == [1, 2]


class Bell(Waitable):
    """Ready once."""

    def __init__(self, node: Any, future: Future) -> None:
        super().__init__(node.default_callback_group)
        self.add_future(future)
        self._rung, self._future = False, future
        self.heard: list[str] = []
        future.add_done_callback(lambda done: self.heard.append(done.result()))

    def is_ready(self, wait_set: Any) -> bool:
        return not self._rung

    def take_data(self) -> str:
        self._rung = True
        return "ding"

    async def execute(self, taken_data: str) -> None:
        self._future.set_result(taken_data)
        self.heard_at_once = list(self.heard)


def test_future_of_a_waitable_calls_back_from_the_executor(node: Any, spinner: Any) -> None:
    future: Future = Future()
    bell = Bell(node, future)
    node.add_waitable(bell)
    assert spinner.until(lambda: bell.heard)
    assert bell.heard_at_once == [] and bell.heard == ["ding"]
    bell.remove_future(future)
    node.remove_waitable(bell)


@pytest.mark.parametrize("asked", [False, True], ids=["nobody asks for the graph", "somebody asked once"])
def test_discovery_does_not_pile_up_in_a_node_that_spins(
    context: Context, node: Any, spinner: Any, monkeypatch: pytest.MonkeyPatch, asked: bool
) -> None:
    monkeypatch.setattr(executors, "_TIDY_PERIOD_NS", 0)
    if asked:
        node.get_topic_names_and_types()
    graph, other = context.session.graph, Context()
    unread = [context.session.info_reader, *graph._endpoint_readers]
    assert len(unread) == (3 if asked else 1)
    other.init(args=[], domain_id=context.get_domain_id())
    try:
        changing = rclpy.create_node("changing", context=other)
        for number in range(30):
            changing.destroy_publisher(changing.create_publisher(String, f"topic_{number}", 10))
        last = changing.create_publisher(String, "last", 10)

        def announced() -> set[bytes]:
            nodes = [node for nodes in graph._announced.values() for node in nodes]
            return {bytes(gid.data) for node in nodes for gid in node.writer_gid_seq}

        assert spinner.until(lambda: last.handle.guid.bytes in announced())
        assert spinner.until(lambda: [len(reader.read(100)) for reader in unread] == [0] * len(unread))
    finally:
        other.destroy()


def test_large_messages_have_freed_memory_kept(run_program: Any) -> None:
    source = """
import rclpy
from rclpy.impl import memory
from std_msgs.msg import UInt8MultiArray
rclpy.init()
node, got = rclpy.create_node("large"), []
publisher = node.create_publisher(UInt8MultiArray, "data", 10)
node.create_subscription(UInt8MultiArray, "data", lambda message: got.append(len(message.data)), 10)
def hear(size):
    publisher.publish(UInt8MultiArray(data=bytes(size)))
    while not got:
        rclpy.spin_once(node, timeout_sec=1)
    return got.pop()
print(hear(1000), memory._is_kept, hear(1_000_000), memory._is_kept)
"""
    code, out, err = run_program(source).finish()
    assert (code, out.split()) == (0, ["1000", "False", "1000000", "True"]), err


@pytest.mark.parametrize("name", ["OTHER", "MALLOC_TRIM_THRESHOLD_"])
def test_glibc_is_told_to_keep_freed_memory_unless_the_environment_has_settings(monkeypatch: Any, name: str) -> None:
    """What it does then depends on the heap, and is measured in benchmarks/runtime.py."""
    mallopt, calls = ctypes.CDLL(None).mallopt, []

    def noted(parameter: int, value: int) -> None:
        calls.append((parameter, value, mallopt(parameter, value)))

    for one in [one for one in os.environ if one.startswith("MALLOC_")]:
        monkeypatch.delenv(one)
    monkeypatch.setenv(name, "65536")
    monkeypatch.setattr(memory, "_is_kept", False)
    monkeypatch.setattr(ctypes, "CDLL", lambda _: SimpleNamespace(mallopt=noted))
    memory.keep_freed_memory()
    memory.keep_freed_memory()
    # M_MMAP_THRESHOLD and M_TRIM_THRESHOLD of malloc.h, each taken (1) once
    assert calls == ([(-3, 32 << 20, 1), (-1, 64 << 20, 1)] if name == "OTHER" else [])
