"""Durations, time points, clocks: arithmetic, ranges, jumps and sleeping."""

import threading
from collections.abc import Callable

import builtin_interfaces.msg
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.clock import Clock, ClockChange, JumpThreshold, ROSClock, TimeJump
from rclpy.clock_type import ClockType
from rclpy.duration import Duration, Infinite
from rclpy.exceptions import NotInitializedException
from rclpy.time import Time

INT64 = st.integers(-(2**63), 2**63 - 1)
POINT = st.integers(0, 2**63 - 1)


class FakeContext:
    """What a clock needs of a context."""

    def __init__(self) -> None:
        self.valid = True
        self.callbacks: list[Callable[[], None]] = []
        self.waiting = threading.Event()

    def ok(self) -> bool:
        return self.valid

    def on_shutdown(self, callback: Callable[[], None]) -> None:
        self.callbacks.append(callback)
        self.waiting.set()

    def shutdown(self) -> None:
        self.valid = False
        for callback in self.callbacks:
            callback()


class Sleeper(threading.Thread):
    """A thread that sleeps on a clock and keeps what the sleep returned."""

    def __init__(self, clock: Clock, until: Time) -> None:
        super().__init__(daemon=True)
        self.clock, self.until, self.context, self.result = clock, until, FakeContext(), None

    def run(self) -> None:
        self.result = self.clock.sleep_until(self.until, self.context)

    def asleep(self) -> "Sleeper":
        self.start()
        assert self.context.waiting.wait(120.0)
        return self

    def woken(self) -> bool:
        self.join(120.0)
        assert not self.is_alive(), "the sleep did not end"
        return self.result


@given(INT64)
def test_a_duration_survives_its_message_if_the_message_can_hold_it(ns: int) -> None:
    duration = Duration(nanoseconds=ns)
    seconds = ns // 10**9
    if -(2**31) <= seconds < 2**31:
        assert Duration.from_msg(duration.to_msg()) == duration
    else:
        with pytest.raises(AssertionError):
            duration.to_msg()


@given(POINT, INT64)
def test_time_arithmetic_is_exact_or_refused(point: int, span: int) -> None:
    start, duration = Time(nanoseconds=point), Duration(nanoseconds=span)
    end = point + span
    if end < 0:
        with pytest.raises(ValueError):
            start + duration
    elif end >= 2**63:
        with pytest.raises(OverflowError, match="Addition leads to overflow in C storage"):
            start + duration
    else:
        assert (start + duration).nanoseconds == (duration + start).nanoseconds == end
        assert (start + duration) - start == duration


@given(INT64, INT64)
def test_order_of_durations_is_that_of_their_nanoseconds(a: int, b: int) -> None:
    left, right = Duration(nanoseconds=a), Duration(nanoseconds=b)
    assert (left < right, left <= right, left == right, left != right, left >= right, left > right) == (
        a < b,
        a <= b,
        a == b,
        a != b,
        a >= b,
        a > b,
    )


@pytest.mark.parametrize("ns", [2**63, -(2**63) - 1])
def test_a_duration_has_64_bits(ns: int) -> None:
    with pytest.raises(OverflowError, match="too large to store in C duration"):
        Duration(nanoseconds=ns)


def test_infinite_says_so() -> None:
    assert str(Infinite) == "Infinite"
    assert str(Duration(nanoseconds=5)) == "5 nanoseconds"
    assert repr(Time(seconds=1.5)) == "Time(nanoseconds=1500000000, clock_type=SYSTEM_TIME)"


def test_times_of_different_clocks_do_not_mix() -> None:
    system, steady = Time(seconds=1), Time(seconds=1, clock_type=ClockType.STEADY_TIME)
    with pytest.raises(TypeError, match="Can't compare times with different clock types"):
        system == steady  # noqa: B015
    with pytest.raises(TypeError, match="Can't subtract times with different clock types"):
        system - steady
    assert system != Duration(seconds=1)
    assert system != 1
    with pytest.raises(TypeError):
        system < Duration(seconds=1)  # noqa: B015


def test_messages_of_another_type_are_refused() -> None:
    with pytest.raises(TypeError, match=r"builtin_interfaces\.msg\.Time"):
        Time.from_msg(builtin_interfaces.msg.Duration())
    with pytest.raises(TypeError, match=r"builtin_interfaces\.msg\.Duration"):
        Duration.from_msg(builtin_interfaces.msg.Time())


def test_clock_types_and_classes() -> None:
    assert isinstance(Clock(clock_type=ClockType.ROS_TIME), ROSClock)
    assert ROSClock().now().clock_type is ClockType.ROS_TIME
    assert repr(Clock()) == "Clock(clock_type=SYSTEM_TIME)"
    with pytest.raises(TypeError, match="must be a ClockType"):
        Clock(clock_type="STEADY_TIME")
    steady = Clock(clock_type=ClockType.STEADY_TIME)
    assert steady.now() <= steady.now()


