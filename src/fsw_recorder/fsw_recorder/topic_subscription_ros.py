"""Subscribes to all publishers of one topic, with any QoS and at any time."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rosbags.interfaces import Qos

from fsw_recorder.qos import is_latched, missing_requests
from fsw_recorder.qos_ros import profile_of

#: how many messages of a topic are remembered to recognise duplicates
_REMEMBERED = 4096

#: topic, message, receive time, publish time
Write = Callable[[str, bytes, int, int], bool]


class Repeats:
    """The latest ``kept`` messages of a topic by the time of their publication and their content."""

    def __init__(self, kept: int = _REMEMBERED) -> None:
        self._known: dict[tuple[int, int], None] = {}
        self._kept = kept

    def seen(self, published_ns: int, data: bytes) -> bool:
        """Whether this message came before; it is remembered from now on."""
        key = (published_ns, hash(data))
        if key in self._known:
            return True
        self._known[key] = None
        if len(self._known) > self._kept:
            del self._known[next(iter(self._known))]
        return False


class TopicSubscription:
    """One subscription per strength of QoS that the publishers offer, each message taken once.

    A weaker publisher adds a weaker subscription and leaves the stronger one as it is; what both receive is written
    when it comes first. `lost` counts messages that the middleware reports as lost before they were received. On a
    latched topic Fast DDS also reports those that were replaced before the subscription; they are not lost.
    """

    def __init__(self, node: Node, name: str, kind: type, depth: int, write: Write) -> None:
        self._node, self._name, self._kind, self._depth = node, name, kind, depth
        self._write = write
        self._requests: list[Qos] = []
        self._repeats = Repeats()
        self.lost = 0
        self._received = 0

    def update(self, publishers: Sequence[Qos]) -> list[Qos]:
        """Add the subscriptions that the present publishers need; returns those added."""
        added = missing_requests(publishers, self._requests, self._depth)
        for request in added:
            self._node.create_subscription(
                self._kind,
                self._name,
                self._receive,
                profile_of(request),
                raw=True,
                event_callbacks=SubscriptionEventCallbacks(message_lost=self._on_lost),
            )
        self._requests += added
        return added

    def _receive(self, data: bytes, info: dict[str, Any]) -> None:
        self._received += 1
        received = info.get("received_timestamp") or time.time_ns()
        published = info.get("source_timestamp") or received
        content = bytes(data)
        may_repeat = len(self._requests) > 1 and published != received
        if not (may_repeat and self._repeats.seen(published, content)):
            self._write(self._name, content, received, published)

    def _on_lost(self, status: Any) -> None:
        if self._received < 2 and any(map(is_latched, self._requests)):  # the event may come after the message
            return
        self.lost += status.total_count_change
        self._node.get_logger().warning(
            f"{self._name}: {status.total_count_change} messages lost before they were received"
        )
