"""Timers and rates."""

from __future__ import annotations

import statistics
import threading
import time
from itertools import pairwise
from typing import Any

import pytest
from rclpy._rclpy_pybind11 import RCLError
from rclpy.clock import Clock, ROSClock
from rclpy.clock_type import ClockType
from rclpy.exceptions import InvalidHandle, ROSInterruptException
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from rclpy.time import Time
from rclpy.timer import Timer
from rosgraph_msgs.msg import Clock as ClockMsg


def test_rate_of_calls(node: Any, spinner: Any) -> None:
    calls: list[int] = []
    node.create_timer(0.02, lambda: calls.append(time.monotonic_ns()))

    def median_period_ns() -> float:
        calls.clear()
        assert spinner.until(lambda: len(calls) == 21)
        return statistics.median(after - before for before, after in pairwise(calls))

    # A busy machine may miss calls, more than once.
    assert any(median_period_ns() == pytest.approx(20e6, rel=0.05) for _ in range(200))


def test_no_drift_over_1000_ticks(node: Any, spinner: Any) -> None:
    calls: list[int] = []
    publisher = node.create_publisher(ClockMsg, "/clock", 10)
    node.set_parameters([Parameter("use_sim_time", value=True)])
    assert spinner.until(lambda: publisher.get_subscription_count() == 1)

    def show(milliseconds: int) -> None:
        stamp = Time(nanoseconds=milliseconds * 1_000_000)
        publisher.publish(ClockMsg(clock=stamp.to_msg()))
        assert spinner.until(lambda: node.get_clock().now().nanoseconds == stamp.nanoseconds)

    show(1)
    timer = node.create_timer(0.1, lambda: calls.append(node.get_clock().now().nanoseconds))
    for tick in range(1, 1001):
        # Each call comes 30 ms late; the next one is due on the grid all the same.
        show(tick * 100 + 31)
        assert spinner.until(lambda tick=tick: len(calls) == tick)
        assert timer.time_until_next_call() == 70_000_000


def test_cancel_and_reset(node: Any, spinner: Any) -> None:
    calls: list[int] = []
    timer = node.create_timer(0.01, lambda: calls.append(1))
    assert not timer.is_canceled()
    timer.cancel()
    assert timer.is_canceled() and not timer.is_ready()
    assert timer.time_until_next_call() is None
    spinner.rest()
    assert calls == []
    timer.reset()
    assert not timer.is_canceled()
    assert spinner.until(lambda: len(calls) >= 2)


def test_reset_restarts_the_period(node: Any, manual_clock: Any) -> None:
    clock, set_ms = manual_clock
    timer = node.create_timer(0.1, lambda: None, clock=clock)
    set_ms(90)
    timer.reset()
    assert timer.time_until_next_call() == 100_000_000


def test_without_autostart(node: Any, spinner: Any) -> None:
    calls: list[int] = []
    timer = node.create_timer(0.01, lambda: calls.append(1), autostart=False)
    spinner.rest()
    assert timer.is_canceled() and calls == []
    timer.reset()
    assert spinner.until(lambda: calls)


def test_period_can_change(node: Any, spinner: Any) -> None:
    calls: list[int] = []
    timer = node.create_timer(0.001, lambda: calls.append(1))
    assert timer.timer_period_ns == 1_000_000
    timer.timer_period_ns = 3600e9
    assert timer.timer_period_ns == 3_600_000_000_000
    assert spinner.until(lambda: calls)
    spinner.rest()
    assert len(calls) == 1


def test_zero_period(node: Any, spinner: Any) -> None:
    calls: list[int] = []
    node.create_timer(0, lambda: calls.append(1))
    assert spinner.until(lambda: len(calls) > 10)


def test_negative_period(node: Any) -> None:
    with pytest.raises(RCLError):
        node.create_timer(-1, lambda: None)


