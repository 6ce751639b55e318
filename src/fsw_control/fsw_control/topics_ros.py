"""The topics of the weld as all nodes use them: quality of service, sensors and set-points."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Temperature

from fsw_control import messages_ros as convert
from fsw_control.contract import Command, Reference
from fsw_control.references import ReferenceQueue
from fsw_msgs.msg import DriveFeedback, ShoulderDepth, SpindleTorque, WeldReference

STREAM = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
#: the last message is kept for who comes later
LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
#: set-points; as deep as a scenario's are sent ahead
LATCHED = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)

#: by sensor (of ``SENSORS``): topic, message, and its value in the paper's units
_SENSOR_TOPICS: dict[str, tuple[str, Any, Callable[[Any], float]]] = {
    "depth": ("fsw/depth", ShoulderDepth, convert.depth_mm),
    "torque": ("fsw/spindle_torque", SpindleTorque, convert.torque_nm),
    "thermocouple": ("fsw/thermocouple", Temperature, convert.temperature_c),
}


def subscribe_sensors(node: Node, take: Callable[[str, int, float], None]) -> None:
    """Subscribe to the sensors.

    Parameters
    ----------
    node : Node
    take : callable
        Gets each sample: the sensor's name (one of ``SENSORS``), the stamp in ns, the value in mm, N m or degC.
    """

    def subscribe(sensor: str, topic: str, kind: Any, value: Callable[[Any], float]) -> None:
        def on_sample(message: Any) -> None:
            take(sensor, convert.stamp_ns(message.header.stamp), value(message))

        node.create_subscription(kind, topic, on_sample, STREAM)

    for sensor, (topic, kind, value) in _SENSOR_TOPICS.items():
        subscribe(sensor, topic, kind, value)


def subscribe_drives(node: Node, take: Callable[[int, Command], None]) -> None:
    """Subscribe to what the drives report; before the sensors, so that an executor finds it first.

    Parameters
    ----------
    node : Node
    take : callable
        Gets each sample: the stamp in ns, and the force and speed that act.
    """

    def on_feedback(message: DriveFeedback) -> None:
        take(convert.stamp_ns(message.header.stamp), convert.drives(message))

    node.create_subscription(DriveFeedback, "fsw/drives", on_feedback, STREAM)


def subscribe_references(node: Node, queue: ReferenceQueue, refuse: Callable[[str], None]) -> None:
    """Subscribe to the set-points that are sent, and to those that a supervisor states for who comes later.

    Parameters
    ----------
    node : Node
    queue : ReferenceQueue
        Takes them.
    refuse : callable
        Gets what is wrong with a message that is not taken.
    """

    def on_sent(message: WeldReference, info: Any) -> None:
        _take(queue, message, info["source_timestamp"], refuse)

    node.create_subscription(WeldReference, "fsw/reference", on_sent, LATCHED)
    subscribe_stated_reference(node, queue, "fsw/supervisor/reference", refuse)


def subscribe_stated_reference(node: Node, queue: ReferenceQueue, topic: str, refuse: Callable[[str], None]) -> None:
    """Subscribe to what another listener states with a :class:`StatedReference`; arguments as above."""

    def on_stated(message: WeldReference) -> None:
        _take(queue, message, convert.issued_ns(message), refuse)

    node.create_subscription(WeldReference, topic, on_stated, LATEST)


def _take(queue: ReferenceQueue, message: WeldReference, issued_ns: int, refuse: Callable[[str], None]) -> None:
    try:
        reference = convert.reference(message)
    except ValueError as error:
        refuse(str(error))
        return
    queue.add(convert.stamp_ns(message.header.stamp), reference, issued_ns)


class StatedReference:
    """States, latched, which set-points hold, for those who come when their sender has left.

    Parameters
    ----------
    node : Node
    topic : str
        Of which this is the only writer.
    """

    def __init__(self, node: Node, topic: str) -> None:
        self._node = node
        self._publisher = node.create_publisher(WeldReference, topic, LATEST)
        self._told: tuple[Reference, int] | None = None
        self._tick_ns = -1

    def tell(self, tick_ns: int, reference: Reference | None, issued_ns: int) -> None:
        """State what holds at a tick, if it has changed or time has begun anew.

        Parameters
        ----------
        tick_ns : int
        reference : Reference or None
            None: nothing yet.
        issued_ns : int
            When it was issued.
        """
        began_anew, self._tick_ns = tick_ns < self._tick_ns, tick_ns
        if reference is None or (not began_anew and (reference, issued_ns) == self._told):
            return
        self._told = (reference, issued_ns)
        self._publisher.publish(convert.stated_reference_message(reference, tick_ns, issued_ns))

    def close(self) -> None:
        """Take it back."""
        self._node.destroy_publisher(self._publisher)
