"""How a node joins the graph, what it leaves out, and how it leaves in bounded time."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions

from fsw_control import fast_dds
from fsw_control.schema.files import writable

#: longest time that ROS may take to leave the graph (chosen: a loaded machine takes some seconds)
_LONGEST_END_S = 10.0
#: Longest time to deliver a node's last messages: at load 30, retransmissions of lost packets took
#: more than 1 s. A subscriber that was killed never acknowledges.
_LAST_WORDS_S = 5.0
#: in lockstep, time limit for a delivery on a busy machine, also to a dead node; a standby
#: supervisor allows for it before it counts its leader as dead (chosen)
DELIVERY_S = 0.5
#: time within which a signal takes effect in a node that only waits
_LONGEST_WAIT_S = 0.2


def join(arguments: Sequence[str]) -> None:
    """As ``rclpy.init``, without its signal handlers, on the project's settings of the middleware.

    ROS writes its logs into the user's cache where the home folder cannot be written.

    Raises
    ------
    RuntimeError
        If the arguments or the environment are wrong.
    """
    os.environ.update(fast_dds.settings(os.environ))
    if not {"ROS_LOG_DIR", "ROS_HOME"} & os.environ.keys():
        os.environ["ROS_LOG_DIR"] = str(writable(Path("~/.ros"), "ros") / "log")
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)


@contextlib.contextmanager
def ends_in_time() -> Iterator[None]:
    """Leave the ROS graph, or end the process by SIGALRM if that takes too long.

    Fast DDS can spin for ever if it hears of another participant while it destroys its own
    (eProsima/Fast-DDS#6513), holding the interpreter's lock: no Python signal handler runs, and
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
    """Mixin before ``Node``: publishers and subscriptions with only the requested event handlers.

    A subclass finishes its own work before it calls ``super().destroy_node()``, whose duration is
    bounded.

    By default rclpy adds two waitables to each entity, which log incompatible QoS (``ros2 topic
    info -v`` shows it, too), and builds every wait set from all of them: 44 of the supervisor's
    78 entities, which doubles the cost of a wait.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._subscribers_receive = True  #: at the last :meth:`await_arrival`
        # Signal handlers of Python run between two waits: this ends each wait.
        make: Callable[..., Any] = self.create_timer  # type: ignore[attr-defined]
        make(_LONGEST_WAIT_S, lambda: None, clock=Clock(clock_type=ClockType.STEADY_TIME))

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

    def has_arrived(self, longest_s: float, *publishers: Publisher) -> bool:
        """Wait until all reliable subscribers have acknowledged; False after ``longest_s``.

        By default for all publishers of the node.
        """
        end_s = time.monotonic() + longest_s
        return all(
            publisher.wait_for_all_acked(Duration(seconds=max(end_s - time.monotonic(), 0.0)))
            for publisher in publishers or self.publishers  # type: ignore[attr-defined]
        )

    def await_arrival(self, longest_s: float, *publishers: Publisher) -> None:
        """As :meth:`has_arrived`, for lockstep, in which a recorder must not miss any message.

        A subscriber that is stalled for too long is not awaited again before it has caught up.
        """
        awaited = self._subscribers_receive
        self._subscribers_receive = self.has_arrived(longest_s if awaited else 0.0, *publishers)
        if awaited and not self._subscribers_receive:
            text = "a subscriber does not receive; continuing without it"
            self.get_logger().warning(text)  # type: ignore[attr-defined]

    def destroy_node(self) -> None:
        """As ``Node.destroy_node`` after delivery of the last messages, in bounded time."""
        with ends_in_time():
            if self.context.ok():  # type: ignore[attr-defined]
                self.has_arrived(_LAST_WORDS_S)
            super().destroy_node()  # type: ignore[misc]
