"""Nodes without rclpy's default event handlers, which would double the cost of each wait, and that end well."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Iterator
from typing import Any

from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks

#: how long ROS may take to leave the graph (chosen: a loaded machine takes some seconds)
_LONGEST_END_S = 10.0
#: How long what a node says last may take to arrive: at load 30, what the network had lost was not
#: there after 1 s. A subscriber that was killed never answers.
_LAST_WORDS_S = 5.0


@contextlib.contextmanager
def ends_in_time() -> Iterator[None]:
    """Let ROS leave the graph, or end the process by SIGALRM.

    Fast DDS can spin for ever when it hears of another participant while it destroys its own
    (eProsima/Fast-DDS#6513), with the interpreter's lock held: then no handler of Python runs, and
    SIGINT and SIGTERM do nothing. An alarm without a handler ends the process all the same.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handler = signal.signal(signal.SIGALRM, signal.SIG_DFL)
    timer = signal.setitimer(signal.ITIMER_REAL, _LONGEST_END_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, *timer)
        signal.signal(signal.SIGALRM, handler or signal.SIG_DFL)


class LightNode:
    """Mixin before ``Node``: publishers and subscriptions have only the event handlers that are asked for.

    What a subclass has to finish, it finishes before ``super().destroy_node()``, which ends in
    time.

    By default rclpy adds two waitables to each, which log incompatible QoS (``ros2 topic info -v``
    shows it, too), and builds every wait set from all of them: 44 of the supervisor's 78 entities.
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

    def has_arrived(self, longest_s: float) -> bool:
        """Wait until all reliable subscribers have what was published; False if some still lack it after that time."""
        end_s = time.monotonic() + longest_s
        return all(
            publisher.wait_for_all_acked(Duration(seconds=max(end_s - time.monotonic(), 0.0)))
            for publisher in self.publishers  # type: ignore[attr-defined]
        )

    def destroy_node(self) -> None:
        """As ``Node.destroy_node``, but what was published arrives first, and see :func:`ends_in_time`."""
        with ends_in_time():
            if self.context.ok():  # type: ignore[attr-defined]
                self.has_arrived(_LAST_WORDS_S)
            super().destroy_node()  # type: ignore[misc]
