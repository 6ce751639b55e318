"""Set-points on topics: as they are sent, and as those who follow them state what holds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from fsw_control import messages_ros as convert
from fsw_control.contract import Reference
from fsw_control.references import ReferenceQueue
from fsw_control.topics_ros import LATCHED, LATEST
from fsw_msgs.msg import WeldReference


def subscribe_references(node: Node, queue: ReferenceQueue, refuse: Callable[[str], object]) -> None:
    """Put the set-points that are sent, and those that a supervisor states for late joiners, into ``queue``.

    ``refuse`` gets what is wrong with a message that is not taken.
    """

    def on_sent(message: WeldReference, info: Any) -> None:
        _take(queue, message, info["source_timestamp"], refuse)

    node.create_subscription(WeldReference, "fsw/reference", on_sent, LATCHED)
    _subscribe_stated(node, queue, "fsw/supervisor/reference", refuse)


def _subscribe_stated(node: Node, queue: ReferenceQueue, topic: str, refuse: Callable[[str], object]) -> None:
    """Subscribe to what another listener states with a :class:`StatedReference`."""

    def on_stated(message: WeldReference) -> None:
        _take(queue, message, convert.issued_ns(message), refuse)

    node.create_subscription(WeldReference, topic, on_stated, LATEST)


def _take(queue: ReferenceQueue, message: WeldReference, issued_ns: int, refuse: Callable[[str], object]) -> None:
    try:
        queue.add(convert.stamp_ns(message.header.stamp), convert.reference(message), issued_ns)
    except ValueError as error:
        refuse(str(error))


class StatedReference:
    """States, latched, which set-points hold, for nodes that join when the sender has left.

    Its ``topic`` has no other writer.
    """

    def __init__(self, node: Node, topic: str) -> None:
        self._node = node
        self._publisher = node.create_publisher(WeldReference, topic, LATEST)
        self._told: tuple[Reference, int] | None = None
        self._tick_ns = -1

    def update(self, tick_ns: int, reference: Reference | None, issued_ns: int) -> None:
        """State what holds at a tick (None: nothing yet) and when it was issued, if it is new or time went back."""
        went_back, self._tick_ns = tick_ns < self._tick_ns, tick_ns
        if reference is not None and (went_back or (reference, issued_ns) != self._told):
            self._told = (reference, issued_ns)
            self._publisher.publish(convert.reference_message(reference, tick_ns, issued_ns))

    def close(self) -> None:
        """Withdraw the statement."""
        self._node.destroy_publisher(self._publisher)


class KeptReference:
    """Hears ``fsw/reference`` and, while leading, states on ``fsw/supervisor/reference`` what holds at present.

    An operator's command line is gone as soon as it has sent its set-points, and with it the middleware's memory of
    them. A topic of its own has one writer, the leading supervisor, and can override nobody: it states when each
    set-point was issued, and of two the one issued last holds. A supervisor that was away learns from the controllers.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._queue = ReferenceQueue()
        self._statement: StatedReference | None = None
        self._tick_ns = -1
        subscribe_references(node, self._queue, _ignore)

    def hear(self, controller: str) -> None:
        """Listen to which set-points a controller follows."""
        _subscribe_stated(self._node, self._queue, f"fsw/{controller}/reference", _ignore)

    def open(self) -> None:
        """Lead: state from the next tick on."""
        if self._statement is None:
            self._statement = StatedReference(self._node, "fsw/supervisor/reference")

    def close(self) -> None:
        """Stop stating."""
        if self._statement is not None:
            self._statement.close()
            self._statement = None

    def on_tick(self, tick_ns: int) -> None:
        """State what holds at a tick if it has changed; may be called several times per tick."""
        if tick_ns == self._tick_ns:
            return
        self._tick_ns = tick_ns
        present = self._queue.at(tick_ns)
        if self._statement is not None:
            self._statement.update(tick_ns, present, self._queue.issued_ns)


def _ignore(what: str) -> None:
    """Pass over a bad message: every controller reports it."""
