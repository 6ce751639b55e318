"""Waitables: what an executor waits for besides the other entities."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass
from operator import add
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.task import Future


@dataclass
class NumberOfEntities:
    """How many entities a waitable adds to genuine rclpy's wait set; here nobody asks."""

    num_subscriptions: int = 0
    num_guard_conditions: int = 0
    num_timers: int = 0
    num_clients: int = 0
    num_services: int = 0
    num_events: int = 0

    def __add__(self, other: NumberOfEntities) -> NumberOfEntities:
        return NumberOfEntities(*map(add, astuple(self), astuple(other)))


class Waitable:
    """Base class. Once `is_ready`, the executor calls `take_data`, then `execute` with what that returned."""

    def __init__(self, callback_group: CallbackGroup) -> None:
        self.callback_group = callback_group
        self.callback_group.add_entity(self)
        self._futures: list[Future] = []

    def add_future(self, future: Future) -> None:
        """Let the executor run the done callbacks of `future`."""
        self._futures.append(future)

    def remove_future(self, future: Future) -> None:
        """Forget a future that was added."""
        self._futures.remove(future)

    def add_to_wait_set(self, wait_set: Any) -> None:
        """Add what wakes the executor: handles of subscriptions, timers and the like; each gets a number."""

    def is_ready(self, wait_set: Any) -> bool:
        """Return whether there is something to take; the wait set tells it of each number."""
        return False

    def take_data(self) -> Any:
        """Take what is there, so that it does not wake the executor again."""

    def _take(self) -> Callable[[], Any]:
        data = self.take_data()
        return lambda: self.execute(data)

    def _end(self) -> None:
        """End with the node."""

    async def execute(self, taken_data: Any) -> None:
        """Process what was taken."""