def test_an_overridden_clock_shows_the_override() -> None:
    clock = ROSClock()
    clock.set_ros_time_override(Time(seconds=7))
    assert clock.now().nanoseconds > 10**18
    clock._set_ros_time_is_active(True)
    assert clock.ros_time_is_active
    assert clock.now() == Time(seconds=7, clock_type=ClockType.ROS_TIME)


@given(st.lists(st.integers(0, 10**6), max_size=30), st.integers(1, 10**6), st.integers(-(10**6), -1))
def test_jump_callbacks_see_exactly_the_jumps_that_exceed_their_threshold(
    times: list[int], forward: int, backward: int
) -> None:
    clock, seen, expected, now = ROSClock(), [], [], 0
    clock._set_ros_time_is_active(True)
    threshold = JumpThreshold(
        min_forward=Duration(nanoseconds=forward), min_backward=Duration(nanoseconds=backward), on_clock_change=False
    )
    with clock.create_jump_callback(
        threshold,
        pre_callback=lambda: seen.append(("pre", clock.now().nanoseconds)),
        post_callback=lambda jump: seen.append((jump.delta.nanoseconds, clock.now().nanoseconds)),
    ):
        for ns in times:
            if ns - now >= forward or ns - now <= backward:
                expected += [("pre", now), (ns - now, ns)]
            clock.set_ros_time_override(Time(nanoseconds=ns))
            now = ns
    clock.set_ros_time_override(Time(nanoseconds=10**9))
    assert seen == expected


def test_switching_ros_time_is_a_jump_once() -> None:
    clock, changes = ROSClock(), []
    threshold = JumpThreshold(min_forward=None, min_backward=None)
    handle = clock.create_jump_callback(threshold, post_callback=lambda jump: changes.append(jump.clock_change))
    for active in (True, True, False, False):
        clock._set_ros_time_is_active(active)
    handle.unregister()
    handle.unregister()
    clock._set_ros_time_is_active(True)
    assert changes == [ClockChange.ROS_TIME_ACTIVATED, ClockChange.ROS_TIME_DEACTIVATED]


def test_malformed_jumps_and_thresholds_are_refused() -> None:
    clock = ROSClock()
    with pytest.raises(ValueError, match="min_forward must be"):
        JumpThreshold(min_forward=Duration(), min_backward=None)
    with pytest.raises(ValueError, match="min_backward must be"):
        JumpThreshold(min_forward=None, min_backward=Duration(seconds=1))
    with pytest.raises(ValueError, match="At least one jump threshold"):
        JumpThreshold(min_forward=None, min_backward=None, on_clock_change=False)
    with pytest.raises(ValueError, match="One of pre_callback or post_callback"):
        clock.create_jump_callback(JumpThreshold(min_forward=None, min_backward=None))
    with pytest.raises(TypeError, match="clock_change must be"):
        TimeJump(2, Duration())


@pytest.mark.parametrize("kind", [ClockType.SYSTEM_TIME, ClockType.STEADY_TIME, ClockType.ROS_TIME])
def test_sleep_lasts_as_long_as_asked(kind: ClockType) -> None:
    clock = Clock(clock_type=kind)
    start = clock.now()
    assert clock.sleep_for(Duration(nanoseconds=20_000_000), FakeContext())
    assert clock.now() - start >= Duration(nanoseconds=20_000_000)
    assert clock.sleep_until(start, FakeContext())


def test_sleep_refuses_another_clock_and_a_dead_context() -> None:
    with pytest.raises(ValueError, match="clock type does not match"):
        Clock().sleep_until(Time(clock_type=ClockType.STEADY_TIME), FakeContext())
    dead = FakeContext()
    dead.valid = False
    with pytest.raises(NotInitializedException):
        Clock().sleep_for(Duration(seconds=1), dead)


def test_shutdown_ends_a_sleep() -> None:
    clock = Clock()
    sleeper = Sleeper(clock, clock.now() + Duration(seconds=10**6)).asleep()
    sleeper.context.shutdown()
    assert sleeper.woken() is False


@pytest.mark.parametrize("active", [True, False])
def test_switching_ros_time_ends_a_sleep(active: bool, wait_until: Callable[..., bool]) -> None:
    clock = ROSClock()
    clock._set_ros_time_is_active(active)
    sleeper = Sleeper(clock, clock.now() + Duration(seconds=1000)).asleep()
    # The switch counts from the moment when the sleeper listens for jumps.
    assert wait_until(lambda: clock._jump_handles)
    clock._set_ros_time_is_active(not active)
    assert sleeper.woken() is False


def test_simulated_time_ends_a_sleep_only_when_it_has_come() -> None:
    clock = ROSClock()
    clock._set_ros_time_is_active(True)
    until = Time(seconds=10, clock_type=ClockType.ROS_TIME)
    sleeper = Sleeper(clock, until).asleep()
    clock.set_ros_time_override(Time(seconds=9))
    assert sleeper.is_alive()
    clock.set_ros_time_override(until)
    assert sleeper.woken() is True