def test_simulated_time(node: Any, spinner: Any) -> None:
    calls: list[int] = []
    publisher = node.create_publisher(
        ClockMsg, "/clock", QoSProfile(depth=1, reliability=QoSReliabilityPolicy.BEST_EFFORT)
    )
    node.set_parameters([Parameter("use_sim_time", value=True)])
    node.create_timer(0.1, lambda: calls.append(node.get_clock().now().nanoseconds))
    spinner.rest()
    assert calls == []
    assert spinner.until(lambda: publisher.get_subscription_count() == 1)
    expected = []
    for tick in range(1, 21):
        stamp = Time(nanoseconds=tick * 50_000_000)
        publisher.publish(ClockMsg(clock=stamp.to_msg()))
        assert spinner.until(lambda stamp=stamp: node.get_clock().now().nanoseconds == stamp.nanoseconds)
        spinner.rest(3)
        if tick % 2 == 0:
            expected.append(stamp.nanoseconds)
        assert calls == expected


def test_first_simulated_time_begins_a_period(node: Any) -> None:
    clock = ROSClock()
    timer = node.create_timer(10, lambda: None, clock=clock)
    clock._set_ros_time_is_active(True)
    assert not timer.is_ready()
    clock.set_ros_time_override(Time(seconds=5, clock_type=ClockType.ROS_TIME))
    assert timer.time_until_next_call() == 10_000_000_000


def test_steady_clock(node: Any, spinner: Any) -> None:
    calls: list[int] = []
    timer = node.create_timer(0.01, lambda: calls.append(1), clock=Clock(clock_type=ClockType.STEADY_TIME))
    assert timer.clock.clock_type is ClockType.STEADY_TIME
    assert spinner.until(lambda: len(calls) >= 3)


def test_destroyed(node: Any, spinner: Any) -> None:
    calls: list[int] = []
    timer = node.create_timer(0.001, lambda: calls.append(1))
    assert node.destroy_timer(timer)
    spinner.rest()
    assert calls == []
    for use in (timer.is_ready, timer.cancel, timer.reset, timer.time_until_next_call, timer.is_canceled):
        with pytest.raises(InvalidHandle):
            use()


def test_destroy_in_own_callback(node: Any, spinner: Any) -> None:
    calls: list[bool] = []
    timer: Timer = node.create_timer(0.001, lambda: calls.append(node.destroy_timer(timer)))
    assert spinner.until(lambda: calls)
    spinner.rest()
    assert calls == [True]


def test_rate(node: Any, spinner: Any) -> None:
    rate = node.create_rate(100)
    sleeps: list[float] = []

    def sleep() -> None:
        for _ in range(10):
            rate.sleep()
            sleeps.append(time.monotonic())

    def elapsed_s() -> float:
        sleeps.clear()
        thread = threading.Thread(target=sleep)
        thread.start()
        assert spinner.until(lambda: len(sleeps) == 10)
        thread.join()
        return sleeps[-1] - sleeps[0]

    # A busy machine may be late, more than once.
    assert any(elapsed_s() == pytest.approx(0.09, abs=0.02) for _ in range(200))


def test_rate_ends(context: Any, node: Any, wait_until: Any) -> None:
    rate = node.create_rate(0.001)
    outcomes: list[BaseException] = []

    def sleep() -> None:
        try:
            rate.sleep()
        except ROSInterruptException as error:
            outcomes.append(error)

    thread = threading.Thread(target=sleep)
    thread.start()
    assert wait_until(lambda: rate._num_sleepers)
    context.shutdown()
    thread.join(120)
    assert len(outcomes) == 1
    with pytest.raises(ROSInterruptException):
        rate.sleep()


def test_destroyed_rate(node: Any) -> None:
    rate = node.create_rate(10)
    assert node.destroy_rate(rate)
    with pytest.raises(RuntimeError):
        rate.sleep()
    with pytest.raises(ValueError):
        node.create_rate(0)
