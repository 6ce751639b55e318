"""Clocks: system, steady and ROS time, time jumps, sleeping."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import InitVar, dataclass
from enum import IntEnum
from typing import Any, cast

from rclpy.clock_type import ClockType as ClockType
from rclpy.constants import S_TO_NS
from rclpy.context import Context, context_or_default
from rclpy.duration import Duration
from rclpy.exceptions import NotInitializedException
from rclpy.time import Time

#: Seconds of one wait: a sleep of centuries must not overflow the system's timeout.
_LONGEST_WAIT = 3600.0


class ClockChange(IntEnum):
    """What happened to a clock's source; the values are those of ``rcl_clock_change_t``."""

    ROS_TIME_NO_CHANGE = 1
    ROS_TIME_ACTIVATED = 2
    ROS_TIME_DEACTIVATED = 3
    SYSTEM_TIME_NO_CHANGE = 4


@dataclass(kw_only=True, eq=False)
class JumpThreshold:
    """When a change of time counts as a jump: steps of `min_forward` > 0 or `min_backward` < 0, a change of source."""

    min_forward: Duration | None
    min_backward: Duration | None
    on_clock_change: bool = True

    def __post_init__(self) -> None:
        if self.min_forward is not None and self.min_forward.nanoseconds <= 0:
            raise ValueError("min_forward must be a positive non-zero duration")
        if self.min_backward is not None and self.min_backward.nanoseconds >= 0:
            raise ValueError("min_backward must be a negative non-zero duration")
        if self.min_forward is None and self.min_backward is None and not self.on_clock_change:
            raise ValueError("At least one jump threshold must be enabled")

    def exceeded_by(self, jump: TimeJump) -> bool:
        if jump.clock_change in (ClockChange.ROS_TIME_ACTIVATED, ClockChange.ROS_TIME_DEACTIVATED):
            return self.on_clock_change
        return (self.min_forward is not None and jump.delta >= self.min_forward) or (
            self.min_backward is not None and jump.delta <= self.min_backward
        )


@dataclass(frozen=True, eq=False)
class TimeJump:
    """A jump of a clock: whether ROS time was switched on or off, and new time minus old time."""

    clock_change: ClockChange
    delta: Duration

    def __post_init__(self) -> None:
        if not isinstance(self.clock_change, ClockChange):
            raise TypeError("clock_change must be an instance of rclpy.clock.ClockChange")


@dataclass(kw_only=True, eq=False)
class JumpHandle:
    """A registered pair of jump callbacks; also a context manager that unregisters them."""

    clock: InitVar[Clock]
    threshold: JumpThreshold
    pre_callback: Callable[[], None] | None
    post_callback: Callable[[TimeJump], None] | None

    def __post_init__(self, clock: Clock) -> None:
        if self.pre_callback is None and self.post_callback is None:
            raise ValueError("One of pre_callback or post_callback must be callable")
        for name in ("pre_callback", "post_callback"):
            if getattr(self, name) is not None and not callable(getattr(self, name)):
                raise ValueError(f"{name} must be callable if given")
        self._clock: Clock | None = clock
        clock._jump_handles.append(self)

    def unregister(self) -> None:
        if self._clock is not None:
            self._clock._jump_handles.remove(self)
            self._clock = None

    def __enter__(self) -> JumpHandle:
        return self

    def __exit__(self, *_: Any) -> None:
        self.unregister()


