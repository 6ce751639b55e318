"""State and disturbance estimation on the same model, with the delay line.

A Kalman filter on the linear blocks, extended by an axial-force disturbance and a temperature disturbance, and a scalar
filter for the scale of the process torque. Depth integrates the force, so a constant depth disturbance is part of the
creep state, which has its own process noise. Together they make the closed loop free of offset.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import isfinite, sqrt

import numpy as np
from numpy.typing import NDArray

from fsw_control import Command, Measurement
from fsw_model import STEP_S, ModelParameters, ProcessModel
from fsw_model.codegen import python_function
from fsw_model.equations import RAD_PER_S_PER_RPM
from fsw_nmpc.horizon import make_horizon
from fsw_nmpc.kernel_codegen import TORQUE_PARAMETERS, torque_function
from fsw_nmpc.ocp import Estimate

Vector = NDArray[np.float64]
FORCE, TEMPERATURE_OFFSET = 5, 6
N = 7


@dataclass(frozen=True, slots=True)
class EstimatorTuning:
    """Standard deviations: of the sensors, and of the random walk of each state per tick."""

    depth_noise_mm: float = 2e-3
    temperature_noise_c: float = 0.1
    torque_noise_nm: float = 4.0
    creep_walk_mm: float = 1.0e-3
    thermal_depth_walk_mm: float = 1e-5
    temperature_walk_c: float = 5e-3
    force_walk_kn: float = 2e-2
    temperature_offset_walk_c: float = 5e-2
    torque_scale_walk: float = 1e-3
    blind_limit_s: float = 3.0


class Estimator:
    """Estimates the :class:`~fsw_nmpc.ocp.Estimate` that a prediction starts from.

    Parameters
    ----------
    parameters : ModelParameters
    tuning : EstimatorTuning, optional
    """

    def __init__(self, parameters: ModelParameters, tuning: EstimatorTuning | None = None) -> None:
        self.parameters = parameters
        self.tuning = tuning or EstimatorTuning()
        self._model = ProcessModel(parameters)
        table = make_horizon(parameters)
        self._mode = tuple(float(v) for v in table.modes[0])
        self._weight = tuple(float(v) for v in table.weight[0])
        self._torque = python_function(torque_function())
        self._torque_par = tuple(float(getattr(parameters, name)) for name in TORQUE_PARAMETERS)
        creep, e1, g1, e2, g2, p_tt, p_tc, p_cc, _, _ = self._mode
        a = np.eye(N)
        a[1, 1], a[2, 2], a[3, 3], a[3, 4], a[4, 4] = e1, e2, p_tt, p_tc, p_cc
        a[0, FORCE], a[1, FORCE], a[2, FORCE] = creep, g1, g2
        self._a = a
        t = self.tuning
        self._walk = np.diag(
            np.square([t.creep_walk_mm, 0.0, 0.0, t.thermal_depth_walk_mm, t.temperature_walk_c, t.force_walk_kn,
                       t.temperature_offset_walk_c])
        )  # fmt: skip
        self.is_started = False

    def start(self, measurement: Measurement, applied: Command) -> bool:
        """Begin at rest at a measurement; False if a sensor that is needed is invalid."""
        p = self.parameters
        if not (measurement.depth_valid and measurement.temperature_valid):
            return False
        if measurement.depth_mm <= p.shallowest_depth_mm:
            return False
        thermal = p.softening_gain_mm_per_c * (measurement.temperature_c - p.operating_temperature_c)
        creep = measurement.depth_mm - p.operating_depth_mm - thermal
        self._x = np.array([creep, 0.0, 0.0, thermal, measurement.temperature_c, 0.0, 0.0])
        self._p = np.diag(np.square([5e-3, 1e-3, 1e-4, 1e-2, 0.2, 0.5, 1.0]))
        self._scale, self._scale_var = 1.0, 0.05**2
        self._last_speed = applied.speed_rpm
        self._blind = {"depth": 0.0, "torque": 0.0, "thermocouple": 0.0}
        power = (measurement.temperature_c - p.ambient_temperature_c) / p.thermal_gain_c_per_kw
        self._history: deque[tuple[float, float]] = deque([(power, power)] * self._model.delay_steps)
        self.is_started = True
        return True

    def step(self, measurement: Measurement, applied: Command) -> None:
        """Advance one tick: predict with the command applied during it, correct with the sensors at its end."""
        self._predict(applied)
        self._correct(measurement, applied)
        self._last_speed = applied.speed_rpm

    def _predict(self, applied: Command) -> None:
        p = self.parameters
        creep_gain, e1, g1, e2, g2, p_tt, p_tc, p_cc, c_t, c_c = self._mode
        creep, slow, fast, thermal, temperature, force_offset, offset = self._x.tolist()
        force = applied.force_kn + force_offset
        pushed = force - p.operating_force_kn
        before = p.operating_depth_mm + creep + slow + fast + thermal
        left, right = self._history.popleft()
        w = self._weight
        thermal, temperature = (
            p_tt * thermal + p_tc * temperature + c_t + w[0] * left + w[1] * right,
            p_cc * temperature + c_c + w[2] * left + w[3] * right,
        )
        creep, slow, fast = creep + creep_gain * pushed, e1 * slow + g1 * pushed, e2 * fast + g2 * pushed
        after = p.operating_depth_mm + creep + slow + fast + thermal
        kw = RAD_PER_S_PER_RPM * 1e-3 * applied.speed_rpm * self._scale
        self._history.append((kw * self._model_torque(force, before), kw * self._model_torque(force, after)))
        self._x = np.array([creep, slow, fast, thermal, temperature, force_offset, offset])
        self._p = self._a @ self._p @ self._a.T + self._walk

    def _model_torque(self, force_kn: float, depth_mm: float) -> float:
        depth = max(depth_mm, self.parameters.shallowest_depth_mm * 1.05)
        return self._torque(force_kn, depth, *self._torque_par)[0]

    def _correct(self, m: Measurement, applied: Command) -> None:
        p, t = self.parameters, self.tuning
        if m.depth_valid and isfinite(m.depth_mm):
            self._update((0, 1, 2, 3), m.depth_mm - p.operating_depth_mm, t.depth_noise_mm)
            self._blind["depth"] = 0.0
        else:
            self._blind["depth"] += STEP_S
        if m.temperature_valid and isfinite(m.temperature_c):
            self._update((4, TEMPERATURE_OFFSET), m.temperature_c, t.temperature_noise_c)
            self._blind["thermocouple"] = 0.0
        else:
            self._blind["thermocouple"] += STEP_S
        self._scale_var += t.torque_scale_walk**2
        if m.torque_valid and isfinite(m.torque_nm):
            self._blind["torque"] = 0.0
            friction = p.bearing_torque_nm + p.bearing_viscosity_nm_per_rpm * applied.speed_rpm
            acceleration = abs(applied.speed_rpm - self._last_speed) / STEP_S
            # the inertia spike has no use here: the more the spindle accelerates, the less the sample counts
            noise = t.torque_noise_nm + p.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM * acceleration
            model = self._model_torque(applied.force_kn + self._x[FORCE], self.depth_mm)
            gain = self._scale_var * model / (self._scale_var * model**2 + noise**2)
            self._scale += gain * (m.torque_nm - friction - self._scale * model)
            self._scale = min(max(self._scale, 0.5), 2.0)
            self._scale_var *= 1.0 - gain * model
        else:
            self._blind["torque"] += STEP_S

    def _update(self, states: tuple[int, ...], value: float, noise: float) -> None:
        """Scalar Kalman update for a measurement that is the sum of some states."""
        index = list(states)
        cross = self._p[:, index].sum(axis=1)
        variance = cross[index].sum() + noise**2
        innovation = value - self._x[index].sum()
        self._x = self._x + cross * (innovation / variance)
        self._p = self._p - np.outer(cross, cross) / variance

    @property
    def depth_mm(self) -> float:
        """Estimated depth."""
        return self.parameters.operating_depth_mm + float(self._x[:4].sum())

    @property
    def temperature_c(self) -> float:
        """Estimated temperature, including its disturbance."""
        return float(self._x[4] + self._x[TEMPERATURE_OFFSET])

    @property
    def depth_deviation_mm(self) -> float:
        """Standard deviation of the depth estimate."""
        return sqrt(max(float(self._p[:4, :4].sum()), 0.0))

    @property
    def blind_sensors(self) -> tuple[str, ...]:
        """Sensors missing for longer than ``blind_limit_s``."""
        return tuple(name for name, time_s in self._blind.items() if time_s > self.tuning.blind_limit_s + 1e-9)

    def disturbances(self) -> dict[str, float]:
        """Disturbance states by name, with unit."""
        return {
            "axial_force [kN]": float(self._x[FORCE]),
            "temperature [degC]": float(self._x[TEMPERATURE_OFFSET]),
            "torque scale [1]": self._scale,
        }

    def estimate(self) -> Estimate:
        """Starting point of a prediction."""
        return Estimate(
            x=self._x[:5].copy(),
            history_kw=np.array(self._history).ravel(),
            force_offset_kn=float(self._x[FORCE]),
            torque_scale=self._scale,
            temperature_offset_c=float(self._x[TEMPERATURE_OFFSET]),
        )
