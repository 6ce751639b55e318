"""Wait for one message."""

import time
from typing import Any

from rclpy.constants import INT64_MAX
from rclpy.impl.wait_set import WaitSet
from rclpy.qos import QoSProfile
from rclpy.utilities import timeout_sec_to_nsec


def wait_for_message(
    msg_type: Any, node: Any, topic: str, *, qos_profile: QoSProfile | int = 1, time_to_wait: float = -1
) -> tuple[bool, Any]:
    """Wait for the next message on a topic; the node need not spin.

    Returns (True, message), or (False, None) when the time (in seconds; negative: no limit) is over or the context is
    shut down.
    """
    timeout_ns = timeout_sec_to_nsec(time_to_wait)
    deadline = INT64_MAX if timeout_ns < 0 else time.monotonic_ns() + timeout_ns
    subscription = node.create_subscription(msg_type, topic, lambda _: None, qos_profile)
    try:
        with subscription.using("failed to wait for a message"), WaitSet(node.context.session) as conditions:
            node.context._wakers.add(conditions)
            conditions.update([subscription.condition])
            while node.context.ok():
                if (taken := subscription.take()) is not None:
                    return True, taken[0]
                remaining = deadline - time.monotonic_ns()
                if remaining <= 0:
                    break
                conditions.wait(remaining)
    finally:
        node.destroy_subscription(subscription)
    return False, None
