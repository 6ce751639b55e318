"""Actuators: rate limit and first-order lag between the command and what acts on the process."""

from __future__ import annotations

from math import exp


class Actuator:
    """One drive.

    The drive takes a new set-point at each tick, at most one step of its rate away from the one before, and follows
    it with a first-order lag, which is solved exactly.

    Parameters
    ----------
    position : float
        Where it stands at the start.
    rate : float
        Largest rate, per s.
    lag_s : float
        Time constant; 0: it is where the set-point is.
    step_s : float
        Length of a tick.
    """

    def __init__(self, position: float, rate: float, lag_s: float, step_s: float) -> None:
        self.position = position
        self.setpoint = position
        self.configure(rate, lag_s, step_s)

    def configure(self, rate: float, lag_s: float, step_s: float) -> None:
        """Change rate and lag, see the class."""
        self._largest = rate * step_s
        self._left = exp(-step_s / lag_s) if lag_s > 0.0 else 0.0
        self._mean = lag_s / step_s * (1.0 - self._left)

    def advance(self, wanted: float) -> float:
        """Move for one tick towards ``wanted``; returns the mean position over the tick."""
        largest, setpoint = self._largest, self.setpoint
        change = wanted - setpoint
        if -largest <= change <= largest:
            setpoint = wanted
        else:
            setpoint += largest if change > 0.0 else -largest
        self.setpoint = setpoint
        behind = self.position - setpoint
        self.position = setpoint + behind * self._left
        return setpoint + behind * self._mean
