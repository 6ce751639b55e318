"""The three loops: depth to force, temperature to power, power to speed.

Each loop works in absolute values, so that its integrator holds the operating point. ``follow`` tells a loop what
became of its last output: one cut by limits pulls the integrator back with the tracking time (back-calculation);
a command from somewhere else sets it at once, so that the loop continues from that command without a bump.
"""

from __future__ import annotations

from math import exp, isnan, nan

from fsw_control.units import RAD_PER_S_PER_RPM

#: kW per N m rpm
KW_PER_NM_RPM = RAD_PER_S_PER_RPM * 1e-3


def share(time_constant_s: float, dt_s: float) -> float:
    """Share of its input that a first-order filter takes over in one step."""
    return 1.0 if time_constant_s <= 0.0 else 1.0 - exp(-dt_s / time_constant_s)


class FeedbackLoop:
    """PID, derivative on the measurement; the set-point is filtered and weighted.

    The measurement passes two equal first-order filters in series: behind one alone the derivative would pass on too
    much noise.
    """

    def __init__(self) -> None:
        self.started = False
        self.measured = self._first_stage = nan
        self.output = nan
        self._reference = nan
        self._integrator = 0.0
        self._gain = self._weight = 0.0

    def configure(
        self,
        gain: float,
        integral_time: float,
        derivative_time: float,
        filter: float,
        weight: float,
        reference_filter: float,
        tracking_time: float,
        dt_s: float,
    ) -> None:
        """Take new gains; the output does not jump, because the integrator makes up for the difference."""
        if self.started:
            before = self._gain * (self._weight * self._reference - self.measured)
            self._integrator += before - gain * (weight * self._reference - self.measured)
        self._gain, self._weight = gain, weight
        self._integral = gain * dt_s / integral_time
        self._derivative = gain * derivative_time / dt_s
        self._filter = share(filter, dt_s)
        self._reference_filter = share(reference_filter, dt_s)
        self._tracking = min(dt_s / tracking_time, 1.0)

    def start(self, measured: float, reference: float, output: float) -> None:
        """Begin such that the output is ``output`` now."""
        self.measured = self._first_stage = measured
        if isnan(self._reference):
            self._reference = reference
        self._integrator = output - self._gain * (self._weight * self._reference - measured)
        self.output = output
        self.started = True

    def pause(self, output: float) -> None:
        """Hold ``output`` while there is no measurement; the loop has to be started again."""
        self.started = False
        self.output = output

    def follow(self, excess: float, elsewhere: bool) -> None:
        """Note how far the last output was from what was applied, by limits or by a command from elsewhere."""
        self._integrator += excess if elsewhere else self._tracking * excess

    def step(self, measured: float, reference: float) -> float:
        """Return the output for the next measurement."""
        self._first_stage += self._filter * (measured - self._first_stage)
        move = self._filter * (self._first_stage - self.measured)
        self.measured += move
        self._reference += self._reference_filter * (reference - self._reference)
        self._integrator += self._integral * (self._reference - self.measured)
        proportional = self._gain * (self._weight * self._reference - self.measured)
        self.output = proportional + self._integrator - self._derivative * move
        return self.output


class PowerLoop:
    """Speed from a power reference: feed-forward by the measured torque, and PI on the measured power."""

    def __init__(self, torque_nm: float) -> None:
        self.started = False
        self.fast_nm = self.slow_nm = torque_nm
        self.output = nan
        self._integrator = 0.0
        self._gained = 0.0

    def configure(
        self,
        gain: float,
        integral_time: float,
        filter: float,
        tracking_time: float,
        feedforward_filter: float,
        dt_s: float,
    ) -> None:
        """Take new gains."""
        self._gain = gain
        self._integral = gain * dt_s / integral_time
        self._filter = share(filter, dt_s)
        self._feedforward = share(feedforward_filter, dt_s)
        self._tracking = min(dt_s / tracking_time, 1.0)

    def measure(self, torque_nm: float) -> None:
        """Take the next process torque; one before the first step as it is."""
        if not self.started:
            self.fast_nm = self.slow_nm = torque_nm
            return
        self.fast_nm += self._filter * (torque_nm - self.fast_nm)
        self.slow_nm += self._feedforward * (torque_nm - self.slow_nm)

    def follow(self, excess_rpm: float, bounded: bool, elsewhere: bool) -> None:
        """Note how far the last output was from what was applied, by a bound, the move limit or another command.

        At a bound the loop does not integrate further outwards. What the move limit has taken bleeds off slowly, so
        that the loop makes up for the energy that was missing while the speed could not follow.
        """
        if elsewhere:
            self._integrator = 0.0
        elif not bounded:
            self._integrator += self._tracking * excess_rpm
        elif excess_rpm * self._gained < 0.0:
            self._integrator -= self._gained

    def step(self, reference_kw: float, speed_rpm: float) -> float:
        """Return the speed for a power reference, ``speed_rpm`` being the present one."""
        self.started = True
        error_kw = reference_kw - self.fast_nm * speed_rpm * KW_PER_NM_RPM
        self._gained = self._integral * error_kw
        self._integrator += self._gained
        self.output = reference_kw / (self.slow_nm * KW_PER_NM_RPM) + self._gain * error_kw + self._integrator
        return self.output
