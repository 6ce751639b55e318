"""Times, durations, clocks and simulated time."""

from __future__ import annotations

import contextlib
import threading
import time
from typing import Any

import pytest
from rclpy.clock import Clock, ClockChange, JumpThreshold, ROSClock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.exceptions import NotInitializedException
from rclpy.parameter import Parameter
from rclpy.time import Time
from rosgraph_msgs.msg import Clock as ClockMsg


def test_arithmetic() -> None:
    early, late = Time(seconds=1, nanoseconds=5), Time(seconds=3)
    assert late - early == Duration(seconds=2, nanoseconds=-5)
    assert early + Duration(nanoseconds=-5) == Time(seconds=1)
    assert early < late and late >= early and early != late
    assert Time.from_msg(early.to_msg()).nanoseconds == early.nanoseconds
    assert early.seconds_nanoseconds() == (1, 5)
    with pytest.raises(TypeError):
        _ = early < Time(seconds=1, clock_type=ClockType.ROS_TIME)
    with pytest.raises(TypeError):
        _ = early - Time(seconds=1, clock_type=ClockType.STEADY_TIME)
    with pytest.raises(ValueError):
        Time(nanoseconds=-1)


@pytest.mark.parametrize("clock_type", [ClockType.SYSTEM_TIME, ClockType.STEADY_TIME, ClockType.ROS_TIME])
def test_clocks_advance(clock_type: ClockType) -> None:
    clock = Clock(clock_type=clock_type)
    before_ns = time.time_ns()
    first = clock.now()
    assert first.clock_type == clock.clock_type == clock_type
    after_ns = time.time_ns()
    assert clock.now() >= first
    if clock_type != ClockType.STEADY_TIME:
        assert before_ns <= first.nanoseconds <= after_ns
    assert isinstance(clock, ROSClock) is (clock_type == ClockType.ROS_TIME)


def test_sleep(context: Any) -> None:
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    start = time.monotonic()
    assert clock.sleep_for(Duration(seconds=0.05), context)
    assert time.monotonic() - start >= 0.05
    assert clock.sleep_until(clock.now() - Duration(seconds=1), context)
    with pytest.raises(ValueError):
        clock.sleep_until(Time(seconds=1), context)


def test_sleep_ends_with_the_context(context: Any) -> None:
    threading.Timer(0.05, context.shutdown).start()
    # A sleep that had not begun by then is refused.
    with contextlib.suppress(NotInitializedException):
        assert not Clock().sleep_for(Duration(seconds=60), context)
    assert not context.ok()


def test_simulated_time(node: Any, spinner: Any) -> None:
    jumps: list[Any] = []
    clock = node.get_clock()
    threshold = JumpThreshold(
        min_forward=Duration(seconds=1), min_backward=Duration(nanoseconds=-1), on_clock_change=True
    )
    handle = clock.create_jump_callback(threshold, post_callback=jumps.append)
    publisher = node.create_publisher(ClockMsg, "/clock", 10)

    def show(seconds: float) -> None:
        stamp = Time(nanoseconds=int(seconds * 1e9))
        publisher.publish(ClockMsg(clock=stamp.to_msg()))
        assert spinner.until(lambda: clock.now().nanoseconds == stamp.nanoseconds)

    assert not clock.ros_time_is_active
    node.set_parameters([Parameter("use_sim_time", value=True)])
    assert clock.ros_time_is_active
    assert [jump.clock_change for jump in jumps] == [ClockChange.ROS_TIME_ACTIVATED]
    assert clock.now().nanoseconds == 0
    assert spinner.until(lambda: publisher.get_subscription_count() == 1)
    show(5.0)
    show(5.5)
    show(4.0)
    assert [jump.delta.nanoseconds for jump in jumps[1:]] == [5_000_000_000, -1_500_000_000]
    node.set_parameters([Parameter("use_sim_time", value=False)])
    assert not clock.ros_time_is_active and clock.now().nanoseconds > 10**18
    handle.unregister()
    node.set_parameters([Parameter("use_sim_time", value=True)])
    assert len(jumps) == 4


def test_use_sim_time_must_be_a_bool(node: Any) -> None:
    assert not node.set_parameters([Parameter("use_sim_time", value="yes")])[0].successful
