"""The decentralized controller in closed loop with a process model.

Robustness, noise and errors of a set of gains.

Sensitivity and noise come from the frequency response of the sampled, coupled loop, linearised
about the operating point; the errors from simulation of the nonlinear loop. The plant's
drives have no lag and no rate limit, and its sensors no noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from fsw_control import Command, Measurement, Reference
from fsw_control.sensors import SENSORS
from fsw_control.units import KW_PER_NM_RPM, RAD_PER_S_PER_RPM
from fsw_decentral import DecentralController, Gains
from fsw_model import (
    STEP_S,
    ModelParameters,
    OutsideModelError,
    nominal,
)
from fsw_plant.library import KERNEL, model_of
from fsw_plant.process import process_model
from fsw_scenario.scenario import tick_of
from fsw_tuning.standard_cases import CASES, DISTURBANCES, DURATION_S, REST, SET_POINTS, set_points

Vector = NDArray[np.float64]
Response = NDArray[np.complex128]
#: Standard deviations of the sensors, in the order of the outputs: mm, degC, N m.
NOISE = tuple(SENSORS[name].noise for name in ("depth", "thermocouple", "torque"))
#: rad/s; for peaks, and evenly spaced for variances
_OMEGA = np.geomspace(2e-3, 0.95 * math.pi / STEP_S, 400)
_EVEN = np.linspace(0.0, math.pi / STEP_S, 402)[1:-1]


def simulate(
    gains: Gains,
    disturbance: Vector,
    references: Mapping[int, Reference] | None = None,
    parameters: ModelParameters | None = None,
    latency_ticks: int = 0,
) -> Vector:
    """Run controller and plant from rest at the operating point.

    Parameters
    ----------
    gains : Gains
    disturbance : (n, 3) array
        Added to depth (mm), temperature (degC) and motor torque (N m) as measured.
    references : mapping of int to Reference, optional
        Set-points from a tick on; the operating point by default.
    parameters : ModelParameters, optional
        The paper's by default.
    latency_ticks : int
        Delay added between command and process.

    Returns
    -------
    (n, 4) array
        Depth (mm) and temperature (degC) with the disturbance, force (kN) and speed (rpm) before
        the tick's command.

    Raises
    ------
    OperatingPointError
        If the shoulder leaves the copper.
    """
    lib, plant, model = KERNEL.lib, KERNEL.new("fsw_plant"), model_of(parameters or nominal())
    for drive in plant.drive:
        lib.fsw_plant_drive_configure(KERNEL.ffi.addressof(drive), math.inf, 0.0, latency_ticks)
    lib.fsw_plant_start(plant, model, REST.depth_mm, REST.temperature_c)
    plant.nominal_rpm = plant.acting[1]
    added, still = KERNEL.new("fsw_plant_disturbance"), KERNEL.new("fsw_plant_disturbance")
    shown = KERNEL.ffi.new("double[3]")
    controller = DecentralController(dict(gains))
    reference = REST
    changes = references or {}
    now = Command(*plant.acting)
    controller.reset(now)
    rows = []
    for k, (depth_more, temperature_more, torque_more) in enumerate(disturbance.tolist()):
        reference = changes.get(k, reference)
        added.depth_mm, added.temperature_c = depth_more, temperature_more
        lib.fsw_plant_show(plant, added, shown)
        depth, torque, temperature = shown
        rows.append((depth, temperature, now.force_kn, now.speed_rpm))
        measurement = Measurement(k * STEP_S, depth, torque + torque_more, temperature)
        now = controller.step(measurement, reference, now, STEP_S).command
        if lib.fsw_plant_step(plant, model, (now.force_kn, now.speed_rpm), still):
            raise OutsideModelError(*plant.left)
    return np.array(rows)


def loop_response(
    gains: Gains, parameters: ModelParameters, omega: Vector, latency_ticks: int = 1
) -> tuple[Response, Response]:
    """Sensitivity of outputs (n, 3, 3) and response of force, speed to sensor noise (n, 2, 3).

    At the frequencies ``omega`` (n,), rad/s; ``latency_ticks`` of delay are added between command
    and process.
    """
    # Linear loop about the operating point, in z at z^-1 = exp(-j omega h): the process is
    # continuous behind a zero-order hold, the controller discrete. Force and speed are coupled by
    # the torque, hence matrices and not two loops: S = (I + P C)^-1.
    model, p = process_model(parameters), parameters
    at, line = model.equilibrium(REST.depth_mm, REST.temperature_c), model.linearise()
    torque, speed = at.outputs.process_torque_nm, at.speed_rpm
    s, back = 1j * omega, np.exp(-1j * omega * STEP_S)
    # a command is held for a tick: (1 - z^-1) / (s h), behind the delay (Astrom and Wittenmark,
    # Computer-Controlled Systems, 1997, chapter 3)
    hold = (1.0 - back) / (s * STEP_S) * back**latency_ticks
    process = line.frequency_response(omega) * hold[:, None, None]

    def lag(time_s: float) -> Response:
        take = 1.0 - math.exp(-STEP_S / time_s) if time_s > 0.0 else 1.0
        return np.asarray(take / (1.0 - (1.0 - take) * back))

    def pid(gain: float, integral_s: float, derivative_s: float = 0.0) -> Response:
        move = 1.0 - back
        return np.asarray(gain * (1.0 + STEP_S / integral_s / move + derivative_s / STEP_S * move))

    # Inner loop, power = speed x torque: the speed follows the commanded power by its feedforward
    # and by a PI on the measured power, and so answers a change of the torque.
    power = pid(gains.power_gain, gains.power_integral_time)
    by_torque = -speed / torque * lag(gains.feedforward_filter)
    by_torque = by_torque - power * KW_PER_NM_RPM * speed * lag(gains.power_filter)
    inertia = p.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM / STEP_S
    friction = p.friction_linear_nm_per_rpm + 2.0 * p.friction_quadratic_nm_per_rpm2 * speed
    by_power = 1.0 / (torque * KW_PER_NM_RPM) + power
    temperature = pid(
        gains.temperature_gain, gains.temperature_integral_time, gains.temperature_derivative_time
    )
    temperature = temperature * lag(gains.temperature_filter) ** 2
    # what the predictor makes of the measured power: of its torque, and of its speed below
    predicted = by_power * temperature * _prediction(gains, back, lag) * KW_PER_NM_RPM
    by_torque = by_torque - predicted * speed
    # effect of the speed by the inertia and friction that the controller subtracts from the
    # torque; the measurement has the inertia peak, too, but later
    own = inertia * (1.0 - back) * (back ** (1 + latency_ticks) - back) - friction * back
    solved = 1.0 - by_torque * own + (power * KW_PER_NM_RPM + predicted) * torque * back
    # rows: force, speed; columns: depth, temperature, torque. The depth reaches the speed by the
    # decoupling alone, which takes back what the force does to the power.
    controller = np.zeros((len(omega), 2, 3), dtype=np.complex128)
    depth = pid(gains.depth_gain, gains.depth_integral_time, gains.depth_derivative_time)
    controller[:, 0, 0] = depth * lag(gains.depth_filter) ** 2
    ahead = lag(gains.decoupling_lag) * (1.0 - lag(gains.feedforward_filter) * back)
    controller[:, 1, 0] = (
        -speed / torque * gains.decoupling_torque * ahead * controller[:, 0, 0] / solved
    )
    controller[:, 1, 1] = by_power * temperature / solved
    controller[:, 1, 2] = -by_torque / solved
    sensitivity = np.linalg.inv(np.eye(3) + process @ controller)
    return sensitivity, -controller @ sensitivity


def _prediction(gains: Gains, back: Response, lag: Callable[[float], Response]) -> Response:
    """Response of the Smith predictor's correction (degC) to the measured power (kW)."""
    if not gains.predictor_dead_time * gains.predictor_gain:
        return np.zeros_like(back)
    # What the model says without its dead time, less the same with it (Smith, 1957). The power is
    # taken as linear between ticks, hence (1 + z^-1) / 2; so is the part of a tick of the dead
    # time.
    whole, part = divmod(gains.predictor_dead_time / STEP_S, 1.0)
    model = lag(gains.predictor_copper_lag) * 0.5 * (1.0 + back) * lag(gains.predictor_tool_lag)
    return np.asarray(
        gains.predictor_gain * model * (1.0 - back**whole * (1.0 - part * (1.0 - back)))
    )


