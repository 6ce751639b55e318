"""Keeps the set-points in force for those who come when their sender has left."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.publisher import Publisher

from fsw_control import messages_ros as convert
from fsw_control.contract import Reference
from fsw_control.references import ReferenceQueue
from fsw_control.topics_ros import LATEST, subscribe_references
from fsw_msgs.msg import WeldReference


class KeptReference:
    """Hears ``fsw/reference`` and tells, latched, on ``fsw/supervisor/reference`` what holds at present.

    An operator's command line is gone as soon as it has sent its set-points, and with it the middleware's memory of
    them. A topic of its own has one writer, the supervisor on duty, and can override nobody: it states when each
    set-point was issued, and of two the one issued last holds.

    Parameters
    ----------
    node : Node
        The supervisor's node.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._queue = ReferenceQueue()
        self._publisher: Publisher | None = None
        self._told: tuple[Reference, int] | None = None
        self._tick_ns = -1
        subscribe_references(node, self._queue, lambda _: None)  # every controller says what is wrong

    def open(self) -> None:
        """Go on duty: tell from the next tick on."""
        if self._publisher is None:
            self._publisher = self._node.create_publisher(WeldReference, "fsw/supervisor/reference", LATEST)
            self._told = None

    def close(self) -> None:
        """Leave duty."""
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
            self._publisher = None

    def on_tick(self, tick_ns: int) -> None:
        """Tell what holds at a tick if it has changed, or if time has begun anew."""
        if tick_ns == self._tick_ns:
            return
        if tick_ns < self._tick_ns:
            self._told = None
        self._tick_ns = tick_ns
        present = self._queue.at(tick_ns)
        if self._publisher is None or present is None or (present, self._queue.issued_ns) == self._told:
            return
        self._told = (present, self._queue.issued_ns)
        self._publisher.publish(convert.kept_reference_message(present, tick_ns, self._queue.issued_ns))
