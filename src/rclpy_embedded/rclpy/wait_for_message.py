"""Wait for one message."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from rclpy.impl.wait_set import ConditionSet
from rclpy.qos import QoSProfile
from rclpy.utilities import timeout_sec_to_nsec

if TYPE_CHECKING:
    from rclpy.node import Node


def wait_for_message(
    msg_type: Any, node: Node, topic: str, *, qos_profile: QoSProfile | int = 1, time_to_wait: float = -1
) -> tuple[bool, Any]:
    """Wait for the next message on a topic; the node need not spin.

    Parameters
    ----------
    time_to_wait : float
        Seconds; negative for ever.

    Returns
    -------
    (True, message), or (False, None) when the time is over or the context is shut down.
    """
    timeout_ns = timeout_sec_to_nsec(time_to_wait)
    deadline = None if timeout_ns < 0 else time.monotonic_ns() + timeout_ns
    subscription = node.create_subscription(msg_type, topic, lambda _: None, qos_profile=qos_profile)
    conditions = ConditionSet(node.context.session)
    node.context._wakers.add(conditions)
    try:
        conditions.update([subscription.condition], lambda _: False)
        while node.context.ok():
            taken = subscription.take()
            if taken is not None:
                return True, taken[0]
            remaining = None if deadline is None else deadline - time.monotonic_ns()
            if remaining is not None and remaining <= 0:
                break
            conditions.wait(1_000_000_000 if remaining is None else remaining)
    finally:
        conditions.close()
        node.destroy_subscription(subscription)
    return False, None