def sensitivity(gains: Gains, parameters: ModelParameters | None = None) -> tuple[float, float]:
    """Peak of the sensitivity of the depth loop and of the temperature loop, the other one closed.

    One whole tick of delay is added for transport and drives. Only of a stable loop.
    """
    by_frequency, _ = loop_response(gains, parameters or nominal(), _OMEGA)
    return float(np.abs(by_frequency[:, 0, 0]).max()), float(np.abs(by_frequency[:, 1, 1]).max())


def noise_moves(gains: Gains, parameters: ModelParameters | None = None) -> tuple[float, float]:
    """Standard deviation of moves per tick of force (kN) and speed (rpm) under sensor noise."""
    # White noise has equal power at all frequencies: the variance of the moves is the mean of the
    # squared response over the unit circle (Parseval).
    _, by_noise = loop_response(gains, parameters or nominal(), _EVEN, latency_ticks=0)
    moves = by_noise * (1.0 - np.exp(-1j * _EVEN * STEP_S))[:, None, None] * np.array(NOISE)
    deviation = np.sqrt((np.abs(moves) ** 2).mean(axis=0).sum(axis=1))
    return float(deviation[0]), float(deviation[1])


def _windows(case: str) -> dict[str, slice]:
    """Ticks of each event of a case, until the next one begins."""
    events = CASES[case]
    ticks = [
        tick_of(at_s) for at_s in (*(step.at_s for step in events.values()), DURATION_S[case])
    ]
    return dict(zip(events, map(slice, ticks, ticks[1:]), strict=True))


