"""State and disturbance estimation on the same model, with the delay line.

An extended Kalman filter on the linear blocks and five disturbances: of the axial force, of the temperature, of the
depth (an offset of the depth shown that the tool does not feel), the scale of the process torque and the heat that
comes of the power. The depth sensor sees contact depth plus offset, the torque sensor the contact depth alone; together
they make the closed loop free of offset and keep the power history right when the depth sensor jumps. An output that
jumps is told from one that creeps by the size of the innovation: its excess over the usual size widens the variance of
the output's offset for this one update.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, sqrt

import numpy as np
from numpy.typing import NDArray

from fsw_control import Command, Measurement
from fsw_model import STEP_S, ModelParameters
from fsw_model.codegen import python_function
from fsw_model.equations import RAD_PER_S_PER_RPM
from fsw_nmpc.horizon import make_horizon
from fsw_nmpc.kernel_codegen import TORQUE_PARAMETERS, torque_function
from fsw_nmpc.ocp import Estimate

Vector = NDArray[np.float64]
FORCE, TEMPERATURE_OFFSET, DEPTH_OFFSET, SCALE, HEAT = 5, 6, 7, 8, 9
N = 10
CONTACT_DEPTH = np.array([1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
DEPTH_SHOWN = CONTACT_DEPTH + np.eye(N)[DEPTH_OFFSET]
TEMPERATURE_SHOWN = np.eye(N)[4] + np.eye(N)[TEMPERATURE_OFFSET]

#: beyond these an estimate is not of this process
_DEEPEST_MM, _COLDEST_C, _HOTTEST_C, _LARGEST_OFFSET_KN = 20.0, 0.0, 2000.0, 50.0
#: keeps an update defined where tuning and covariance are zero
_LEAST_VARIANCE = 1e-18
_LEAST_SCALE, _LARGEST_SCALE = 0.5, 2.0


@dataclass(frozen=True, slots=True)
class EstimatorTuning:
    """Standard deviations: of the sensors, and of the random walk of each state per tick."""

    depth_noise_mm: float = 2e-3
    temperature_noise_c: float = 0.1
    torque_noise_nm: float = 1.0
    creep_walk_mm: float = 2e-5
    depth_offset_walk_mm: float = 7e-4
    thermal_depth_walk_mm: float = 1e-5
    temperature_walk_c: float = 3e-3
    force_walk_kn: float = 1e-2
    temperature_offset_walk_c: float = 1.5e-2
    torque_scale_walk: float = 9e-5
    heat_scale_walk: float = 1e-4
    jump_sigmas: float = 4.0
    blind_limit_s: float = 3.0


class Estimator:
    """Estimates the :class:`~fsw_nmpc.ocp.Estimate` that a prediction starts from.

    Parameters
    ----------
    parameters : ModelParameters
    tuning : EstimatorTuning, optional

    Attributes
    ----------
    is_started : bool
        Whether there is an estimate; to be cleared for a new start.
    """

    def __init__(self, parameters: ModelParameters, tuning: EstimatorTuning | None = None) -> None:
        self.parameters = parameters
        table = make_horizon(parameters)
        self._mode = tuple(float(v) for v in table.modes[0])
        self._weight = tuple(float(v) for v in table.weight[0])
        self._torque = python_function(torque_function())
        self._torque_par = tuple(float(getattr(parameters, name)) for name in TORQUE_PARAMETERS)
        creep, e1, g1, e2, g2, p_tt, p_tc, p_cc, _, _ = self._mode
        a = np.eye(N)
        a[1, 1], a[2, 2], a[3, 3], a[3, 4], a[4, 4] = e1, e2, p_tt, p_tc, p_cc
        a[0, FORCE], a[1, FORCE], a[2, FORCE] = creep, g1, g2
        self._a, self._a_transposed = a, np.ascontiguousarray(a.T)
        self._shallowest_mm = 1.05 * parameters.shallowest_depth_mm
        self._x, self._p = np.zeros(N), np.zeros((N, N))
        self._scratch, self._torque_row = np.zeros((N, N)), np.zeros(N)
        self._history_kw = np.zeros(2 * table.n_history)
        self._last_speed = 0.0
        self._blind = {"depth": 0.0, "torque": 0.0, "thermocouple": 0.0}
        self.is_started = False
        self.configure(tuning or EstimatorTuning())

    def configure(self, tuning: EstimatorTuning) -> None:
        """Change the tuning at runtime; the estimate goes on."""
        self.tuning = t = tuning
        walk = np.zeros(N)
        walk[[0, 3, 4]] = t.creep_walk_mm, t.thermal_depth_walk_mm, t.temperature_walk_c
        walk[FORCE], walk[TEMPERATURE_OFFSET] = t.force_walk_kn, t.temperature_offset_walk_c
        walk[DEPTH_OFFSET], walk[SCALE], walk[HEAT] = t.depth_offset_walk_mm, t.torque_scale_walk, t.heat_scale_walk
        self._walk = np.diag(walk**2)

    def start(self, measurement: Measurement, applied: Command) -> bool:
        """Begin at rest at a measurement; False if a sensor that is needed is invalid."""
        p = self.parameters
        if not (measurement.depth_valid and measurement.temperature_valid):
            return False
        if not (_plausible_depth(p, measurement.depth_mm) and _plausible_temperature(measurement.temperature_c)):
            return False
        thermal = p.softening_gain_mm_per_c * (measurement.temperature_c - p.operating_temperature_c)
        creep = measurement.depth_mm - p.operating_depth_mm - thermal
        torque = self._model_torque(applied.force_kn, measurement.depth_mm)[0]
        scale = 1.0
        if measurement.torque_valid and isfinite(measurement.torque_nm):
            friction = p.bearing_torque_nm + p.bearing_viscosity_nm_per_rpm * applied.speed_rpm
            scale = min(max((measurement.torque_nm - friction) / torque, _LEAST_SCALE), _LARGEST_SCALE)
        power = scale * torque * applied.speed_rpm * RAD_PER_S_PER_RPM * 1e-3
        needed = (measurement.temperature_c - p.ambient_temperature_c) / p.thermal_gain_c_per_kw
        heat = min(max(needed / max(power, 1.0), _LEAST_SCALE), _LARGEST_SCALE)
        self._x[:] = creep, 0.0, 0.0, thermal, measurement.temperature_c, 0.0, 0.0, 0.0, scale, heat
        self._p[:] = np.diag(np.square([5e-3, 1e-3, 1e-4, 1e-3, 0.2, 0.2, 0.2, 1e-3, 5e-3, 5e-3]))
        self._last_speed = applied.speed_rpm
        self._blind = dict.fromkeys(self._blind, 0.0)
        self._history_kw[:] = needed / heat
        self.is_started = True
        return True

    def step(self, measurement: Measurement, applied: Command) -> bool:
        """Advance one tick: predict with the command applied during it, correct with the sensors at its end.

        Returns
        -------
        bool
            Whether the estimate is sound. If it is not, it has ended (``is_started``) and must be started anew.
        """
        self._predict(applied)
        self._correct(measurement, applied)
        self._last_speed = applied.speed_rpm
        self.is_started = self._is_sound()
        return self.is_started

    def _is_sound(self) -> bool:
        """Whether states and variances are finite and where a weld can be."""
        return (
            _plausible_depth(self.parameters, self.contact_depth_mm)
            and isfinite(float(self._x.sum()))
            and _plausible_temperature(float(self._x[4]))
            and abs(float(self._x[FORCE])) < _LARGEST_OFFSET_KN
            and isfinite(float(self._p.sum()))
            and float(self._p.diagonal().min()) >= 0.0
        )

    def _predict(self, applied: Command) -> None:
        p = self.parameters
        creep_gain, e1, g1, e2, g2, p_tt, p_tc, p_cc, c_t, c_c = self._mode
        creep, slow, fast, thermal, temperature, force_offset, _, _, scale, heat = self._x.tolist()
        force = applied.force_kn + force_offset
        pushed = force - p.operating_force_kn
        before = p.operating_depth_mm + creep + slow + fast + thermal
        history = self._history_kw
        left, right = float(history[0]), float(history[1])
        w = self._weight
        to_thermal, to_temperature = w[0] * left + w[1] * right, w[2] * left + w[3] * right
        self._a[3, HEAT], self._a[4, HEAT] = to_thermal, to_temperature
        self._a_transposed[HEAT, 3], self._a_transposed[HEAT, 4] = to_thermal, to_temperature
        thermal, temperature = (
            p_tt * thermal + p_tc * temperature + c_t + heat * to_thermal,
            p_cc * temperature + c_c + heat * to_temperature,
        )
        creep, slow, fast = creep + creep_gain * pushed, e1 * slow + g1 * pushed, e2 * fast + g2 * pushed
        after = p.operating_depth_mm + creep + slow + fast + thermal
        kw = RAD_PER_S_PER_RPM * 1e-3 * applied.speed_rpm * scale
        history[:-2] = history[2:]
        history[-2] = kw * self._model_torque(force, before)[0]
        history[-1] = kw * self._model_torque(force, after)[0]
        self._x[:5] = creep, slow, fast, thermal, temperature
        np.dot(self._a, self._p, out=self._scratch)
        np.dot(self._scratch, self._a_transposed, out=self._p)
        self._p += self._walk

    def _model_torque(self, force_kn: float, depth_mm: float) -> tuple[float, ...]:
        """Torque of the unscaled model and its derivatives by force and depth."""
        return self._torque(force_kn, max(depth_mm, self._shallowest_mm), *self._torque_par)

    def _correct(self, m: Measurement, applied: Command) -> None:
        p, t = self.parameters, self.tuning
        depth_valid = m.depth_valid and _plausible_depth(p, m.depth_mm)
        force = applied.force_kn + float(self._x[FORCE])
        torque, by_force, by_depth = self._model_torque(force, self.contact_depth_mm)
        friction = p.bearing_torque_nm + p.bearing_viscosity_nm_per_rpm * applied.speed_rpm
        spike = p.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM * (applied.speed_rpm - self._last_speed) / STEP_S
        process_torque = m.torque_nm - friction - spike
        torque_valid = m.torque_valid and _LEAST_SCALE * torque < process_torque < _LARGEST_SCALE * torque
        temperature_valid = m.temperature_valid and _plausible_temperature(m.temperature_c)
        blind = self._blind
        blind["depth"] = 0.0 if depth_valid else blind["depth"] + STEP_S
        blind["torque"] = 0.0 if torque_valid else blind["torque"] + STEP_S
        blind["thermocouple"] = 0.0 if temperature_valid else blind["thermocouple"] + STEP_S
        if torque_valid:
            # the drive's lag smears the spike over two ticks: the more acceleration, the less a sample counts
            noise = t.torque_noise_nm + 0.3 * abs(spike)
            scale = float(self._x[SCALE])
            row = self._torque_row
            row[:4] = scale * by_depth
            row[FORCE], row[SCALE] = scale * by_force, torque
            self._update(row, process_torque - scale * torque, noise)
        if depth_valid:
            innovation = m.depth_mm - self.depth_mm
            self._expect_jump(DEPTH_OFFSET, DEPTH_SHOWN, innovation, t.depth_noise_mm)
            self._update(DEPTH_SHOWN, innovation, t.depth_noise_mm)
        if temperature_valid:
            innovation = m.temperature_c - self.temperature_c
            self._expect_jump(TEMPERATURE_OFFSET, TEMPERATURE_SHOWN, innovation, t.temperature_noise_c)
            self._update(TEMPERATURE_SHOWN, innovation, t.temperature_noise_c)
        for i in (SCALE, HEAT):
            self._x[i] = min(max(float(self._x[i]), _LEAST_SCALE), _LARGEST_SCALE)

    def _expect_jump(self, offset: int, row: Vector, innovation: float, noise: float) -> None:
        """An innovation beyond its usual size widens the variance of the output's disturbance by the excess."""
        if self.tuning.jump_sigmas <= 0.0:
            return
        usual = float(row @ self._p @ row) + noise * noise
        excess = innovation * innovation - self.tuning.jump_sigmas**2 * usual
        if excess > 0.0:
            self._p[offset, offset] += excess

    def _update(self, row: Vector, innovation: float, noise: float) -> None:
        """Scalar Kalman update with the measurement's linearisation ``row``."""
        cross = np.dot(self._p, row)
        per_variance = 1.0 / (float(np.dot(row, cross)) + noise * noise + _LEAST_VARIANCE)
        self._x += cross * (innovation * per_variance)
        np.multiply(cross[:, None], cross * per_variance, out=self._scratch)
        self._p -= self._scratch

    @property
    def contact_depth_mm(self) -> float:
        """Estimated depth that the tool feels."""
        return self.parameters.operating_depth_mm + float(np.dot(CONTACT_DEPTH, self._x))

    @property
    def depth_mm(self) -> float:
        """Estimated depth, as the sensor would show it without noise."""
        return self.parameters.operating_depth_mm + float(np.dot(DEPTH_SHOWN, self._x))

    @property
    def temperature_c(self) -> float:
        """Estimated temperature, including its disturbance."""
        return float(self._x[4]) + float(self._x[TEMPERATURE_OFFSET])

    @property
    def depth_offset_mm(self) -> float:
        """Estimated disturbance of the depth shown."""
        return float(self._x[DEPTH_OFFSET])

    @property
    def temperature_offset_c(self) -> float:
        """Estimated disturbance of the temperature shown."""
        return float(self._x[TEMPERATURE_OFFSET])

    @property
    def depth_deviation_mm(self) -> float:
        """Standard deviation of the depth estimate."""
        return sqrt(max(float(DEPTH_SHOWN @ self._p @ DEPTH_SHOWN), 0.0))

    @property
    def blind_sensors(self) -> tuple[str, ...]:
        """Sensors missing for longer than ``blind_limit_s``."""
        return tuple(name for name, time_s in self._blind.items() if time_s > self.tuning.blind_limit_s + 1e-9)

    def disturbances(self) -> dict[str, float]:
        """Disturbance states by name, with unit."""
        return {
            "axial_force [kN]": float(self._x[FORCE]),
            "temperature [degC]": float(self._x[TEMPERATURE_OFFSET]),
            "depth [mm]": float(self._x[DEPTH_OFFSET]),
            "torque scale [1]": float(self._x[SCALE]),
            "heat scale [1]": float(self._x[HEAT]),
        }

    def estimate(self) -> Estimate:
        """Starting point of a prediction."""
        return Estimate(
            x=self._x[:5].copy(),
            history_kw=self._history_kw * self._x[HEAT],
            force_offset_kn=float(self._x[FORCE]),
            torque_scale=float(self._x[SCALE] * self._x[HEAT]),
            depth_offset_mm=float(self._x[DEPTH_OFFSET]),
            temperature_offset_c=float(self._x[TEMPERATURE_OFFSET]),
        )


def _plausible_depth(parameters: ModelParameters, depth_mm: float) -> bool:
    return parameters.shallowest_depth_mm < depth_mm < _DEEPEST_MM


def _plausible_temperature(temperature_c: float) -> bool:
    return _COLDEST_C < temperature_c < _HOTTEST_C
