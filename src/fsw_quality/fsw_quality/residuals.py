"""What the process model says of the measured values, without any controller: three residuals and the gains.

The drives report the force and the speed that act, so each equation of the model connects measured values alone:

========== ================================================ =======================================================
residual   equation                                         compares
========== ================================================ =======================================================
torque     (18)-(23) from force, depth and speed            measured torque with the model's
depth      (17), (27) from force, depth and temperature     depth, temperature's share taken out, with what the force
                                                            has pressed the shoulder in
heat       (16), (24) from torque, speed and temperature    measured temperature with what the power has heated
========== ================================================ =======================================================

Each sensor has its part in other residuals, which is what tells them apart (structured residuals, Gertler, Fault
Detection and Diagnosis in Engineering Systems, 1998).
"""

from __future__ import annotations

from math import exp, sqrt
from typing import NamedTuple

import casadi as ca
import numpy as np

from fsw_analysis.weld_signals import FloatArray
from fsw_control.units import KW_PER_NM_RPM, RAD_PER_S_PER_RPM
from fsw_model import STEP_S, ModelParameters, equations
from fsw_quality.noise import Noise

#: a jump from one sample to the next, in standard deviations of the noise, that no process makes: an edge of the
#: workpiece, a step of the sensor (chosen)
JUMP = 8.0
#: least noise of the depth that is reckoned with [mm], and the time over which it is looked at [s] (chosen)
DEPTH_NOISE_MM, _NOISE_S = 0.003, 3.0


class Residuals(NamedTuple):
    """Measured minus model at a tick, and what the estimates of the gains need."""

    torque_nm: float
    depth_mm: float  #: drifts by itself: depth integrates, so only its slope means something
    heat_c: float
    model_torque_nm: float  #: process torque of the model
    pressed_mm: float  #: Delta l that the force has made, and
    sunk_mm: float  #: Delta l that is measured, without edges of the workpiece
    heated_c: float  #: temperature that the power makes without dead time
    rise_c: float  #: measured temperature above the operating point
    power_kw: float


class ModelResiduals:
    """Steps the model from measured values; at the first tick it starts from what is measured."""

    def __init__(self, parameters: ModelParameters) -> None:
        self._p = p = parameters
        force, depth, speed = ca.SX.sym("force"), ca.SX.sym("depth"), ca.SX.sym("speed")
        self._torques = ca.Function(
            "torques",
            [force, depth, speed],
            [ca.vertcat(equations.process_torque_nm(p, force, depth), equations.friction_torque_nm(p, speed))],
        )
        self._follow = 1.0 - exp(-STEP_S / p.motor_lag_s)
        poles, gains = equations.depth_modes(p)
        self._slow = exp(poles[1] * STEP_S)
        self._slow_gain = (self._slow - 1.0) / poles[1] * gains[1]
        self._creep_gain = gains[0] * STEP_S
        a, b = equations.thermal_block(p)
        whole = np.zeros((3, 3))
        whole[:2, :2], whole[:2, 2] = a, b
        stepped = equations.matrix_exponential(whole * STEP_S)
        self._thermal = [float(one) for one in (*stepped[0], *stepped[1])]
        self._delay = round(p.dead_time_s / STEP_S)
        self._first = True
        self._depth = self._edges = self._moves = 0.0

    def step(
        self, depth_mm: float, torque_nm: float, temperature_c: float, force_kn: float, speed_rpm: float
    ) -> Residuals:
        """Residuals at a tick; ``force_kn`` and ``speed_rpm`` act, as the drives report them."""
        p = self._p
        depth_mm = self._without_edges(depth_mm)
        process_nm, friction_nm = (float(one) for one in self._torques(force_kn, depth_mm, speed_rpm).nonzeros())
        rise_c, static_nm = temperature_c - p.operating_temperature_c, process_nm + friction_nm
        if self._first:
            self._speed, self._motor = speed_rpm, static_nm
            self._creep = self._slow_mm = 0.0
            self._copper = self._tool = rise_c
            self._heated = [rise_c] * (self._delay + 1)
            self._first = False
        inertia_nm = p.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM * (speed_rpm - self._speed) / STEP_S
        self._speed = speed_rpm
        self._motor += self._follow * (static_nm - self._motor)
        pushed = force_kn - p.operating_force_kn
        self._creep += self._creep_gain * pushed
        self._slow_mm = self._slow * self._slow_mm + self._slow_gain * pushed
        sunk = depth_mm / (1.0 + p.softening_per_c * rise_c) - p.operating_depth_mm
        power = (torque_nm - inertia_nm - friction_nm) * speed_rpm * KW_PER_NM_RPM
        self._heat(power - p.operating_power_kw)
        pressed = self._creep + self._slow_mm
        return Residuals(
            torque_nm - inertia_nm - self._motor,
            sunk - pressed,
            rise_c - self._heated[0],
            process_nm,
            pressed,
            sunk,
            self._heated[-1],
            rise_c,
            power,
        )

    def _without_edges(self, depth_mm: float) -> float:
        """An edge of the workpiece moves what depth is measured from, and not what the tool stirs."""
        moved = 0.0 if self._first else depth_mm - self._depth
        self._depth = depth_mm
        if abs(moved) > JUMP * max(DEPTH_NOISE_MM, self._moves):
            self._edges += moved
        self._moves += STEP_S / _NOISE_S * (abs(moved) - self._moves)
        return depth_mm - self._edges

    def heated_c(self, torque: Noise) -> float:
        """Standard deviation of the temperature that a correlated noise of the torque seems to make, at this speed."""
        if not torque.correlation_s:
            return 0.0
        step, fresh = np.zeros((3, 3)), np.zeros((3, 3))
        step[:2], step[2, 2] = np.reshape(self._thermal, (2, 3)), torque.autocorrelation
        fresh[2, 2] = (torque.sigma * self._speed * KW_PER_NM_RPM) ** 2 * (1.0 - torque.autocorrelation**2)
        # the variance that a step keeps: P = A P A' + Q
        kept = np.linalg.solve(np.eye(9) - np.kron(step, step), fresh.ravel()).reshape(3, 3)
        return sqrt(float(kept[1, 1]))

    def _heat(self, power_kw: float) -> None:
        aa, ab, ap, ba, bb, bp = self._thermal
        copper, tool = self._copper, self._tool
        self._copper = aa * copper + ab * tool + ap * power_kw
        self._tool = ba * copper + bb * tool + bp * power_kw
        self._heated.pop(0)
        self._heated.append(self._tool)