def errors(gains: Gains, parameters: ModelParameters | None = None) -> dict[str, float]:
    """Errors of a set of gains in the standard events, noise-free; units in the names.

    Integrals of the absolute error (iae) of a whole run and of the output that an event is about;
    peaks of the temperature in steps of the depth; ``unsettled_c``, the largest temperature error
    in the last 10 s of a run, which reveals an oscillating loop.

    Raises
    ------
    OperatingPointError
        If the shoulder leaves the copper.
    """
    references = dict(
        zip([0, *(tick_of(step.at_s) for step in SET_POINTS.values())], set_points(), strict=True)
    )
    target = np.empty((tick_of(DURATION_S["tracking"]), 2))
    for tick, reference in references.items():
        target[tick:] = reference.depth_mm, reference.temperature_c
    tracked = simulate(gains, np.zeros((len(target), 3)), references, parameters)
    depth, temperature = np.abs(tracked[:, :2] - target).T
    disturbance = np.zeros((tick_of(DURATION_S["disturbances"]), 3))
    for step in DISTURBANCES.values():
        disturbance[tick_of(step.at_s) :] += step.depth_mm, step.temperature_c, 0.0
    disturbed = simulate(gains, disturbance, None, parameters)
    depth_off, temperature_off = np.abs(disturbed[:, :2] - (REST.depth_mm, REST.temperature_c)).T
    steps, offs = _windows("tracking"), _windows("disturbances")

    def iae(error: Vector) -> float:
        return float(error.sum() * STEP_S)

    return {
        "tracking_iae_depth_mm_s": iae(depth),
        "tracking_iae_temperature_c_s": iae(temperature),
        "disturbance_iae_depth_mm_s": iae(depth_off),
        "disturbance_iae_temperature_c_s": iae(temperature_off),
        "depth_up_iae_mm_s": iae(depth[steps["z up"]]),
        "depth_down_iae_mm_s": iae(depth[steps["z down"]]),
        "depth_disturbance_iae_mm_s": iae(depth_off[offs["dz"]]),
        "temperature_up_iae_c_s": iae(temperature[steps["T up"]]),
        "temperature_down_iae_c_s": iae(temperature[steps["T down"]]),
        "temperature_disturbance_iae_c_s": iae(temperature_off[offs["dT"]]),
        "depth_up_peak_c": float(temperature[steps["z up"]].max()),
        "depth_down_peak_c": float(temperature[steps["z down"]].max()),
        "depth_disturbance_peak_c": float(temperature_off[offs["dz"]].max()),
        "unsettled_c": float(max(temperature[-100:].max(), temperature_off[-100:].max())),
    }
