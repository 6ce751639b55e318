"""Whether the sensors agree with each other and with the drives, by the paper's model: three residuals for interlocks.

- Torque with depth and force, (19)-(22) and the friction (23): a level. The ratio of measured and
  expected torque is learnt slowly, so that wear and the plant's own coefficients do not count, and
  not at all while it is off.
- Depth with force and temperature, (17) and (27): a movement. What the drives explain is
  subtracted, and what is left is compared with its own slow mean.
- Temperature with power, (16) and (24): likewise, with a wide band, because the copper is only
  roughly known.

A residual is NaN where one of its measurements is missing. A movement begins again after such a
loss, because a sensor that was away may come back elsewhere (``validity.*.max_jump``); the learnt
ratio outlasts it.
"""

from __future__ import annotations

from collections import deque
from math import exp, isfinite, isnan, nan
from typing import NamedTuple

from fsw_control.contract import Measurement
from fsw_control.sensors import REQUIRED
from fsw_model import ModelParameters, nominal
from fsw_model.equations import depth_modes, friction_torque_nm, power_kw, process_torque_nm

#: time constant with which the ratio of measured and expected torque is learnt (chosen: far slower
#: than a slip)
_RATIO_S = 60.0
#: the ratio is learnt faster at a start, as a mean of what has been measured since
_LEAST_RATIO_S = 1.0
#: largest share by which a plant's torque may differ from the model's for good (chosen: wear and
#: coefficients)
_LARGEST_SHARE = 0.3
#: share by which the ratio may change once it has been learnt (chosen: twice the tool wear of a
#: whole weld)
_LARGEST_DRIFT = 0.05
#: deviation of the torque from which it is not learnt any more [%] (chosen: half of the trip)
_LEARNT_PERCENT = 4.0
#: time constants of the slow means of depth and temperature (chosen: the model's errors grow with
#: them)
_DEPTH_MEAN_S, _TEMPERATURE_MEAN_S = 10.0, 20.0
#: rate at which the copper's temperature can change; a faster thermocouple does not move the
#: expected depth (chosen)
_FASTEST_C_PER_S = 5.0
#: longest time between two ticks that the movements bridge
_GAP_S = 1.0


class Residuals(NamedTuple):
    """What the sensors show beyond what the model expects of the others; NaN where unknown."""

    torque_percent: float = nan
    depth_mm: float = nan
    temperature_c: float = nan


class TorqueRatio:
    """Torque compared with depth, force and speed."""

    def __init__(self, model: ModelParameters) -> None:
        self._model = model
        self._ratio = 1.0
        self._bounds = 1.0 - _LARGEST_SHARE, 1.0 + _LARGEST_SHARE
        self._learnt_s = 0.0
        self._process_nm = nan

    def residual_percent(self, dt_s: float, m: Measurement) -> float:
        """Deviation of the measured torque from the expected one, which the motor follows with its lag (18)."""
        now_nm: float = process_torque_nm(self._model, m.force_kn, m.depth_mm)  # type: ignore[arg-type,assignment]
        friction_nm: float = friction_torque_nm(self._model, m.speed_rpm)  # type: ignore[arg-type,assignment]
        if isnan(self._process_nm):
            self._process_nm = now_nm
        self._process_nm += (now_nm - self._process_nm) * (
            1.0 - exp(-dt_s / self._model.motor_lag_s)
        )
        if self._process_nm <= 0.0:
            return nan
        measured = (m.torque_nm - friction_nm) / self._process_nm
        if self._learnt_s == 0.0:
            self._ratio = self._bounded(measured)
        percent = 100.0 * (measured / self._ratio - 1.0)
        if abs(percent) < _LEARNT_PERCENT:
            self._learn(dt_s, measured)
        return percent

    def _learn(self, dt_s: float, measured: float) -> None:
        is_new = self._learnt_s < _RATIO_S
        self._learnt_s += dt_s
        share = dt_s / min(max(self._learnt_s, _LEAST_RATIO_S), _RATIO_S)
        self._ratio = self._bounded(self._ratio + (measured - self._ratio) * min(share, 1.0))
        if is_new and self._learnt_s >= _RATIO_S:
            self._bounds = (
                self._ratio * (1.0 - _LARGEST_DRIFT),
                self._ratio * (1.0 + _LARGEST_DRIFT),
            )

    def _bounded(self, ratio: float) -> float:
        return min(max(ratio, self._bounds[0]), self._bounds[1])


