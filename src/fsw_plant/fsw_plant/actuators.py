"""Actuators: rate limit and first-order lag between the command and the actual values."""

from __future__ import annotations

from math import exp

from fsw_model import STEP_S


class Actuator:
    """One drive.

    It takes a new set-point at each tick, at most ``largest_step`` away from the one before, and follows it with a
    first-order lag of time constant ``lag_s``, which is solved exactly; 0: it is where the set-point is.
    """

    def __init__(self, position: float, largest_step: float, lag_s: float) -> None:
        self.position = position
        self.setpoint = position
        self.configure(largest_step, lag_s)

    def configure(self, largest_step: float, lag_s: float) -> None:
        """Change largest step and lag, see the class."""
        self._largest = largest_step
        self._left = exp(-STEP_S / lag_s) if lag_s > 0.0 else 0.0
        self._mean = lag_s / STEP_S * (1.0 - self._left)

    def advance(self, target: float) -> float:
        """Move for one tick towards ``target``; returns the mean position over the tick."""
        change = target - self.setpoint
        if -self._largest <= change <= self._largest:
            self.setpoint = target
        else:
            self.setpoint += self._largest if change > 0.0 else -self._largest
        behind = self.position - self.setpoint
        self.position = self.setpoint + behind * self._left
        return self.setpoint + behind * self._mean
