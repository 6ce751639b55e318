"""Timers and rates."""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy._rclpy_pybind11 import InvalidHandle, RCLError
from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock, ClockChange, JumpThreshold, ROSClock, TimeJump
from rclpy.context import Context, context_or_default
from rclpy.duration import Duration
from rclpy.exceptions import ROSInterruptException
from rclpy.impl.handle import Destroyable
from rclpy.time import Time
from rclpy.utilities import takes

_ANY_JUMP = JumpThreshold(min_forward=Duration(nanoseconds=1), min_backward=Duration(nanoseconds=-1))


@dataclass(frozen=True)
class TimerInfo:
    """When a call of a timer was due and when it took place."""

    expected_call_time: Time
    actual_call_time: Time


class Timer(Destroyable):
    """Calls back periodically, without drift: calls stay on the grid that starts at creation or reset.

    The callback takes nothing, or a TimerInfo. Without `autostart` the timer starts with ``reset``.
    """

    condition = None

    def __init__(
        self,
        callback: Callable[..., Any] | None,
        callback_group: CallbackGroup,
        timer_period_ns: int,
        clock: Clock,
        *,
        context: Context | None = None,
        autostart: bool = True,
    ) -> None:
        if int(timer_period_ns) < 0:
            raise RCLError(f"failed to create timer: timer period must be non-negative, got {timer_period_ns} ns")
        super().__init__()
        self._context = context_or_default(context)
        self.clock = clock
        self._period_ns = int(timer_period_ns)
        self._canceled = not autostart
        self._last_call_ns = clock._now_ns()
        self._next_call_ns = self._last_call_ns + self._period_ns
        self._credit_ns = 0
        self.callback = callback
        self.callback_group = callback_group
        self._jumps = None
        if isinstance(clock, ROSClock):
            before, after = self._before_jump, self._after_jump
            self._jumps = clock.create_jump_callback(_ANY_JUMP, pre_callback=before, post_callback=after)

    def _before_jump(self) -> None:
        now = self.clock._now_ns()
        self._credit_ns = self._next_call_ns - now if now else 0

    def _after_jump(self, jump: TimeJump) -> None:
        now = self.clock._now_ns()
        if jump.clock_change in (ClockChange.ROS_TIME_ACTIVATED, ClockChange.ROS_TIME_DEACTIVATED):
            # As rcl does it. Simulated time begins with 0, which is none yet; the first one sent begins a period.
            if now and self._credit_ns:
                self._last_call_ns = now - self._credit_ns
                self._next_call_ns = self._last_call_ns + self._period_ns
        elif now < self._last_call_ns:
            self._next_call_ns = now + self._period_ns
            self._last_call_ns = now
        if self._next_call_ns <= now:
            self._context._wake_all()

    @property
    def callback(self) -> Callable[..., Any] | None:
        """The function that is called, with a TimerInfo if it takes an argument."""
        return self._callback

    @callback.setter
    def callback(self, value: Callable[..., Any] | None) -> None:
        self._callback = value
        self._wants_info = value is not None and not takes(value, 0)

    @property
    def timer_period_ns(self) -> int:
        """Period in nanoseconds; a new one counts from the next call on."""
        self._check()
        return self._period_ns

    @timer_period_ns.setter
    def timer_period_ns(self, value: float) -> None:
        self._check()
        self._period_ns = int(value)

    def is_ready(self) -> bool:
        self._check()
        return not self._canceled and self._next_call_ns <= self.clock._now_ns()

    def is_canceled(self) -> bool:
        self._check()
        return self._canceled

    def cancel(self) -> None:
        """Stop it until ``reset``."""
        self._check()
        self._canceled = True

    def reset(self) -> None:
        """Start it, or start the period again."""
        self._check()
        self._next_call_ns = self.clock._now_ns() + self._period_ns
        self._canceled = False
        self._context._wake_all()

    def time_since_last_call(self) -> int:
        """Return the nanoseconds since the last call, or since creation."""
        self._check()
        return self.clock._now_ns() - self._last_call_ns

    def time_until_next_call(self) -> int | None:
        """Return the nanoseconds until it is due (negative if it is overdue), None if it is canceled."""
        self._check()
        return None if self._canceled else self._next_call_ns - self.clock._now_ns()

    def _wait_ns(self) -> int | None:
        """Nanoseconds an executor may wait for this timer; None if no wait would end it (canceled, simulated time)."""
        if self._canceled or self._handle is None:
            return None
        remaining = self._next_call_ns - self.clock._now_ns()
        if remaining > 0 and isinstance(self.clock, ROSClock) and self.clock.ros_time_is_active:
            return None
        return max(0, remaining)

    def call(self) -> TimerInfo:
        """Record a call; the next one is due at the next point of the grid in the future."""
        now, expected = self.clock._now_ns(), self._next_call_ns
        self._last_call_ns = now
        self._next_call_ns += self._period_ns
        if self._next_call_ns < now:
            late = now - self._next_call_ns
            self._next_call_ns += -(-late // self._period_ns) * self._period_ns if self._period_ns else late
        times = (Time(nanoseconds=ns, clock_type=self.clock.clock_type) for ns in (expected, now))
        return TimerInfo(*times)

    def _take(self) -> Callable[[], Any] | None:
        if self._handle is None or not self.is_ready():
            return None
        info, callback = self.call(), self._callback
        if callback is None or not self._wants_info:
            return callback
        return lambda: callback(info)

    def _clean_up(self) -> None:
        if self._jumps is not None:
            self._jumps.unregister()


class Rate:
    """Sleeps at a fixed rate, in a thread that does not spin; created by ``Node.create_rate``."""

    def __init__(self, timer: Timer, *, context: Context) -> None:
        self._timer = timer
        self._is_shutdown = False
        self._is_destroyed = False
        self._event = threading.Event()
        self._lock = threading.Lock()
        self._num_sleepers = 0
        self._timer.callback = self._event.set
        context.on_shutdown(self._on_shutdown)

    def _on_shutdown(self) -> None:
        self._is_shutdown = True
        self.destroy()

    def destroy(self) -> None:
        """End it and wake all sleepers."""
        with self._lock:
            self._is_destroyed = True
            self._event.set()

    def sleep(self) -> None:
        """Block until the timer fires. In a callback it would block the executor, and with it the timer."""
        if self._is_shutdown:
            raise ROSInterruptException()
        if self._is_destroyed:
            raise RuntimeError("Rate cannot sleep because it has been destroyed")
        if self._timer._handle is None:
            self.destroy()
            raise InvalidHandle("Rate cannot sleep because the timer has been destroyed")
        with self._lock:
            self._num_sleepers += 1
        try:
            self._event.wait()
        finally:
            with self._lock:
                self._num_sleepers -= 1
                # Once it is destroyed, whoever is about to sleep must not sleep.
                if self._num_sleepers == 0 and not self._is_destroyed:
                    self._event.clear()
        if self._is_shutdown:
            self.destroy()
            raise ROSInterruptException()
