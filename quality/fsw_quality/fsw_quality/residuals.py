"""Measured values minus the process model's, and their sensitivities to its coefficients.

The drives report the force and the speed that act, so each equation of the model connects measured
values alone, whatever controller commands. The residuals compare:

- torque, (18)-(23) from force, depth and speed: the measured torque with the model's;
- depth, (17) and (27) from force, depth and temperature: the depth without the temperature's
  share with what the force has pressed the shoulder in;
- heat, (16) and (24) from torque, speed and temperature: the measured temperature with what the
  power has heated.

The model is stepped once with its coefficients and once for each coefficient that is uncertain, a
little changed; the differences are the sensitivities.
"""

from __future__ import annotations

from math import exp
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from fsw_analysis.weld_signals import FloatArray
from fsw_control.schema.models import InputError
from fsw_control.units import KW_PER_NM_RPM, RAD_PER_S_PER_RPM
from fsw_model import STEP_S, ModelParameters, equations

TORQUE, DEPTH, HEAT = range(3)
#: coefficients of the model that are uncertain; behind them, the lag of the thermocouple's probe
#: [s]
COEFFICIENTS = (
    "thermal_gain_c_per_kw",
    "copper_lag_s",
    "tool_lag_s",
    "dead_time_s",
    "softening_per_c",
    "depth_gain_mm_per_kn_s",
    "depth_zero_s",
    "depth_pole_slow_s",
    "motor_lag_s",
    "sliding_friction",
    "sticking_stress_pa",
    "contact_slope",
    "friction_constant_nm",
)
#: relative change of a coefficient by which its sensitivity is computed; the dead time changes by
#: whole ticks
_CHANGE, _DEAD_TICKS = 0.03, 3
#: lag behind the model's temperature with which a probe shows it [s]: where the heat is known, a
#: typical probe's; on a canister, where the model's temperature is late itself, less (chosen)
_PROBE_S, _PROBE_LATE_S = 1.5, 0.3
#: span over which the slope of the temperature is measured, by which a lag of the probe shows in
#: the depth [ticks]
_SLOPE_TICKS = 40


class Values(NamedTuple):
    """Measured values and inputs that act, at a tick."""

    depth_mm: float
    torque_nm: float
    temperature_c: float
    force_kn: float
    speed_rpm: float


class Gains(NamedTuple):
    """What the signatures of faults need at a tick."""

    process_nm: float  #: torque of the process by the model
    nm_per_kn: float  #: of the model's torque, by force
    nm_per_mm: float  #: of the model's torque, by depth
    mm_per_c: float  #: of the depth, by temperature
    creep_mm: float  #: depth that the force has pressed in: the integral of it
    slow_mm: float  #: and the part with a lag
    heated_c: float  #: temperature that the power has made
    speed_rpm: float


