"""Subscriptions."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable
from enum import Enum
from typing import Any, TypedDict

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.impl import faults
from rclpy.impl.dds import any_sample, matched
from rclpy.impl.endpoint import Endpoint
from rclpy.impl.session import LocalNode, Session
from rclpy.qos import QoSProfile

from rosidl_embedded.typesupport import type_support


class MessageInfo(TypedDict):
    """What is known about a received message; times are nanoseconds since 1970."""

    source_timestamp: int
    received_timestamp: int
    publication_sequence_number: int | None
    reception_sequence_number: int | None


class Subscription(Endpoint):
    """Receives messages of a topic; made by ``Node.create_subscription``."""

    class CallbackType(Enum):
        """What the callback takes."""

        MessageOnly = 0
        WithMessageInfo = 1

    def __init__(
        self,
        session: Session,
        local_node: LocalNode,
        msg_type: Any,
        topic: str,
        topic_name: str,
        callback: Callable[..., Any],
        callback_group: CallbackGroup,
        qos_profile: QoSProfile,
        raw: bool,
        event_callbacks: SubscriptionEventCallbacks,
        logger_name: str,
    ) -> None:
        self.msg_type = msg_type
        self.topic = topic
        self.callback = callback
        self.callback_group = callback_group
        self.qos_profile = qos_profile
        self.raw = raw
        self._support = type_support(msg_type)
        reader = session.reader("rt" + topic_name, self._support, qos_profile)
        self.condition = any_sample(reader)
        super().__init__(session, local_node, topic_name, reader=reader)
        self.event_handlers = event_callbacks.create_event_handlers(callback_group, reader, topic, logger_name)

    @property
    def callback(self) -> Callable[..., Any]:
        """What is called with each message (and its MessageInfo, if it takes two arguments)."""
        return self._callback

    @callback.setter
    def callback(self, value: Callable[..., Any]) -> None:
        for callback_type, arguments in (
            (Subscription.CallbackType.MessageOnly, 1),
            (Subscription.CallbackType.WithMessageInfo, 2),
        ):
            try:
                inspect.signature(value).bind(*range(arguments))
            except TypeError:
                continue
            self._callback = value
            self._callback_type = callback_type
            return
        raise RuntimeError(
            "Subscription.__init__(): callback should be either be callable with one argument"
            "(to get only the message) or two (to get message and message info)"
        )

    @property
    def topic_name(self) -> str:
        """Full name of the topic."""
        return self._full_name()

    def get_publisher_count(self) -> int:
        """Return how many publishers match."""
        return len(matched(self.handle.get_matched_publications))

    def take(self) -> tuple[Any, MessageInfo] | None:
        """Take the next message and what is known about it, None if there is none (or only a malformed one)."""
        for sample in self.handle.take(1):
            info = sample.sample_info
            if not info.valid_data:
                continue
            if self.raw:
                message = sample.data
            else:
                try:
                    message = self._support.deserialize(sample.data)
                except ValueError as error:
                    faults.count(self._name, f"malformed message on '{self._name}': {error}")
                    continue
            return message, MessageInfo(
                source_timestamp=info.source_timestamp,
                received_timestamp=time.time_ns(),
                publication_sequence_number=None,
                reception_sequence_number=None,
            )
        return None

    def _take(self) -> Callable[[], Any] | None:
        taken = self.take()
        if taken is None:
            return None
        if self._callback_type is Subscription.CallbackType.MessageOnly:
            return lambda: self._callback(taken[0])
        return lambda: self._callback(*taken)
