"""Publishers."""

from typing import Any

from cyclonedds.core import DDSException
from cyclonedds.internal import DDS
from rclpy._rclpy_pybind11 import RCLError
from rclpy.constants import INT64_MAX
from rclpy.duration import Duration
from rclpy.impl.dds import matched
from rclpy.impl.endpoint import TopicEndpoint
from rclpy.impl.memory import LARGE, keep_freed_memory
from rclpy.impl.session import Writer
from rclpy.qos import ReliabilityPolicy

# In between, Python can handle a signal.
_LONGEST_WAIT_NS = 500_000_000


def _acked(writer: Any, timeout_ns: int) -> bool:
    try:
        return bool(writer.wait_for_acks(timeout_ns))
    except AttributeError:  # how cyclonedds 11.0.1 reports its timeout
        return False


class Publisher(TopicEndpoint):
    """Sends messages on a topic; created by ``Node.create_publisher``."""

    _kind = Writer

    @property
    def logger_name(self) -> str:
        return self._local_node.logger_name

    def publish(self, msg: Any) -> None:
        """Send a message, or the bytes of a serialized one."""
        writer = self._handle or self.handle
        self._local_node.session.check("Failed to publish")
        if isinstance(msg, self.msg_type):
            data = self._support.serialize(msg)
        elif isinstance(msg, bytes):
            if len(msg) < 4:
                raise RCLError(f"Failed to publish: {len(msg)} bytes are not a serialized message")
            data = msg
        else:
            raise TypeError(f"Expected {self.msg_type}, got {type(msg)}")
        if len(data) > LARGE:
            keep_freed_memory()
        self._use(writer.write, writer.data_type(data))

    def get_subscription_count(self) -> int:
        with self.using("failed to get subscription count") as writer:
            return len(matched(writer.get_matched_subscriptions))

    def assert_liveliness(self) -> None:
        """Assert that this publisher is alive, for liveliness MANUAL_BY_TOPIC."""
        with self.using("Failed to assert liveliness on the Publisher") as writer:
            # The Python API of Cyclone DDS lacks this one call.
            code = DDS._dll_handle.dds_assert_liveliness(writer._ref)
            if code < 0:
                raise DDSException(code, "while asserting liveliness")

    def wait_for_all_acked(self, timeout: Duration = Duration(seconds=-1)) -> bool:  # noqa: B008
        """Wait until every matching reliable subscription has acknowledged everything; return whether all have.

        A negative timeout means no limit; with zero it does not wait. Best effort publishers need not wait.
        """
        with self.using("Failed to wait for all acknowledgements") as writer:
            if self.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT:
                return True
            remaining = timeout.nanoseconds if timeout.nanoseconds >= 0 else INT64_MAX
            while not _acked(writer, min(remaining, _LONGEST_WAIT_NS)):
                remaining -= _LONGEST_WAIT_NS
                if remaining <= 0:
                    return False
            return True
