"""Actuators: dead time, rate limit and first-order lag from command to actual value."""

from __future__ import annotations

from collections import deque

from fsw_plant.lag import lag_left, lag_mean


class Actuator:
    """A drive.

    A set-point takes effect after ``dead_time_ticks``. At each tick the drive accepts a new one,
    at most ``largest_step`` from the previous one, and follows it with a first-order lag of time
    constant ``lag_s``, solved exactly; with 0 it is always at the set-point.
    """

    def __init__(
        self, position: float, largest_step: float, lag_s: float, dead_time_ticks: int = 0
    ) -> None:
        self.position = position
        self.setpoint = position
        self._on_the_way: deque[float] = deque()
        self.configure(largest_step, lag_s, dead_time_ticks)

    def configure(self, largest_step: float, lag_s: float, dead_time_ticks: int = 0) -> None:
        """Change the settings, see the class; pending set-points that are overtaken are lost."""
        self._largest = largest_step
        self._left, self._mean = lag_left(lag_s), lag_mean(lag_s)
        while len(self._on_the_way) < dead_time_ticks:
            self._on_the_way.appendleft(self.setpoint)
        while len(self._on_the_way) > dead_time_ticks:
            self._on_the_way.popleft()

    def advance(self, target: float) -> float:
        """Move for one tick towards ``target``; returns the mean position over the tick."""
        if self._on_the_way:
            self._on_the_way.append(target)
            target = self._on_the_way.popleft()
        change = target - self.setpoint
        if -self._largest <= change <= self._largest:
            self.setpoint = target
        else:
            self.setpoint += self._largest if change > 0.0 else -self._largest
        behind = self.position - self.setpoint
        self.position = self.setpoint + behind * self._left
        return self.setpoint + behind * self._mean
