"""Publishers."""

from __future__ import annotations

from typing import Any

from cyclonedds.core import DDSException
from rclpy.callback_groups import CallbackGroup
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.exceptions import RCLError
from rclpy.impl.dds import INFINITE_NS, matched, raw_type
from rclpy.impl.endpoint import Endpoint
from rclpy.impl.liveliness import assert_liveliness
from rclpy.impl.session import LocalNode, Session
from rclpy.qos import QoSProfile, QoSReliabilityPolicy

from rosidl_embedded.typesupport import type_support

# In between, Python gets the chance to handle a signal.
_LONGEST_WAIT_NS = 500_000_000


def _acked(writer: Any, timeout_ns: int) -> bool:
    try:
        return bool(writer.wait_for_acks(timeout_ns))
    except AttributeError:  # how cyclonedds 11.0.1 reports its timeout
        return False


class Publisher(Endpoint):
    """Sends messages on a topic; made by ``Node.create_publisher``."""

    def __init__(
        self,
        session: Session,
        local_node: LocalNode,
        msg_type: Any,
        topic: str,
        topic_name: str,
        qos_profile: QoSProfile,
        event_callbacks: PublisherEventCallbacks,
        callback_group: CallbackGroup,
        logger_name: str,
    ) -> None:
        self.msg_type = msg_type
        self.topic = topic
        self.qos_profile = qos_profile
        self._support = type_support(msg_type)
        self._sample = raw_type(self._support.dds_name)
        writer = session.writer("rt" + topic_name, self._support, qos_profile)
        super().__init__(session, local_node, topic_name, writer=writer)
        self.event_handlers = event_callbacks.create_event_handlers(callback_group, writer, topic, logger_name)

    @property
    def topic_name(self) -> str:
        """Full name of the topic."""
        return self._full_name()

    @property
    def logger_name(self) -> str:
        """Name of the node's logger."""
        return f"{self._local_node.namespace.strip('/')}/{self._local_node.name}".strip("/").replace("/", ".")

    def publish(self, msg: Any) -> None:
        """Send a message, or the bytes of a serialized one.

        Raises
        ------
        TypeError
            If it is of another type than the publisher.
        InvalidHandle
            After destruction.
        """
        writer = self._writer if self._writer is not None else self.handle
        if isinstance(msg, self.msg_type):
            data = self._support.serialize(msg)
        elif isinstance(msg, bytes):
            if len(msg) < 4:
                raise RCLError(f"Failed to publish: {len(msg)} bytes are not a serialized message")
            data = msg
        else:
            raise TypeError(f"Expected {self.msg_type}, got {type(msg)}")
        try:
            writer.write(self._sample(data))
        except DDSException as error:
            raise RCLError(f"Failed to publish: {error}") from error

    def get_subscription_count(self) -> int:
        """Return how many subscriptions match."""
        return len(matched(self.handle.get_matched_subscriptions))

    def assert_liveliness(self) -> None:
        """Say that this publisher is alive, for liveliness MANUAL_BY_TOPIC."""
        assert_liveliness(self.handle)

    def wait_for_all_acked(self, timeout: Duration = Duration(seconds=-1)) -> bool:  # noqa: B008
        """Wait until every matching reliable subscription has acknowledged everything.

        A negative timeout means for ever, zero only looks. Best effort publishers need not wait.

        Returns
        -------
        bool
            Whether all was acknowledged in time.
        """
        if self.qos_profile.reliability == QoSReliabilityPolicy.BEST_EFFORT:
            return True
        remaining = timeout.nanoseconds if timeout.nanoseconds >= 0 else INFINITE_NS
        while not _acked(self.handle, min(remaining, _LONGEST_WAIT_NS)):
            remaining -= _LONGEST_WAIT_NS
            if remaining <= 0:
                return False
        return True
