"""Where ROS clocks get their time from."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any

from rcl_interfaces import msg as rcl_msg
from rclpy.clock import ROSClock
from rclpy.clock_type import ClockType
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

CLOCK_TOPIC = "/clock"
USE_SIM_TIME_NAME = "use_sim_time"


class TimeSource:
    """Drives ROS clocks: from /clock while the node's parameter ``use_sim_time`` is true, else from the system."""

    def __init__(self, *, node: Any = None) -> None:
        self._clock_sub: Subscription | None = None
        self._get_node: Callable[[], Any] = lambda: None
        self._associated_clocks: set[ROSClock] = set()
        # Zero: no time has come yet.
        self._last_time_set = Time(clock_type=ClockType.ROS_TIME)
        self._ros_time_is_active = False
        if node is not None:
            self.attach_node(node)

    @property
    def ros_time_is_active(self) -> bool:
        return self._ros_time_is_active

    @ros_time_is_active.setter
    def ros_time_is_active(self, enabled: bool) -> None:
        if self._ros_time_is_active == enabled:
            return
        self._ros_time_is_active = enabled
        for clock in list(self._associated_clocks):
            clock._set_ros_time_is_active(enabled)
        node = self._get_node()
        if enabled and self._clock_sub is None and node is not None:
            qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
            self._clock_sub = node.create_subscription(Clock, CLOCK_TOPIC, self.clock_callback, qos)
        elif not enabled:
            self._unsubscribe()

    def _unsubscribe(self) -> None:
        node = self._get_node()
        if self._clock_sub is not None and node is not None:
            node.destroy_subscription(self._clock_sub)
            self._clock_sub = None

    def attach_node(self, node: Any) -> None:
        """Follow a node's ``use_sim_time``, declaring it if need be; a node attached before is detached."""
        # Not by its class, which imports this module.
        if not hasattr(node, "add_on_set_parameters_callback"):
            raise TypeError("Node must be of type rclpy.node.Node")
        self.detach_node()
        self._get_node = weakref.ref(node)
        if not node.has_parameter(USE_SIM_TIME_NAME):
            node.declare_parameter(USE_SIM_TIME_NAME, False)
        parameter = node.get_parameter(USE_SIM_TIME_NAME)
        if parameter.type_ is Parameter.Type.BOOL:
            self.ros_time_is_active = parameter.value
        elif parameter.type_ is not Parameter.Type.NOT_SET:
            node.get_logger().error(f"Invalid type for parameter '{parameter.name}' {parameter.type_!r} should be bool")
        node.add_on_set_parameters_callback(self._on_parameter_event)

    def detach_node(self) -> None:
        """Detach the node; RuntimeError if it no longer exists and its subscription cannot be destroyed."""
        if self._clock_sub is not None and self._get_node() is None:
            raise RuntimeError("Unable to destroy previously created clock subscription")
        self._unsubscribe()
        self._get_node = lambda: None

    def attach_clock(self, clock: ROSClock) -> None:
        """Drive a clock; ValueError if it is no ROSClock."""
        if not isinstance(clock, ROSClock):
            raise ValueError("Only clocks with type ROS_TIME can be attached.")
        clock.set_ros_time_override(self._last_time_set)
        clock._set_ros_time_is_active(self.ros_time_is_active)
        self._associated_clocks.add(clock)

    def clock_callback(self, msg: Clock) -> None:
        """Take the time from a message on /clock; a negative one is ignored."""
        if msg.clock.sec < 0:
            if (node := self._get_node()) is not None:
                node.get_logger().warning(f"Ignored negative time on {CLOCK_TOPIC}: {msg.clock.sec} s", once=True)
            return
        # Kept for clocks that are attached later.
        self._last_time_set = Time.from_msg(msg.clock)
        for clock in list(self._associated_clocks):
            clock.set_ros_time_override(self._last_time_set)

    def _on_parameter_event(self, parameter_list: list[Parameter]) -> rcl_msg.SetParametersResult:
        values = {parameter.name: parameter.value for parameter in parameter_list}
        value = values.get(USE_SIM_TIME_NAME, self.ros_time_is_active)
        if not isinstance(value, bool):
            reason = f"{USE_SIM_TIME_NAME} parameter set to something besides a bool"
            if (node := self._get_node()) is not None:
                node.get_logger().error(reason)
            return rcl_msg.SetParametersResult(successful=False, reason=reason)
        self.ros_time_is_active = value
        return rcl_msg.SetParametersResult(successful=True)
