"""Hears all publishers of one topic, whatever QoS they offer and whenever they come."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rosbags.interfaces import Qos

from fsw_recorder.qos import hears, requested_qos, strongest_first
from fsw_recorder.qos_ros import profile_of

#: how many messages of a topic are remembered to recognise one that comes twice
_REMEMBERED = 4096

#: topic, message, receive time, publish time
Write = Callable[[str, bytes, int, int], bool]


class Repeats:
    """The latest messages of a topic by the time of their publication and their content.

    Parameters
    ----------
    kept : int
        How many are remembered.
    """

    def __init__(self, kept: int = _REMEMBERED) -> None:
        self._order: deque[tuple[int, int]] = deque()
        self._known: set[tuple[int, int]] = set()
        self._kept = kept

    def seen(self, published_ns: int, data: bytes) -> bool:
        """Whether this message came before; it is remembered from now on."""
        key = (published_ns, hash(data))
        if key in self._known:
            return True
        self._known.add(key)
        self._order.append(key)
        if len(self._order) > self._kept:
            self._known.discard(self._order.popleft())
        return False


class TopicSubscription:
    """One subscription per strength of QoS that the publishers offer, each message taken once.

    A reliable subscription does not hear a best-effort publisher, and a best-effort one loses messages of a reliable
    one. So a weaker publisher adds a weaker subscription and leaves the stronger one as it is; what both receive is
    written when it comes first.

    Parameters
    ----------
    node : Node
        That subscribes.
    name : str
        Of the topic.
    kind : type
        Its message class.
    depth : int
        Of the queue.
    write : callable
        Gets every message.

    Attributes
    ----------
    lost : int
        Messages that the middleware reports as lost before they were received.
    """

    def __init__(self, node: Node, name: str, kind: type, depth: int, write: Write) -> None:
        self._node, self._name, self._kind, self._depth = node, name, kind, depth
        self._write = write
        self.requests: list[Qos] = []
        self.lost = 0
        self._subscriptions: list[Any] = []
        self._publishers: list[Qos] = []
        self._repeats: Repeats | None = None

    def update(self, publishers: Sequence[Qos]) -> bool:
        """Subscribe to what the present publishers offer and no subscription hears; True when one was added."""
        found = strongest_first(publishers)
        if found == self._publishers:
            return False
        self._publishers = found
        before = len(self.requests)
        for offer in found:
            if not any(hears(request, offer) for request in self.requests):
                self._add(requested_qos([offer], self._depth))
        return len(self.requests) > before

    def _add(self, request: Qos) -> None:
        self.requests.append(request)
        if len(self.requests) > 1 and self._repeats is None:
            self._repeats = Repeats()
        self._subscriptions.append(
            self._node.create_subscription(
                self._kind,
                self._name,
                self._receive,
                profile_of(request),
                raw=True,
                event_callbacks=SubscriptionEventCallbacks(message_lost=self._on_lost),
            )
        )

    def _receive(self, data: bytes, info: dict[str, Any]) -> None:
        received = info.get("received_timestamp") or time.time_ns()
        published = info.get("source_timestamp") or received
        content = bytes(data)
        if self._repeats is not None and published != received and self._repeats.seen(published, content):
            return
        self._write(self._name, content, received, published)

    def _on_lost(self, status: Any) -> None:
        self.lost += status.total_count_change
        self._node.get_logger().warning(
            f"{self._name}: {status.total_count_change} messages lost before they were received"
        )
