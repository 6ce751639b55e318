"""Subscribes to all publishers of a topic, with any QoS and at any time."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.subscription import Subscription
from rosbags.interfaces import Qos

from fsw_recorder.qos_ros import profile_of
from fsw_recorder.topic import Sequences, missing_requests

#: number of a topic's messages that are kept to detect duplicates
_REMEMBERED = 4096

#: topic, message, receive time, publish time
Write = Callable[[str, bytes, int, int], bool]


class Repeats:
    """The latest ``kept`` messages of a topic by publish time and content."""

    def __init__(self, kept: int = _REMEMBERED) -> None:
        self._known: dict[tuple[int, int], None] = {}
        self._kept = kept

    def seen(self, published_ns: int, data: bytes) -> bool:
        """Whether this message is a duplicate; it is remembered."""
        key = (published_ns, hash(data))
        if key in self._known:
            return True
        self._known[key] = None
        if len(self._known) > self._kept:
            del self._known[next(iter(self._known))]
        return False


class _Polled(CallbackGroup):
    """A callback group that no executor waits for.

    An executor of rclpy rebuilds its wait set for each message, at a cost that grows with the
    number of topics; a recorder of all topics would spend most of its time on that.
    """

    def can_execute(self, entity: Any) -> bool:
        """Whether an executor may wait for an entity."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Whether an executor may run an entity's callback."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Never called, as nothing is run."""


class TopicSubscription:
    """One subscription per QoS strength that the publishers offer; messages are polled.

    A weaker publisher adds a weaker subscription and leaves the stronger one unchanged; a message
    received by both is written once. `lost` counts missing messages by their sequence numbers (0
    if the middleware has none). The subscription's events would report more losses, but with them
    Fast DDS wakes the executor for each message.
    """

    def __init__(self, node: Node, name: str, kind: type, depth: int, write: Write) -> None:
        self._node, self._name, self._kind, self._depth = node, name, kind, depth
        self._write = write
        self._requests: list[Qos] = []
        self._subscriptions: list[tuple[Subscription, Sequences]] = []
        self._repeats = Repeats()
        self.lost = 0

    def update(self, publishers: Sequence[Qos]) -> list[Qos]:
        """Add the subscriptions needed for the present publishers; returns the new ones."""
        added = missing_requests(publishers, self._requests, self._depth)
        for request in added:
            subscription = self._node.create_subscription(
                self._kind,
                self._name,
                self._receive,  # never called
                profile_of(request),
                raw=True,
                callback_group=_Polled(),
                event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            )
            self._subscriptions.append((subscription, Sequences()))
        self._requests += added
        return added

    def poll(self) -> None:
        """Write the messages received since; the middleware has noted their receive times."""
        before = self.lost
        for subscription, sequences in self._subscriptions:
            with subscription.handle:
                for _ in range(
                    self._depth
                ):  # others come meanwhile: they must not starve everything else
                    taken = subscription.handle.take_message(self._kind, True)
                    if taken is None:
                        break
                    self._receive(*taken)
                    number = taken[1].get("publication_sequence_number")
                    if number is not None:
                        self.lost += sequences.take(number, subscription.get_publisher_count)
        if self.lost > before:
            text = f"{self._name}: {self.lost - before} messages lost before they were received"
            self._node.get_logger().warning(text)

    def _receive(self, data: bytes, info: dict[str, Any]) -> None:
        received = info.get("received_timestamp") or time.time_ns()
        published = info.get("source_timestamp") or received
        content = bytes(data)
        may_repeat = len(self._requests) > 1 and published != received
        if not (may_repeat and self._repeats.seen(published, content)):
            self._write(self._name, content, received, published)