class Clock:
    """A source of time. ``Clock(clock_type=ClockType.ROS_TIME)`` gives a ROSClock."""

    clock_type: ClockType
    _jump_handles: list[JumpHandle]

    def __new__(cls, *, clock_type: ClockType = ClockType.SYSTEM_TIME) -> Clock:
        if not isinstance(clock_type, ClockType):
            raise TypeError("Clock type must be a ClockType enum")
        self = super().__new__(ROSClock if clock_type is ClockType.ROS_TIME else cls)
        self.clock_type = clock_type
        self._jump_handles = []
        return self

    def __repr__(self) -> str:
        return f"Clock(clock_type={self.clock_type.name})"

    def _now_ns(self) -> int:
        return time.monotonic_ns() if self.clock_type is ClockType.STEADY_TIME else time.time_ns()

    def now(self) -> Time:
        return Time(nanoseconds=self._now_ns(), clock_type=self.clock_type)

    def create_jump_callback(
        self,
        threshold: JumpThreshold,
        *,
        pre_callback: Callable[[], None] | None = None,
        post_callback: Callable[[TimeJump], None] | None = None,
    ) -> JumpHandle:
        """Register callbacks for before and after every jump that exceeds `threshold`; they must not block."""
        return JumpHandle(clock=self, threshold=threshold, pre_callback=pre_callback, post_callback=post_callback)

    def _jump(self, jump: TimeJump, change: Callable[[], None]) -> None:
        """Apply `change` between the callbacks that `jump` concerns."""
        concerned = [handle for handle in list(self._jump_handles) if handle.threshold.exceeded_by(jump)]
        for handle in concerned:
            if handle.pre_callback is not None:
                handle.pre_callback()
        change()
        for handle in concerned:
            if handle.post_callback is not None:
                handle.post_callback(jump)

    def sleep_until(self, until: Time, context: Context | None = None) -> bool:
        """Sleep until this clock shows `until`; return whether it does.

        Shutdown of the context (default: the global one) and switching ROS time on or off end the sleep early.
        """
        context = context_or_default(context)
        if not context.ok():
            raise NotInitializedException()
        if until.clock_type != self.clock_type:
            raise ValueError("until's clock type does not match this clock's type")
        event = threading.Event()
        source_changed = False

        def on_jump(jump: TimeJump) -> None:
            nonlocal source_changed
            # Another source has another epoch, so `until` has lost its meaning.
            source_changed = source_changed or jump.clock_change != ClockChange.ROS_TIME_NO_CHANGE
            if source_changed or self.now() >= until:
                event.set()

        context.on_shutdown(event.set)
        threshold = JumpThreshold(min_forward=Duration(nanoseconds=1), min_backward=None, on_clock_change=True)
        with self.create_jump_callback(threshold, post_callback=on_jump):
            # The context may have gone down, or time may have come, before the callbacks were in place.
            while context.ok() and not event.is_set() and (remaining := until.nanoseconds - self._now_ns()) > 0:
                overridden = isinstance(self, ROSClock) and self.ros_time_is_active
                event.wait(None if overridden else min(remaining / S_TO_NS, _LONGEST_WAIT))
        return context.ok() and not source_changed and self.now() >= until

    def sleep_for(self, rel_time: Duration, context: Context | None = None) -> bool:
        return self.sleep_until(self.now() + rel_time, context)


class ROSClock(Clock):
    """ROS time: system time, or what a time source says (simulated time)."""

    _override_ns = 0
    #: Whether the time comes from a time source rather than from the system.
    ros_time_is_active = False

    def __new__(cls) -> ROSClock:
        return cast(ROSClock, super().__new__(Clock, clock_type=ClockType.ROS_TIME))

    def _now_ns(self) -> int:
        return self._override_ns if self.ros_time_is_active else time.time_ns()

    def _set_ros_time_is_active(self, enabled: bool) -> None:
        if enabled != self.ros_time_is_active:
            change = ClockChange.ROS_TIME_ACTIVATED if enabled else ClockChange.ROS_TIME_DEACTIVATED
            self._jump(TimeJump(change, Duration()), lambda: setattr(self, "ros_time_is_active", enabled))

    def set_ros_time_override(self, time: Time) -> None:
        """Set the time this clock shows while ROS time is active."""
        if not isinstance(time, Time):
            raise TypeError(f"Time must be specified as rclpy.time.Time. Received type: {type(time)}")
        if not self.ros_time_is_active:
            self._override_ns = time.nanoseconds
            return
        jump = TimeJump(ClockChange.ROS_TIME_NO_CHANGE, Duration(nanoseconds=time.nanoseconds - self._override_ns))
        self._jump(jump, lambda: setattr(self, "_override_ns", time.nanoseconds))
