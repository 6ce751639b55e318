"""A timer for the next deadline."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

#: shortest timer period, also for a deadline that has passed already [ns]
_SHORTEST_NS = 100_000


class DeadlineTimer:
    """Calls ``call`` once per deadline, on the steady clock, and then waits for the next set."""

    def __init__(self, node: Node, call: Callable[[], None]) -> None:
        self._call = call
        self._due_s: float | None = None
        self._timer = node.create_timer(
            1.0, self._on_due, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self._timer.cancel()

    def set(self, due_s: float | None) -> None:
        """Replace the deadline (``time.monotonic``); None removes it."""
        if due_s == self._due_s:
            return
        self._due_s = due_s
        if due_s is None:
            self._timer.cancel()
            return
        self._timer.timer_period_ns = max(_SHORTEST_NS, round((due_s - time.monotonic()) * 1e9))
        self._timer.reset()

    def _on_due(self) -> None:
        self.set(None)
        self._call()