class Gain(NamedTuple):
    """A gain relative to the model's, its standard error, and the dead time [s] at which the model fits best."""

    gain: float
    error: float
    dead_time_s: float
    #: by how much the nominal dead time fits worse: ratio of the sums of squares, less 1
    worse: float
    excited: bool


class GainEstimate:
    """Least squares with forgetting of a gain, for several dead times at once.

    Model response and measured value pass the same washout (first order), so that offsets and slow drifts do not count;
    for each dead time, a gain is estimated recursively (least squares with exponential forgetting, Ljung, System
    Identification, 11.2). The best dead time is where the least is left over. Without excitation nothing is said: the
    model response must move by ``least`` (root of the mean square, in its unit). The first dead time is the nominal
    one, ``noise`` the standard deviation of the measurement's noise, below which the rest does not count, and
    ``forget_s`` the time constant of the forgetting.
    """

    WASHOUT_S = 40.0
    #: the rest is no white noise; so many samples count as one at least
    CORRELATED = 10.0

    def __init__(self, dead_times_s: tuple[float, ...], least: float, noise: float, forget_s: float) -> None:
        self._behind = np.array([round(one / STEP_S) for one in dead_times_s])
        self._dead_times_s, self._least, self._noise = np.array(dead_times_s), least, noise
        self._keep, self._forget = exp(-STEP_S / self.WASHOUT_S), exp(-STEP_S / forget_s)
        self._history = np.zeros(int(self._behind.max()) + 1)
        self._at = 0
        self._xx = self._xy = np.zeros(len(dead_times_s))
        self._yy, self._weight = 0.0, 0.0
        self._last: tuple[float, float] | None = None
        self._x = self._y = 0.0
        self._correlated = self.CORRELATED
        self._cause_noise = 0.0

    def noisy(self, correlated: float, cause_noise: float) -> None:
        """Noise is coloured: so many samples count as one, and the response has a standard deviation of noise, too."""
        self._correlated = max(self.CORRELATED, correlated)
        self._cause_noise = cause_noise

    def step(self, response: float, measured: float) -> None:
        """Take the model's response without dead time, and what was measured."""
        if self._last is None:
            self._last = response, measured
        moved = measured - self._last[1]
        if abs(moved) > JUMP * self._noise:
            moved = 0.0
        self._x = self._keep * (self._x + response - self._last[0])
        self._y = self._keep * (self._y + moved)
        self._last = response, measured
        self._at = (self._at + 1) % self._history.size
        self._history[self._at] = self._x
        x = self._history[(self._at - self._behind) % self._history.size]
        self._xx = self._forget * self._xx + x * x
        self._xy = self._forget * self._xy + x * self._y
        self._yy = self._forget * self._yy + self._y**2
        self._weight = self._forget * self._weight + 1.0

    def estimate(self) -> Gain:
        """The gain now."""
        spoilt = self._cause_noise**2
        if self._weight < 100.0 or float(self._xx[0]) / self._weight - spoilt < self._least**2:
            return Gain(1.0, float("inf"), float(self._dead_times_s[0]), 0.0, False)
        xx = np.maximum(self._xx, 1e-12)
        floor = (self._noise**2 + spoilt) * self._weight
        rest: FloatArray = np.maximum(self._yy - self._xy**2 / xx, 0.0) + floor
        best = int(np.argmin(rest))
        sigma2 = float(rest[best]) / self._weight
        gain = float(self._xy[best] / xx[best])
        error = sqrt(sigma2 * self._correlated / float(xx[best]))
        error += abs(gain) * spoilt * self._weight / float(xx[best])  # noise of the response lessens the gain
        worse = float(rest[0] / rest[best]) - 1.0
        return Gain(gain, error, float(self._dead_times_s[best]), worse, True)
