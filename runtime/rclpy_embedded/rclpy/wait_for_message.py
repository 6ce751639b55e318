"""Wait for one message."""

from typing import Any

from rclpy.qos import QoSProfile
from rclpy.utilities import wait_until


def wait_for_message(
    msg_type: Any, node: Any, topic: str, *, qos_profile: QoSProfile | int = 1, time_to_wait: float = -1
) -> tuple[bool, Any]:
    """Wait for the next message on a topic; the node need not spin.

    Returns (True, message), or (False, None) when the time (in seconds; negative: no limit) is over or the context is
    shut down.
    """
    subscription = node.create_subscription(msg_type, topic, lambda _: None, qos_profile)
    message: list[Any] = []

    def arrived() -> bool:
        message.extend((subscription.take() or ())[:1])
        return bool(message)

    try:
        found = wait_until(arrived, None if time_to_wait < 0 else time_to_wait, node.context)
    finally:
        node.destroy_subscription(subscription)
    return found, message[0] if found else None
