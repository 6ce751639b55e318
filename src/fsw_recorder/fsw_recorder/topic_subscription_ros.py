"""Hears all publishers of one topic, whatever QoS they offer and whenever they come."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node

from fsw_recorder.bag_metadata import OfferedQos
from fsw_recorder.qos_ros import profile_of
from fsw_recorder.repeats import Repeats
from fsw_recorder.sequence_gaps import SequenceGaps
from fsw_recorder.topic_selection import hears, requested_qos, strongest_first

_NO_SEQUENCE = 2**64 - 1

#: topic, message, receive time, publish time, sequence number
Write = Callable[[str, bytes, int, int, int], bool]


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
    gaps : SequenceGaps
        Gets the sequence numbers, and what the middleware reports as lost.
    """

    def __init__(self, node: Node, name: str, kind: type, depth: int, write: Write, gaps: SequenceGaps) -> None:
        self._node, self._name, self._kind, self._depth = node, name, kind, depth
        self._write, self._gaps = write, gaps
        self._requests: list[OfferedQos] = []
        self._subscriptions: list[Any] = []
        self._publishers: tuple[OfferedQos, ...] = ()
        self._repeats: Repeats | None = None

    @property
    def requests(self) -> list[OfferedQos]:
        """What the subscriptions ask for."""
        return list(self._requests)

    def update(self, publishers: Sequence[OfferedQos]) -> bool:
        """Subscribe to what the present publishers offer and no subscription hears; True when one was added."""
        found = tuple(strongest_first(publishers))
        if len(found) <= len(self._publishers):  # nobody new whose numbers would look like a gap
            self._gaps.confirm(self._name)
        if found == self._publishers:
            return False
        self._publishers = found
        self._gaps.forget(self._name)
        before = len(self._requests)
        for offer in found:
            if not any(hears(request, offer) for request in self._requests):
                self._add(requested_qos([offer], self._depth))
        return len(self._requests) > before

    def _add(self, request: OfferedQos) -> None:
        self._requests.append(request)
        if len(self._requests) > 1 and self._repeats is None:
            self._repeats = Repeats()
        self._subscriptions.append(
            self._node.create_subscription(
                self._kind,
                self._name,
                self._receive,
                profile_of(request),
                raw=True,
                event_callbacks=SubscriptionEventCallbacks(message_lost=self._lost),
            )
        )

    def _receive(self, data: bytes, info: dict[str, Any]) -> None:
        received = info.get("received_timestamp") or time.time_ns()
        published = info.get("source_timestamp") or received
        content = bytes(data)
        if self._repeats is not None and published != received and self._repeats.seen(published, content):
            return
        sequence = info.get("publication_sequence_number")
        if sequence is None or sequence == _NO_SEQUENCE:
            sequence = 0
        elif len(self._publishers) <= 1:  # the numbers of several interleave
            self._gaps.note(self._name, sequence)
        self._write(self._name, content, received, published, sequence)

    def _lost(self, status: Any) -> None:
        self._gaps.report(self._name, status.total_count_change)
        self._node.get_logger().warning(
            f"{self._name}: {status.total_count_change} messages lost before they were received"
        )
