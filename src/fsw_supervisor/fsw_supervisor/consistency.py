"""Residuals of the sensors against each other and the drives, by the paper's model.

- Torque from depth and force, (19)-(22), and the friction (23): a level. The ratio of measured and
  expected torque is learnt slowly, so that wear and the plant's own coefficients do not count; it
  is frozen while the residual is large.
- Depth from force and temperature, (17) and (27): a movement. The model's response to the drives
  is subtracted, and the rest compared with its own slow mean (a high-pass filter).
- Temperature from power, (16) and (24): also a movement, with a wide band, because the copper is
  known only roughly.

A residual is NaN if one of its measurements is missing. A movement restarts after such a loss,
because the sensor may come back with an offset (``validity.*.max_jump``); the learnt ratio is
kept. Theory: Gertler, Fault Detection and Diagnosis in Engineering Systems (1998); thresholds and
persistence are in ``safety_monitor.py``.
"""

from __future__ import annotations

from collections import deque
from math import exp, inf, isfinite, isnan, nan
from typing import NamedTuple

from fsw_control.contract import Measurement
from fsw_control.sensors import REQUIRED
from fsw_model import ModelParameters, nominal
from fsw_model.equations import depth_modes, friction_torque_nm, power_kw, process_torque_nm

#: time constant for learning the ratio of measured and expected torque (chosen: far slower than a
#: slip)
_RATIO_S = 60.0
#: the ratio is learnt faster after the start, as the mean of all samples
_LEAST_RATIO_S = 1.0
#: largest permanent deviation of a plant's torque from the model's (chosen: wear and coefficients)
_LARGEST_SHARE = 0.3
#: largest change of the ratio after the learning time (chosen: twice the tool wear of a weld)
_LARGEST_DRIFT = 0.05
#: torque deviation above which the ratio is frozen [%] (chosen: half of the trip)
_LEARNT_PERCENT = 4.0
#: largest rate of the copper's temperature; a faster thermocouple signal does not move the
#: expected depth (chosen)
_FASTEST_C_PER_S = 5.0
#: longest time between two ticks that the movements tolerate
_GAP_S = 1.0


class Residuals(NamedTuple):
    """Deviations of the sensors from the model's expectation; NaN if unknown."""

    torque_residual_percent: float = nan
    depth_residual_mm: float = nan
    temperature_residual_c: float = nan


class TorqueRatio:
    """Torque compared with its expectation from depth, force and speed."""

    def __init__(self, model: ModelParameters) -> None:
        self._model = model
        self._ratio = 1.0
        self._bounds = 1.0 - _LARGEST_SHARE, 1.0 + _LARGEST_SHARE
        self._learnt_s = 0.0
        self._process_nm = nan

    def residual_percent(self, dt_s: float, m: Measurement) -> float:
        """Deviation of the measured torque from the expected one, with the motor's lag (18)."""
        now_nm: float = process_torque_nm(self._model, m.force_kn, m.depth_mm)  # type: ignore
        friction_nm: float = friction_torque_nm(self._model, m.speed_rpm)  # type: ignore
        if isnan(self._process_nm):
            self._process_nm = now_nm
        # (18) over one tick, exact for a constant input
        share = 1.0 - exp(-dt_s / self._model.motor_lag_s)
        self._process_nm += (now_nm - self._process_nm) * share
        if self._process_nm <= 0.0:
            return nan
        measured = (m.torque_nm - friction_nm) / self._process_nm
        if self._learnt_s == 0.0:
            self._ratio = self._bounded(measured)
        # A slipping or failing sensor shows within seconds, wear and wrong coefficients over
        # minutes: the slowly learnt ratio separates the two. It is not updated while the residual
        # is large, so that it does not learn the fault.
        percent = 100.0 * (measured / self._ratio - 1.0)
        if abs(percent) < _LEARNT_PERCENT:
            self._learn(dt_s, measured)
        return percent

    def _learn(self, dt_s: float, measured: float) -> None:
        is_new = self._learnt_s < _RATIO_S
        self._learnt_s += dt_s
        # gain dt/t: the mean of all samples at first, an exponential mean after _RATIO_S
        share = dt_s / min(max(self._learnt_s, _LEAST_RATIO_S), _RATIO_S)
        self._ratio = self._bounded(self._ratio + (measured - self._ratio) * min(share, 1.0))
        if is_new and self._learnt_s >= _RATIO_S:
            drift = self._ratio * _LARGEST_DRIFT
            self._bounds = self._ratio - drift, self._ratio + drift

    def _bounded(self, ratio: float) -> float:
        return min(max(ratio, self._bounds[0]), self._bounds[1])


class _Movement:
    """A signal compared with its expectation, less the slow mean of the difference."""

    mean_s: float  #: time constant of that mean

    def __init__(self, model: ModelParameters) -> None:
        self._model, self._mean = model, nan

    def restart(self) -> None:
        """Drop the sensor's offset."""
        self._mean = nan

    def _moved(self, dt_s: float, off: float) -> float:
        """Distance from the slow mean of a difference ``off``, which is updated."""
        if isnan(self._mean):
            self._mean = off
        residual = off - self._mean
        self._mean += residual * (1.0 - exp(-dt_s / self.mean_s))
        return residual


