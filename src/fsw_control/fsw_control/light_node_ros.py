"""Nodes without rclpy's default event handlers, which would double the cost of each wait of an executor."""

from __future__ import annotations

from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks


class LightNode:
    """Mixin before ``Node``: publishers and subscriptions have only the event handlers that are asked for.

    By default rclpy adds two waitables to each, which log incompatible QoS (``ros2 topic info -v`` shows it, too), and
    builds every wait set from all of them: 44 of the supervisor's 78 entities.
    """

    def create_publisher(self, *arguments: Any, **options: Any) -> Any:
        """As ``Node.create_publisher``."""
        if options.get("event_callbacks") is None:
            options["event_callbacks"] = PublisherEventCallbacks(use_default_callbacks=False)
        return super().create_publisher(*arguments, **options)  # type: ignore[misc]

    def create_subscription(self, *arguments: Any, **options: Any) -> Any:
        """As ``Node.create_subscription``."""
        if options.get("event_callbacks") is None:
            options["event_callbacks"] = SubscriptionEventCallbacks(use_default_callbacks=False)
        return super().create_subscription(*arguments, **options)  # type: ignore[misc]
