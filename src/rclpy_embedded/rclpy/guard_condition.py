"""Guard conditions: wake an executor from anywhere."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.context import Context
from rclpy.impl.handle import Destroyable
from rclpy.utilities import get_default_context


class GuardCondition(Destroyable):
    """Has its callback called after ``trigger``; made by ``Node.create_guard_condition``."""

    def __init__(
        self, callback: Callable[[], Any] | None, callback_group: CallbackGroup | None, context: Context | None = None
    ) -> None:
        super().__init__()
        self._context = get_default_context() if context is None else context
        self._context.session.check("failed to create guard condition")
        self.callback = callback
        self.callback_group = callback_group
        self._triggered = False

    def trigger(self) -> None:
        """Have the callback called, once for any number of triggers before it.

        Raises
        ------
        InvalidHandle
            After destruction.
        """
        self._check()
        self._triggered = True
        self._context._wake_all()

    def _take(self) -> Callable[[], Any] | None:
        self._triggered = False
        return self.callback