class DepthMovement:
    """Depth compared with what force and temperature do to it."""

    def __init__(self, model: ModelParameters) -> None:
        poles, gains = depth_modes(model)
        self._model, self._pole = model, float(poles[1])
        self._creep_gain, self._slow_gain = float(gains[0]), float(gains[1])
        self._creep = self._slow = 0.0
        self._softening_c = 0.0
        self._mean = nan

    def restart(self) -> None:
        """Forget where the sensor was."""
        self._mean = nan

    def residual_mm(self, dt_s: float, m: Measurement) -> float:
        """Movement of the depth that the drives do not explain."""
        model, pushed_kn = self._model, m.force_kn - self._model.operating_force_kn
        decay = exp(self._pole * dt_s)
        self._creep += self._creep_gain * dt_s * pushed_kn
        self._slow = decay * self._slow + (decay - 1.0) / self._pole * self._slow_gain * pushed_kn
        if isfinite(m.temperature_c):
            change_c = m.temperature_c - model.operating_temperature_c - self._softening_c
            most_c = _FASTEST_C_PER_S * dt_s
            self._softening_c += (
                change_c if isnan(self._mean) else min(max(change_c, -most_c), most_c)
            )
        depth_mm = self._creep + self._slow + model.operating_depth_mm
        off = m.depth_mm - depth_mm * (1.0 + model.softening_per_c * self._softening_c)
        if isnan(self._mean):
            self._mean = off
        residual = off - self._mean
        self._mean += residual * (1.0 - exp(-dt_s / _DEPTH_MEAN_S))
        return residual


class TemperatureMovement:
    """Temperature compared with what the power does to it."""

    def __init__(self, model: ModelParameters) -> None:
        self._model = model
        self._copper_c = self._tool_c = nan
        self._power_kw: deque[tuple[float, float]] = deque()  # when it arrives, and how much
        self._arriving_kw = 0.0
        self._mean = nan

    def restart(self) -> None:
        """Forget where the sensor was."""
        self._mean = nan

    def heat(self, time_s: float, dt_s: float, m: Measurement) -> None:
        """Take the power of a tick, which arrives a dead time later."""
        model = self._model
        friction_nm: float = friction_torque_nm(model, m.speed_rpm)  # type: ignore[arg-type,assignment]
        power: float = power_kw(m.torque_nm - friction_nm, m.speed_rpm) - model.operating_power_kw
        if isfinite(power):
            self._power_kw.append((time_s + model.dead_time_s, power))
            if isnan(
                self._copper_c
            ):  # it is taken for an equilibrium; the slow mean takes the rest
                self._arriving_kw = power
                self._copper_c = self._tool_c = model.thermal_gain_c_per_kw * power
        while self._power_kw and self._power_kw[0][0] <= time_s + 1e-6:
            self._arriving_kw = self._power_kw.popleft()[1]
        settled_c, before_c = model.thermal_gain_c_per_kw * self._arriving_kw, self._copper_c
        self._copper_c = settled_c + (before_c - settled_c) * exp(-dt_s / model.copper_lag_s)
        around_c = 0.5 * (before_c + self._copper_c)
        self._tool_c = around_c + (self._tool_c - around_c) * exp(-dt_s / model.tool_lag_s)

    def residual_c(self, dt_s: float, m: Measurement) -> float:
        """Movement of the temperature that the power does not explain."""
        off = m.temperature_c - self._tool_c
        if isnan(self._mean):
            self._mean = off
        residual = off - self._mean
        self._mean += residual * (1.0 - exp(-dt_s / _TEMPERATURE_MEAN_S))
        return residual


class Consistency:
    """The three residuals, tick by tick."""

    def __init__(self, model: ModelParameters | None = None) -> None:
        model = nominal() if model is None else model
        self._torque = TorqueRatio(model)
        self._depth, self._temperature = DepthMovement(model), TemperatureMovement(model)
        self._model = model
        self._last_s = nan

    def forget_time(self) -> None:
        """The clock went back: the learnt torque is kept."""
        self._last_s = nan
        self._depth, self._temperature = (
            DepthMovement(self._model),
            TemperatureMovement(self._model),
        )

    def update(self, m: Measurement) -> Residuals:
        """Take the measurement of a tick; a value that is held is none."""
        dt_s = 0.0 if isnan(self._last_s) else max(m.time_s - self._last_s, 0.0)
        self._last_s = m.time_s
        if dt_s > _GAP_S:
            self._depth.restart()
            self._temperature.restart()
        has_depth, has_torque, has_temperature = (
            valid and name not in m.held
            for name, valid in zip(
                REQUIRED, (m.depth_valid, m.torque_valid, m.temperature_valid), strict=True
            )
        )
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
