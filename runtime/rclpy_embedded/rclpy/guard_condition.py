"""Guard conditions: wake an executor from anywhere."""

from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.context import Context, context_or_default
from rclpy.impl.handle import Destroyable


class GuardCondition(Destroyable):
    """Calls its callback after ``trigger``; created by ``Node.create_guard_condition``."""

    condition = None

    def __init__(
        self, callback: Callable[[], Any] | None, callback_group: CallbackGroup | None, context: Context | None = None
    ) -> None:
        super().__init__()
        self._context = context_or_default(context)
        self.callback = callback
        self.callback_group = callback_group
        self._triggered = False

    def trigger(self) -> None:
        """Have the executor call the callback, once however many triggers come before that."""
        self._check()
        self._triggered = True
        self._context._wake_all()

    def _wait_ns(self) -> int | None:
        return 0 if self._triggered else None

    def _take(self) -> Callable[[], Any] | None:
        self._triggered = False
        return self.callback