class DepthMovement(_Movement):
    """Depth compared with the response to force and temperature."""

    mean_s = 10.0  #: chosen: the model's errors grow with it

    def __init__(self, model: ModelParameters) -> None:
        super().__init__(model)
        poles, gains = depth_modes(model)
        self._pole = float(poles[1])
        self._creep_gain, self._slow_gain = float(gains[0]), float(gains[1])
        self._creep = self._slow = 0.0
        self._softening_c = 0.0

    def residual_mm(self, dt_s: float, m: Measurement) -> float:
        """Movement of the depth that the drives do not explain.

        Exact step response of (17) in modal form: an integrator (creep) and the slow mode, updated
        per tick; the fast mode (0.95 ms) is neglected. Softening multiplies the depth, as in (27).
        """
        model, pushed_kn = self._model, m.force_kn - self._model.operating_force_kn
        decay = exp(self._pole * dt_s)
        self._creep += self._creep_gain * dt_s * pushed_kn
        self._slow = decay * self._slow + (decay - 1.0) / self._pole * self._slow_gain * pushed_kn
        if isfinite(m.temperature_c):
            change_c = m.temperature_c - model.operating_temperature_c - self._softening_c
            # Rate-limited: a quickly failing thermocouple must not show as a depth residual.
            most_c = inf if isnan(self._mean) else _FASTEST_C_PER_S * dt_s
            self._softening_c += min(max(change_c, -most_c), most_c)
        depth_mm = self._creep + self._slow + model.operating_depth_mm
        softened_mm = depth_mm * (1.0 + model.softening_per_c * self._softening_c)
        return self._moved(dt_s, m.depth_mm - softened_mm)


class TemperatureMovement(_Movement):
    """Temperature compared with the response to the power."""

    mean_s = 20.0  #: chosen: the model's errors grow with it

    def __init__(self, model: ModelParameters) -> None:
        super().__init__(model)
        self._copper_c = self._tool_c = nan
        self._power_kw: deque[tuple[float, float]] = deque()  # time of arrival, and power
        self._arriving_kw = 0.0

    def heat(self, time_s: float, dt_s: float, m: Measurement) -> None:
        """Take the power of a tick, which takes effect after the dead time of (16)."""
        model = self._model
        friction_nm: float = friction_torque_nm(model, m.speed_rpm)  # type: ignore
        power: float = power_kw(m.torque_nm - friction_nm, m.speed_rpm) - model.operating_power_kw
        if isfinite(power):
            self._power_kw.append((time_s + model.dead_time_s, power))
            if isnan(self._copper_c):
                # start in equilibrium; the slow mean absorbs the error
                self._arriving_kw = power
                self._copper_c = self._tool_c = model.thermal_gain_c_per_kw * power
        while self._power_kw and self._power_kw[0][0] <= time_s + 1e-6:
            self._arriving_kw = self._power_kw.popleft()[1]
        settled_c, before_c = model.thermal_gain_c_per_kw * self._arriving_kw, self._copper_c
        self._copper_c = settled_c + (before_c - settled_c) * exp(-dt_s / model.copper_lag_s)
        # (16) as two lags in series, each exact for a constant input; the tool sees the copper's
        # mean temperature over the tick
        around_c = 0.5 * (before_c + self._copper_c)
        self._tool_c = around_c + (self._tool_c - around_c) * exp(-dt_s / model.tool_lag_s)

    def residual_c(self, dt_s: float, m: Measurement) -> float:
        """Movement of the temperature that the power does not explain."""
        return self._moved(dt_s, m.temperature_c - self._tool_c)


class Consistency:
    """All three residuals, tick by tick."""

    def __init__(self) -> None:
        self._torque = TorqueRatio(nominal())
        self.forget_time()

    def forget_time(self) -> None:
        """Restart the movements after the clock went back; the learnt ratio is kept."""
        self._last_s = nan
        self._depth, self._temperature = DepthMovement(nominal()), TemperatureMovement(nominal())

    def update(self, m: Measurement) -> Residuals:
        """Take the measurement of a tick; held values count as missing."""
        dt_s = 0.0 if isnan(self._last_s) else max(m.time_s - self._last_s, 0.0)
        self._last_s = m.time_s
        if dt_s > _GAP_S:
            self._depth.restart()
            self._temperature.restart()
        lost = {*m.held, *m.invalid_sensors()}
        has_depth, has_torque, has_temperature = (name not in lost for name in REQUIRED)
        torque = depth = temperature = nan
        driven = isfinite(m.force_kn) and isfinite(m.speed_rpm)
        if driven and has_torque and has_depth:
            torque = self._torque.residual_percent(dt_s, m)
        if driven and has_torque:
            self._temperature.heat(m.time_s, dt_s, m)
        if driven and has_depth:
            depth = self._depth.residual_mm(dt_s, m)
        elif not m.depth_valid:
            self._depth.restart()
        if driven and has_torque and has_temperature:
            temperature = self._temperature.residual_c(dt_s, m)
        elif not (m.temperature_valid and m.torque_valid):
            self._temperature.restart()
        return Residuals(torque, depth, temperature)
