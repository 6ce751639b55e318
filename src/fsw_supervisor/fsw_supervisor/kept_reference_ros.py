"""Keeps the set-points in force for those who come when their sender has left."""

from __future__ import annotations

from rclpy.node import Node

from fsw_control.references import ReferenceQueue
from fsw_control.topics_ros import StatedReference, subscribe_references, subscribe_stated_reference


class KeptReference:
    """Hears ``fsw/reference`` and, on duty, states on ``fsw/supervisor/reference`` what holds at present.

    An operator's command line is gone as soon as it has sent its set-points, and with it the middleware's memory of
    them. A topic of its own has one writer, the supervisor on duty, and can override nobody: it states when each
    set-point was issued, and of two the one issued last holds. A supervisor that was away learns from the controllers.

    Parameters
    ----------
    node : Node
        The supervisor's node.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._queue = ReferenceQueue()
        self._statement: StatedReference | None = None
        self._tick_ns = -1
        subscribe_references(node, self._queue, _ignore)

    def hear(self, controller: str) -> None:
        """Listen to what a controller says that it follows."""
        subscribe_stated_reference(self._node, self._queue, f"fsw/{controller}/reference", _ignore)

    def open(self) -> None:
        """Go on duty: tell from the next tick on."""
        if self._statement is None:
            self._statement = StatedReference(self._node, "fsw/supervisor/reference")

    def close(self) -> None:
        """Leave duty."""
        if self._statement is not None:
            self._statement.close()
            self._statement = None

    def on_tick(self, tick_ns: int) -> None:
        """Tell what holds at a tick if it has changed."""
        if tick_ns == self._tick_ns:
            return
        self._tick_ns = tick_ns
        present = self._queue.at(tick_ns)
        if self._statement is not None:
            self._statement.tell(tick_ns, present, self._queue.issued_ns)


def _ignore(what: str) -> None:
    """Say nothing of a bad message: every controller does."""
