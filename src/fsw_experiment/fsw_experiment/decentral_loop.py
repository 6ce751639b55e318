"""The decentralized controller in closed loop with a process model: robustness, noise and errors of a set of gains.

Sensitivity and noise come from the frequency response of the sampled, coupled loop, linearised about the operating
point; the errors from simulation of the nonlinear loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fsw_control import Command, Measurement, Reference
from fsw_control.units import RAD_PER_S_PER_RPM
from fsw_control.weld import DEPTH_MM, TEMPERATURE_C
from fsw_decentral import DecentralController, Gains
from fsw_decentral.loops import KW_PER_NM_RPM, share
from fsw_model import STEP_S, ModelParameters, OperatingPointError, ProcessModel, nominal

Vector = NDArray[np.float64]
Response = NDArray[np.complex128]
#: added to depth (mm), temperature (degC) and motor torque (N m) as measured, by tick
Disturbance = Callable[[int], tuple[float, float, float]]
#: Standard deviations of the sensors, in the order of the outputs: mm, degC, N m (plant.yaml).
NOISE = (2e-3, 0.1, 2.0)
#: Ticks of the tracking and of the disturbance run.
_TRACKING, _DISTURBED = 2000, 1600
_UP, _HOT, _DOWN, _COLD = slice(400, 800), slice(800, 1200), slice(1200, 1600), slice(1600, 2000)
_BY_DEPTH, _BY_TEMPERATURE = slice(400, 1000), slice(1000, 1600)
#: rad/s; for peaks, and evenly spaced for variances
_OMEGA = np.geomspace(2e-3, 0.95 * math.pi / STEP_S, 400)
_EVEN = np.linspace(0.0, math.pi / STEP_S, 402)[1:-1]


class Loop:
    """Controller and process model in closed loop, as the plant runs them, from rest at the operating point.

    Parameters
    ----------
    gains : Gains
    parameters : ModelParameters, optional
        The paper's by default.
    latency_ticks : int
        Delay added between command and process.
    """

    def __init__(self, gains: Gains, parameters: ModelParameters | None = None, latency_ticks: int = 0) -> None:
        self.model = process_model(parameters or nominal())
        self.inertia = self.model.parameters.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM / STEP_S
        start = self.model.equilibrium(DEPTH_MM, TEMPERATURE_C)
        self.state = start.state.copy()
        self.controller = DecentralController(asdict(gains))
        self.queue = [Command(start.force_kn, start.speed_rpm)] * (2 + latency_ticks)
        self.controller.reset(self.queue[0])

    def run(
        self,
        ticks: int,
        reference: Callable[[float], Reference],
        disturbance: Disturbance = lambda k: (0.0, 0.0, 0.0),
    ) -> Vector:
        """Rows (ticks, 4) of depth (mm) and temperature (degC) with disturbance, force (kN) and speed (rpm)."""
        rows = np.empty((ticks, 4))
        for k in range(ticks):
            now, (before, acting) = self.queue[-1], self.queue[:2]
            shown = self.model.outputs(self.state, acting.force_kn, acting.speed_rpm)
            depth_more, temperature_more, torque_more = disturbance(k)
            depth, temperature = shown.depth_mm + depth_more, shown.temperature_c + temperature_more
            rows[k] = depth, temperature, now.force_kn, now.speed_rpm
            torque = shown.motor_torque_nm + self.inertia * (acting.speed_rpm - before.speed_rpm) + torque_more
            measurement = Measurement(k * STEP_S, depth, torque, temperature)
            proposal = self.controller.step(measurement, reference(k * STEP_S), now, STEP_S)
            self.queue = [*self.queue[1:], proposal.command]
            self.model.step(self.state, self.queue[1].force_kn, self.queue[1].speed_rpm)
        return rows


@lru_cache(maxsize=8)
def process_model(parameters: ModelParameters) -> ProcessModel:
    """The model of these parameters; it has no state, and takes a tenth of a second to make."""
    return ProcessModel(parameters)


def constant(_: float) -> Reference:
    """Reference at the operating point."""
    return Reference(DEPTH_MM, TEMPERATURE_C)


def steps(time_s: float) -> Reference:
    """Reference steps: +0.2 mm at 40 s, +10 degC at 80 s, -0.2 mm at 120 s, -10 degC at 160 s."""
    depth = DEPTH_MM + (0.2 if 40.0 <= time_s < 120.0 else 0.0)
    return Reference(depth, TEMPERATURE_C + (10.0 if 80.0 <= time_s < 160.0 else 0.0))


def disturbances(k: int) -> tuple[float, float, float]:
    """Output disturbances: +0.1 mm from 40 s, -5 degC from 100 s."""
    return (0.1 if k >= 400 else 0.0, -5.0 if k >= 1000 else 0.0, 0.0)


def loop_response(
    gains: Gains, parameters: ModelParameters, omega: Vector, latency_ticks: int = 1
) -> tuple[Response, Response]:
    """Sensitivity of the outputs (n, 3, 3) and response of force and speed to sensor noise (n, 2, 3).

    Parameters
    ----------
    gains : Gains
    parameters : ModelParameters
    omega : (n,) array
        Frequencies, rad/s.
    latency_ticks : int
        Delay added between command and process.
    """
    model = process_model(parameters)
    at, line, p = model.equilibrium(DEPTH_MM, TEMPERATURE_C), model.linearise(), parameters
    torque, speed = at.outputs.process_torque_nm, at.speed_rpm
    s, back = 1j * omega, np.exp(-1j * omega * STEP_S)
    hold = (1.0 - back) / (s * STEP_S) * back**latency_ticks
    process = line.frequency_response(omega) * hold[:, None, None]

    def lag(time_s: float) -> Response:
        take = share(time_s, STEP_S)
        return np.asarray(take / (1.0 - (1.0 - take) * back))

    def pid(gain: float, integral_s: float, derivative_s: float = 0.0) -> Response:
        move = 1.0 - back
        return np.asarray(gain * (1.0 + STEP_S / integral_s / move + derivative_s / STEP_S * move))

    power = pid(gains.power_gain, gains.power_integral_time)
    by_torque = -speed / torque * lag(gains.feedforward_filter)
    by_torque = by_torque - power * KW_PER_NM_RPM * speed * lag(gains.power_filter)
    inertia = p.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM / STEP_S
    friction = p.friction_linear_nm_per_rpm + 2.0 * p.friction_quadratic_nm_per_rpm2 * speed
    # of the speed, through what the controller takes off the torque; the peak is in the measurement as well, later
    own = inertia * (1.0 - back) * (back ** (1 + latency_ticks) - back) - friction * back
    solved = 1.0 - by_torque * own + power * KW_PER_NM_RPM * torque * back
    by_power = 1.0 / (torque * KW_PER_NM_RPM) + power
    controller = np.zeros((len(omega), 2, 3), dtype=np.complex128)
    depth = pid(gains.depth_gain, gains.depth_integral_time, gains.depth_derivative_time)
    controller[:, 0, 0] = depth * lag(gains.depth_filter) ** 2
    temperature = pid(gains.temperature_gain, gains.temperature_integral_time, gains.temperature_derivative_time)
    controller[:, 1, 1] = by_power * temperature * lag(gains.temperature_filter) ** 2 / solved
    controller[:, 1, 2] = -by_torque / solved
    sensitivity = np.linalg.inv(np.eye(3) + process @ controller)
    return sensitivity, -controller @ sensitivity


def sensitivity(gains: Gains, parameters: ModelParameters | None = None) -> tuple[float, float]:
    """Peak of the sensitivity of the depth loop and of the temperature loop, the other one closed.

    One whole tick of delay is added for transport and drives. Only of a stable loop; see ``simulated_sensitivity``.
    """
    found, _ = loop_response(gains, parameters or nominal(), _OMEGA)
    return float(np.abs(found[:, 0, 0]).max()), float(np.abs(found[:, 1, 1]).max())


def simulated_sensitivity(gains: Gains, parameters: ModelParameters | None = None) -> tuple[float, float]:
    """The same by simulation: the response to an infinitesimal impulse on one sensor; inf if it does not die out."""
    peaks = []
    for channel, size in enumerate((1e-5, 1e-4)):
        pulse = (size, 0.0, 0.0) if channel == 0 else (0.0, size, 0.0)
        try:
            rows = Loop(gains, parameters, latency_ticks=1).run(3010, constant, _once(10, pulse))
        except OperatingPointError:
            return math.inf, math.inf
        response = rows[10:, channel] - (DEPTH_MM, TEMPERATURE_C)[channel]
        settled = np.abs(response[-500:]).max() < 1e-3 * size
        peaks.append(float(np.abs(np.fft.rfft(response / size)).max()) if settled else math.inf)
    return peaks[0], peaks[1]


def _once(tick: int, sizes: tuple[float, float, float]) -> Disturbance:
    return lambda k: sizes if k == tick else (0.0, 0.0, 0.0)


def noise_moves(gains: Gains, parameters: ModelParameters | None = None) -> tuple[float, float]:
    """Standard deviation of the moves per tick of force (kN) and speed (rpm) under sensor noise."""
    _, by_noise = loop_response(gains, parameters or nominal(), _EVEN, latency_ticks=0)
    moves = by_noise * (1.0 - np.exp(-1j * _EVEN * STEP_S))[:, None, None] * np.array(NOISE)
    deviation = np.sqrt((np.abs(moves) ** 2).mean(axis=0).sum(axis=1))
    return float(deviation[0]), float(deviation[1])


def errors(gains: Gains, parameters: ModelParameters | None = None) -> dict[str, float]:
    """Errors of a set of gains in ``steps`` and ``disturbances``, noise-free.

    Returns
    -------
    dict of str to float
        Integrals of the absolute error (iae) of a whole run and of the output that an event is about; peaks of the
        other output; total variation of the inputs; ``unsettled_c``, the largest temperature error in the last 10 s of
        a run, which tells a loop that swings. Units in the names.

    Raises
    ------
    OperatingPointError
        If the shoulder leaves the copper.
    """
    tracked = Loop(gains, parameters).run(_TRACKING, steps)
    wanted = np.array([(r.depth_mm, r.temperature_c) for r in (steps(k * STEP_S) for k in range(_TRACKING))])
    depth, temperature = np.abs(tracked[:, :2] - wanted).T
    disturbed = Loop(gains, parameters).run(_DISTURBED, constant, disturbances)
    depth_off, temperature_off = np.abs(disturbed[:, :2] - (DEPTH_MM, TEMPERATURE_C)).T

    def iae(error: Vector) -> float:
        return float(error.sum() * STEP_S)

    return {
        "tracking_iae_depth_mm_s": iae(depth),
        "tracking_iae_temperature_c_s": iae(temperature),
        "disturbance_iae_depth_mm_s": iae(depth_off),
        "disturbance_iae_temperature_c_s": iae(temperature_off),
        "depth_up_iae_mm_s": iae(depth[_UP]),
        "depth_down_iae_mm_s": iae(depth[_DOWN]),
        "depth_disturbance_iae_mm_s": iae(depth_off[_BY_DEPTH]),
        "temperature_up_iae_c_s": iae(temperature[_HOT]),
        "temperature_down_iae_c_s": iae(temperature[_COLD]),
        "temperature_disturbance_iae_c_s": iae(temperature_off[_BY_TEMPERATURE]),
        "depth_up_peak_c": float(temperature[_UP].max()),
        "depth_down_peak_c": float(temperature[_DOWN].max()),
        "depth_disturbance_peak_c": float(temperature_off[_BY_DEPTH].max()),
        "temperature_steps_peak_mm": float(max(depth[_HOT].max(), depth[_COLD].max())),
        "variation_force_kn": float(np.abs(np.diff(tracked[:, 2])).sum()),
        "variation_speed_rpm": float(np.abs(np.diff(tracked[:, 3])).sum()),
        "unsettled_c": float(max(temperature[-100:].max(), temperature_off[-100:].max())),
    }
