"""Topics of the weld for all nodes: quality of service, sensors and drives."""

from __future__ import annotations

from collections.abc import Callable, Container
from copy import copy
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from fsw_control import messages_ros as convert
from fsw_control import units
from fsw_control.contract import Command
from fsw_control.sensors import OPTIONAL, REQUIRED, SENSORS
from fsw_msgs.msg import DriveFeedback

#: subscriptions to samples: a slow node skips to the latest ones
STREAM = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
#: Publishers of samples and simulated time: samples are kept until they have arrived. Lockstep, at
#: several hundred ticks/s, waits for the recorder only now and then; it may be stalled for 0.2 s
#: on a busy machine and must not miss any.
SENT = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)


def latched(depth: int) -> QoSProfile:
    """Profile of a topic whose last messages are kept for late joiners."""
    kept, reliable = DurabilityPolicy.TRANSIENT_LOCAL, ReliabilityPolicy.RELIABLE
    return QoSProfile(depth=depth, reliability=reliable, durability=kept)


#: the last message is kept for late joiners
LATEST = latched(1)
#: Publishers of set-points, as deep as the number that a scenario sends ahead, and of values that
#: are replaced often and recorded completely: a recorder may be stalled.
LATCHED = latched(1000)

#: What parameters ``qos_overrides.<topic>.publisher.*`` may override on topics that are only
#: displayed: the number of messages kept for a slow display.
DISPLAY = QoSOverridingOptions([QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH])

#: In lockstep the player reports here up to which depth sample it has sent everything that belongs
#: before the next tick.
PLAYER_READY = "fsw/player_ready"

#: order in which the sensors are announced, sent and subscribed to: the last required one
#: completes a tick
_ORDER = (*OPTIONAL, *REQUIRED)


def display_publisher(node: Node, kind: Any, topic: str) -> Publisher:
    """Create a publisher of displayed data; ``DISPLAY`` lists what parameters may override.

    It has its own profile, because rclpy writes the overrides into the profile that it gets.
    """
    return node.create_publisher(kind, topic, copy(SENT), qos_overriding_options=DISPLAY)


def sensor_publishers(node: Node, present: Container[str] = SENSORS) -> dict[str, Publisher]:
    """Publishers of the sensors by name, in the order in which a tick's samples must be sent."""
    return {
        name: node.create_publisher(convert.message_type(name), SENSORS[name].topic, SENT)
        for name in _ORDER
        if name in present
    }


def subscribe_sensors(
    node: Node,
    take: Callable[[str, int, float], None],
    take_deviation: Callable[[int, float], None] | None = None,
) -> list[Subscription]:
    """Subscribe to the sensors.

    ``take`` gets the name (of ``SENSORS``), the stamp in ns, and the value in mm, N m or degC;
    before it, ``take_deviation`` the stamp and the standard deviation of the depth in mm.
    """

    def subscribe(sensor: str) -> Subscription:
        def on_sample(message: Any) -> None:
            stamp_ns = convert.stamp_ns(message.header.stamp)
            if take_deviation is not None and sensor == "depth":
                take_deviation(stamp_ns, units.mm_from_m(message.standard_deviation))
            take(sensor, stamp_ns, convert.sensor_value(sensor, message))

        kind, topic = convert.message_type(sensor), SENSORS[sensor].topic
        return node.create_subscription(kind, topic, on_sample, STREAM)

    return [subscribe(sensor) for sensor in _ORDER]


def subscribe_drives(node: Node, take: Callable[[int, Command], None]) -> None:
    """Subscribe to the drives' feedback; ``take`` gets the stamp in ns and the actual values.

    Call it before :func:`subscribe_sensors`, so that an executor serves this topic first.
    """

    def on_feedback(message: DriveFeedback) -> None:
        take(convert.stamp_ns(message.header.stamp), convert.command(message))

    node.create_subscription(DriveFeedback, "fsw/drives", on_feedback, STREAM)
