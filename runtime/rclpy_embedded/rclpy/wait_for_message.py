"""Wait for one message."""

import time
from typing import Any

from rclpy.constants import INT64_MAX, S_TO_NS
from rclpy.impl.wait_set import WaitSet
from rclpy.qos import QoSProfile


def wait_for_message(
    msg_type: Any, node: Any, topic: str, *, qos_profile: QoSProfile | int = 1, time_to_wait: float = -1
) -> tuple[bool, Any]:
    """Wait for the next message on a topic; the node need not spin.

    Returns (True, message), or (False, None) when the time (in seconds; negative: no limit) is over or the context is
    shut down.
    """
    end_ns = None if time_to_wait < 0 else time.monotonic_ns() + int(time_to_wait * S_TO_NS)
    subscription = node.create_subscription(msg_type, topic, lambda _: None, qos_profile)
    wait_set = WaitSet(node.context.session)
    node.context._wakers.add(wait_set)
    try:
        wait_set.update([subscription.condition])
        while (taken := subscription.take()) is None:
            left_ns = INT64_MAX if end_ns is None else end_ns - time.monotonic_ns()
            if left_ns <= 0 or not node.context.ok():
                return False, None
            wait_set.wait(left_ns)
        return True, taken[0]
    finally:
        node.context._wakers.discard(wait_set)
        wait_set.close()
        node.destroy_subscription(subscription)
