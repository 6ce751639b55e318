"""Waitables of one's own, and handles that are taken from without an executor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.guard_condition import GuardCondition
from rclpy.serialization import deserialize_message
from rclpy.timer import Timer
from rclpy.waitable import NumberOfEntities, Waitable
from std_msgs.msg import String
from std_srvs.srv import Trigger


class Custom(Waitable):
    """Waits for one entity of a kind (``guard_condition``, ``timer``, ``subscription``) by its handle."""

    def __init__(self, kind: str, entity: Any, take: Callable[[], Any]) -> None:
        super().__init__(ReentrantCallbackGroup())
        self.kind, self.entity, self.take = kind, entity, take
        self.taken: list[Any] = []
        self.number: int | None = None
        self.found_ready = False

    def get_num_entities(self) -> NumberOfEntities:
        return NumberOfEntities(1, 1, 1)

    def add_to_wait_set(self, wait_set: Any) -> None:
        self.number = getattr(wait_set, f"add_{self.kind}")(self.entity.handle)

    def is_ready(self, wait_set: Any) -> bool:
        self.found_ready = self.found_ready or wait_set.is_ready(self.kind, self.number)
        return self.found_ready

    def take_data(self) -> Any:
        self.found_ready = False
        return self.take()

    async def execute(self, taken_data: Any) -> None:
        self.taken.append(taken_data)


def test_waitable_with_a_guard_condition(context: Context, node: Any, spinner: Any) -> None:
    guard = GuardCondition(None, None, context=context)
    waitable = Custom("guard_condition", guard, lambda: "guard")
    node.add_waitable(waitable)
    spinner.rest()
    assert waitable.taken == []
    for count in (1, 2):
        guard.trigger()
        guard.trigger()
        assert spinner.until(lambda: waitable.taken)
        spinner.rest()
        assert waitable.taken == ["guard"] * count
    node.remove_waitable(waitable)
    guard.trigger()
    spinner.rest()
    assert waitable.taken == ["guard"] * 2
    guard.destroy()


def test_waitable_with_a_timer(context: Context, node: Any, spinner: Any) -> None:
    timer = Timer(None, None, 10_000_000, Clock(clock_type=ClockType.STEADY_TIME), context=context)
    waitable = Custom("timer", timer, timer.cancel)
    node.add_waitable(waitable)
    spinner.executor.spin_once(timeout_sec=120)
    assert spinner.until(lambda: waitable.taken == [None])
    spinner.rest()
    assert waitable.taken == [None]
    timer.reset()
    assert spinner.until(lambda: waitable.taken == [None, None])
    node.remove_waitable(waitable)
    timer.destroy()


def test_waitable_with_a_subscription(node: Any, spinner: Any) -> None:
    """Its own callback group never lets the executor take from it."""
    never = ReentrantCallbackGroup()
    never.can_execute = lambda entity: False  # type: ignore[method-assign]
    subscription = node.create_subscription(String, "chat", lambda _: None, 10, callback_group=never)

    def take() -> str:
        with subscription.handle:
            message, _ = subscription.handle.take_message(String, False)
        return str(message.data)

    waitable = Custom("subscription", subscription, take)
    node.add_waitable(waitable)
    publisher = node.create_publisher(String, "chat", 10)
    for text in ("a", "b"):
        publisher.publish(String(data=text))
    assert spinner.until(lambda: waitable.taken == ["a", "b"])
    node.remove_waitable(waitable)


def test_a_waitable_that_is_never_ready_does_no_harm(node: Any, spinner: Any) -> None:
    class Silent(Waitable):
        def get_num_entities(self) -> NumberOfEntities:
            return NumberOfEntities(0, 0, 0, 0, 0)

        def add_to_wait_set(self, wait_set: Any) -> None:
            pass

        def is_ready(self, wait_set: Any) -> bool:
            return False

    calls: list[int] = []
    node.create_timer(0.001, lambda: calls.append(1))
    waitable = Silent(ReentrantCallbackGroup())
    node.add_waitable(waitable)
    assert spinner.until(lambda: len(calls) > 2)
    node.remove_waitable(waitable)


@pytest.mark.parametrize("raw", [False, True])
def test_messages_are_taken_by_the_handle(node: Any, wait_until: Any, raw: bool) -> None:
    subscription = node.create_subscription(String, "chat", lambda _: None, 10)
    publisher = node.create_publisher(String, "chat", 10)
    taken: list[Any] = []

    def take() -> bool:
        with subscription.handle:
            one = subscription.handle.take_message(String, raw)
        taken.extend(() if one is None else one)
        return bool(taken)

    assert not take()
    publisher.publish(String(data="hello"))
    assert wait_until(take)
    message, info = taken
    assert (deserialize_message(message, String) if raw else message) == String(data="hello")
    assert 0 < info["source_timestamp"] <= info["received_timestamp"]


def test_requests_are_taken_by_the_handle(node: Any, spinner: Any, wait_until: Any) -> None:
    server = node.create_service(Trigger, "ask", lambda request, response: response)
    client = node.create_client(Trigger, "ask")
    with server.handle:
        assert server.handle.service_take_request(Trigger.Request) == (None, None)
    assert client.wait_for_service(timeout_sec=120)
    future = client.call_async(Trigger.Request())
    taken: list[Any] = []

    def take() -> bool:
        with server.handle:
            request, header = server.handle.service_take_request(Trigger.Request)
        taken.extend(() if request is None else (request, header))
        return bool(taken)

    assert wait_until(take)
    request, header = taken
    assert request == Trigger.Request() and header.source_timestamp > 0
    server.send_response(Trigger.Response(message="answer"), header)
    assert spinner.until(future.done)
    assert future.result().message == "answer"
