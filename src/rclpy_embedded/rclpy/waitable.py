"""What an executor can wait for besides the usual entities."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import CallbackGroup

if TYPE_CHECKING:
    from cyclonedds.core import Entity
    from rclpy.task import Future


class Waitable:
    """Something with a DDS condition: when `is_ready`, `take_data` is called, then `execute` with what it returned.

    Parameters
    ----------
    callback_group : CallbackGroup
        Group that decides when it may execute.
    """

    #: What wakes the executor; None for something that another entity wakes.
    condition: Entity | None = None

    def __init__(self, callback_group: CallbackGroup) -> None:
        self.callback_group = callback_group
        self.callback_group.add_entity(self)
        self._futures: list[Future] = []

    def add_future(self, future: Future) -> None:
        """Have done callbacks of `future` run by the executor."""
        self._futures.append(future)

    def remove_future(self, future: Future) -> None:
        """Forget a future that was added."""
        self._futures.remove(future)

    def is_ready(self) -> bool:
        """Return whether there is something to take."""
        return False

    def take_data(self) -> Any:
        """Take what is there, so that it does not wake the executor again."""
        return None

    def _take(self) -> Callable[[], Any]:
        data = self.take_data()
        return lambda: self.execute(data)

    async def execute(self, taken_data: Any) -> None:
        """Work on what was taken."""
