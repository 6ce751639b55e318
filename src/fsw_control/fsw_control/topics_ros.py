"""The topics of the weld as all nodes use them: quality of service, sensors and drives."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from fsw_control import messages_ros as convert
from fsw_control.contract import Command
from fsw_control.sensors import OPTIONAL, REQUIRED, SENSORS
from fsw_msgs.msg import DriveFeedback

#: to subscribe to samples: a slow node skips to the latest ones
STREAM = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
#: To publish samples and simulated time: they are kept until they have arrived. Lockstep, at
#: several hundred ticks/s, waits for the recorder only now and then; it may stand still for 0.2 s
#: on a busy machine and must not miss any.
SENT = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
#: the last message is kept for late joiners
LATEST = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
#: to publish what is replaced often, and is recorded as a whole
REPLACED = QoSProfile(
    depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
#: set-points; as deep as a scenario's are sent ahead
LATCHED = QoSProfile(
    depth=1000, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)

#: What parameters ``qos_overrides.<topic>.publisher.*`` may override on topics that nothing
#: depends on: how many messages are kept for a slow display.
DISPLAY = QoSOverridingOptions([QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH])

#: In lockstep the player says here of which depth it has sent all that belongs before the next
#: tick.
PLAYER_READY = "fsw/player_ready"

#: the sensors as they are announced, sent and subscribed to: the last required one completes a
#: tick
_ORDER = (*OPTIONAL, *REQUIRED)


def display_publisher(node: Node, kind: Any, topic: str) -> Publisher:
    """A publisher of what is only displayed; ``DISPLAY`` says what parameters may override.

    It has a profile of its own, because rclpy writes what is overridden into the one it is given.
    """
    return node.create_publisher(kind, topic, copy(SENT), qos_overriding_options=DISPLAY)


def sensor_publishers(node: Node) -> dict[str, Publisher]:
    """Publishers of the sensors by name, in the order in which the samples of a tick are to be sent."""
    return {
        name: node.create_publisher(convert.message_type(name), SENSORS[name].topic, SENT)
        for name in _ORDER
    }


def subscribe_sensors(node: Node, take: Callable[[str, int, float], None]) -> list[Subscription]:
    """Subscribe to the sensors; ``take`` gets name (of ``SENSORS``), stamp in ns, and value in mm, N m or degC."""

    def subscribe(sensor: str) -> Subscription:
        def on_sample(message: Any) -> None:
            take(
                sensor,
                convert.stamp_ns(message.header.stamp),
                convert.sensor_value(sensor, message),
            )

        return node.create_subscription(
            convert.message_type(sensor), SENSORS[sensor].topic, on_sample, STREAM
        )

    return [subscribe(sensor) for sensor in _ORDER]


def subscribe_drives(node: Node, take: Callable[[int, Command], None]) -> None:
    """Subscribe to the drives' feedback; ``take`` gets the stamp in ns and the actual values.

    To be called before :func:`subscribe_sensors`, so that an executor finds this topic first.
    """

    def on_feedback(message: DriveFeedback) -> None:
        take(convert.stamp_ns(message.header.stamp), convert.command(message))

    node.create_subscription(DriveFeedback, "fsw/drives", on_feedback, STREAM)
