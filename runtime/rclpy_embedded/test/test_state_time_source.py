"""The time source: which clocks follow /clock, and when."""

import pytest
from builtin_interfaces.msg import Time as TimeMsg
from rclpy.clock import Clock, ClockChange, JumpThreshold, ROSClock
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import ReliabilityPolicy
from rclpy.time import Time
from rclpy.time_source import TimeSource
from rosgraph_msgs.msg import Clock as ClockMsg


def stamp(seconds: int) -> ClockMsg:
    return ClockMsg(clock=TimeMsg(sec=seconds))


def use_sim_time(node: Node, value: object) -> str:
    return node.set_parameters([Parameter("use_sim_time", value=value)])[0].reason


def test_clocks_follow_the_source() -> None:
    source, early, late = TimeSource(), ROSClock(), ROSClock()
    source.attach_clock(early)
    source.ros_time_is_active = True
    assert early.now().nanoseconds == 0
    source.clock_callback(stamp(5))
    source.attach_clock(late)
    assert early.now() == late.now() == Time(seconds=5, clock_type=early.clock_type)
    source.ros_time_is_active = False
    assert not early.ros_time_is_active and late.now().nanoseconds > 10**18


def test_only_ros_clocks_can_be_attached() -> None:
    with pytest.raises(ValueError, match="Only clocks with type ROS_TIME"):
        TimeSource().attach_clock(Clock())
    with pytest.raises(TypeError, match=r"must be of type rclpy\.node\.Node"):
        TimeSource(node=object())


def test_use_sim_time_subscribes_and_unsubscribes(node: Node) -> None:
    changes = []
    handle = node.get_clock().create_jump_callback(
        JumpThreshold(min_forward=None, min_backward=None), post_callback=lambda jump: changes.append(jump.clock_change)
    )
    clock_subscriptions = [s for s in node.subscriptions if s.topic_name == "/clock"]
    assert node.get_parameter("use_sim_time").value is False and clock_subscriptions == []
    assert use_sim_time(node, True) == ""
    (subscription,) = [s for s in node.subscriptions if s.topic_name == "/clock"]
    assert (subscription.qos_profile.depth, subscription.qos_profile.reliability) == (1, ReliabilityPolicy.BEST_EFFORT)
    assert node.get_clock().now().nanoseconds == 0
    assert use_sim_time(node, False) == ""
    assert [s for s in node.subscriptions if s.topic_name == "/clock"] == []
    assert changes == [ClockChange.ROS_TIME_ACTIVATED, ClockChange.ROS_TIME_DEACTIVATED]
    handle.unregister()


def test_use_sim_time_must_be_a_bool(node: Node) -> None:
    assert "Wrong parameter type" in use_sim_time(node, 1)
    assert node.get_clock().ros_time_is_active is False


def test_a_negative_time_is_ignored(node: Node) -> None:
    use_sim_time(node, True)
    source = node._time_source
    for seconds in (3, -1):
        source.clock_callback(stamp(seconds))
    assert node.get_clock().now().seconds_nanoseconds() == (3, 0)


def test_another_node_can_be_followed(node: Node) -> None:
    source = TimeSource(node=node)
    use_sim_time(node, True)
    assert source.ros_time_is_active
    source.detach_node()
    assert source._get_node() is None
    source.attach_node(node)
    assert source._get_node() is node
