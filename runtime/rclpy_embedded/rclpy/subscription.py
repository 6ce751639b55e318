"""Subscriptions."""

import time
from collections.abc import Callable
from enum import Enum
from typing import Any, TypedDict

from rclpy.impl import faults
from rclpy.impl.dds import matched
from rclpy.impl.endpoint import TopicEndpoint
from rclpy.impl.memory import LARGE, keep_freed_memory
from rclpy.impl.session import Reader
from rclpy.utilities import takes

from rosidl_embedded.typesupport import type_support


class MessageInfo(TypedDict):
    """Metadata of a received message; times are nanoseconds since 1970."""

    source_timestamp: int
    received_timestamp: int
    publication_sequence_number: int | None
    reception_sequence_number: int | None


class MessageReader(Reader):
    """The handle of a subscription."""

    def take_message(self, msg_type: Any, raw: bool) -> tuple[Any, MessageInfo] | None:
        """Take the next message and its metadata, None if there is none (or only a malformed one)."""
        for sample in self.take(1):
            info = sample.sample_info
            if not info.valid_data:
                continue
            data = sample.data
            if len(data) > LARGE:
                keep_freed_memory()
            try:
                message = data if raw else type_support(msg_type).deserialize(data)
            except ValueError as error:
                faults.count(self.name, f"malformed message on '{self.name}': {error}")
                continue
            return message, MessageInfo(
                source_timestamp=info.source_timestamp,
                received_timestamp=time.time_ns(),
                publication_sequence_number=None,
                reception_sequence_number=None,
            )
        return None


class Subscription(TopicEndpoint):
    """Receives messages of a topic; created by ``Node.create_subscription``."""

    class CallbackType(Enum):
        """What the callback takes."""

        MessageOnly = 0
        WithMessageInfo = 1

    _kind = MessageReader

    def __init__(self, *args: Any, callback: Callable[..., Any], raw: bool) -> None:
        self.callback = callback
        self.raw = raw
        super().__init__(*args)

    @property
    def callback(self) -> Callable[..., Any]:
        """The function that is called with each message (and its MessageInfo, if it takes two arguments)."""
        return self._callback

    @callback.setter
    def callback(self, value: Callable[..., Any]) -> None:
        for arguments, callback_type in enumerate(Subscription.CallbackType, 1):
            if takes(value, arguments):
                self._callback, self._callback_type = value, callback_type
                return
        raise RuntimeError(
            "Subscription.__init__(): callback should be either be callable with one argument"
            "(to get only the message) or two (to get message and message info)"
        )

    def get_publisher_count(self) -> int:
        with self.using("failed to get publisher count") as reader:
            return len(matched(reader.get_matched_publications))

    def take(self) -> tuple[Any, MessageInfo] | None:
        """Take the next message and its metadata, None if there is none (or only a malformed one)."""
        taken: tuple[Any, MessageInfo] | None = self._use(self.handle.take_message, self.msg_type, self.raw)
        return taken

    def _take(self) -> Callable[[], Any] | None:
        taken = self.take()
        if taken is None:
            return None
        if self._callback_type is Subscription.CallbackType.MessageOnly:
            return lambda: self._callback(taken[0])
        return lambda: self._callback(*taken)