class ModelResiduals:
    """Steps the model from measured values; at the first tick it starts from what is measured."""

    def __init__(self, parameters: ModelParameters, known_heat: bool = True) -> None:
        self._p = p = parameters
        self._lag_s = _PROBE_S if known_heat else _PROBE_LATE_S
        changes = dict.fromkeys(COEFFICIENTS, _CHANGE)
        changes["dead_time_s"] = _DEAD_TICKS * STEP_S / p.dead_time_s
        changed, relative = zip(*(_changed(p, *change) for change in changes.items()), strict=True)
        self._changes = np.array([*relative, 1.0])
        copies = [p, *changed, p]
        self._c: Any = SimpleNamespace(
            **{
                name: np.array([getattr(model, name) for model in copies])
                for name in ModelParameters.model_fields
            }
        )
        self._probe_s = np.append(np.zeros(len(copies) - 1), 1.0)
        self._follow = 1.0 - np.exp(-STEP_S / self._c.motor_lag_s)
        modes = [equations.depth_modes(model) for model in copies]
        self._slow = np.array([exp(poles[1] * STEP_S) for poles, _ in modes])
        self._slow_gain = np.array(
            [(exp(poles[1] * STEP_S) - 1.0) / poles[1] * gains[1] for poles, gains in modes]
        )
        self._creep_gain = np.array([gains[0] * STEP_S for _, gains in modes])
        self._thermal = np.array([_thermal_step(model) for model in copies]).T
        delays = np.array([round(model.dead_time_s / STEP_S) for model in copies])
        self._delays, self._rows = delays, np.arange(len(copies))
        self._heated = np.zeros((len(copies), int(delays.max()) + 1))
        self._unexplained = np.zeros(_SLOPE_TICKS)  # temperature less the model's
        self._at = -1
        #: edges of the workpiece that have passed: they move the zero of the depth, and not what
        #: the tool stirs
        self.edges_mm = 0.0

    def step(self, now: Values) -> FloatArray:
        """Residuals at a tick, shape (3, 1 + coefficients).

        By the model, and by each of its changed copies.

        Where the torque is NaN, the model's takes its place.
        """
        c, rise_c = self._c, now.temperature_c - self._c.operating_temperature_c
        first, self._at = self._at < 0, self._at + 1
        depth_mm = now.depth_mm - self.edges_mm
        static_nm = equations.process_torque_nm(c, now.force_kn, depth_mm)  # type: ignore[arg-type]
        friction_nm = equations.friction_torque_nm(c, now.speed_rpm)  # type: ignore[arg-type]
        self._process_nm, static_nm = static_nm, static_nm + friction_nm
        if first:
            self._speed, self._motor = now.speed_rpm, static_nm
            self._creep = self._slow_mm = np.zeros(rise_c.size)
            self._copper = self._tool = rise_c
            self._heated[:] = rise_c[:, None]
            self._unexplained[:], self._shown = (
                now.temperature_c - float(rise_c[0]),
                float(rise_c[0]),
            )
        inertia_nm = (
            self._p.spindle_inertia_kgm2
            * RAD_PER_S_PER_RPM
            * (now.speed_rpm - self._speed)
            / STEP_S
        )
        self._motor = self._motor + self._follow * (static_nm - self._motor)
        pushed = now.force_kn - c.operating_force_kn
        self._creep = self._creep + self._creep_gain * pushed
        self._slow_mm = self._slow * self._slow_mm + self._slow_gain * pushed
        measured_nm = now.torque_nm if np.isfinite(now.torque_nm) else self._motor + inertia_nm
        self._heat(
            (measured_nm - inertia_nm - friction_nm) * now.speed_rpm * KW_PER_NM_RPM
            - c.operating_power_kw
        )
        delayed = self._heated[self._rows, (self._at - self._delays) % self._heated.shape[1]]
        slope = self._slope(now.temperature_c, float(delayed[0]))
        self._speed, self._force, self._sunk = now.speed_rpm, now.force_kn, depth_mm
        stretch = 1.0 + c.softening_per_c * (rise_c + self._probe_s * slope)
        return np.stack(
            [
                measured_nm - inertia_nm - self._motor,
                depth_mm / stretch - c.operating_depth_mm - self._creep - self._slow_mm,
                rise_c - delayed,
            ]
        )

    def expected_nm(self, speed_rpm: float) -> float:
        """Torque that the model expects before the tick's own values are in it."""
        if self._at < 0:
            return 0.0
        inertia_nm = (
            self._p.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM * (speed_rpm - self._speed) / STEP_S
        )
        return float(self._motor[0]) + inertia_nm

    def sensitivities(self, residuals: FloatArray) -> FloatArray:
        """Change of the measured values (3, coefficients) by a relative one of a coefficient."""
        return (residuals[:, :1] - residuals[:, 1:]) / self._changes

    def gains(self) -> Gains:
        """What the signatures of faults need at this tick."""
        p, force, depth = self._p, self._force, self._sunk
        small = np.array([0.0, 0.1, 0.0]), np.array([0.0, 0.0, 0.01])
        here, by_force, by_depth = equations.process_torque_nm(  # type: ignore[arg-type]
            p,
            force + small[0],  # type: ignore[arg-type]
            depth + small[1],  # type: ignore[arg-type]
        )
        return Gains(
            float(here),
            float(by_force - here) / 0.1,
            float(by_depth - here) / 0.01,
            p.softening_per_c * depth,
            float(self._creep[0]),
            float(self._slow_mm[0]),
            float(self._heated[0, (self._at - self._delays[0]) % self._heated.shape[1]]),
            self._speed,
        )

    def _slope(self, temperature_c: float, heated_c: float) -> float:
        """Slope of the temperature [degC/s].

        The model's, which has no noise, and the mean one of what it leaves.
        """
        place, unexplained = self._at % _SLOPE_TICKS, temperature_c - heated_c
        slope = (unexplained - self._unexplained[place]) / (_SLOPE_TICKS * STEP_S)
        self._unexplained[place] = unexplained
        behind = heated_c - self._shown  # of the model's temperature, as a probe shows it
        self._shown += STEP_S / self._lag_s * behind
        return slope + behind / self._lag_s

    def _heat(self, power_kw: FloatArray) -> None:
        aa, ab, ap, ba, bb, bp = self._thermal
        copper, tool = self._copper, self._tool
        self._copper = aa * copper + ab * tool + ap * power_kw
        self._tool = ba * copper + bb * tool + bp * power_kw
        self._heated[:, self._at % self._heated.shape[1]] = self._tool


def _changed(p: ModelParameters, name: str, change: float) -> tuple[ModelParameters, float]:
    """A copy with a coefficient that is changed, and by how much.

    Less of it where its range ends.
    """
    try:
        return p.scaled(**{name: 1.0 + change}), change
    except InputError:
        return p.scaled(**{name: 1.0 - change}), -change


def _thermal_step(p: ModelParameters) -> tuple[float, ...]:
    """A step of (copper, tool): its six coefficients."""
    a, b = equations.thermal_block(p)
    whole = np.zeros((3, 3))
    whole[:2, :2], whole[:2, 2] = a, b
    stepped = equations.matrix_exponential(whole * STEP_S)
    return tuple(float(value) for value in (*stepped[0], *stepped[1]))
