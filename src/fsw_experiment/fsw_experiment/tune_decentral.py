"""Tunes the decentralized controller for a process model.

Minimises the errors in set-point steps and output disturbances under bounds: on the peak Ms of the sensitivity of each
loop with the other one closed, and on the size of the moves that sensor noise causes. Ms and moves come from the
frequency response of the sampled, coupled loop, linearised about the operating point, with one whole tick of delay
added for transport and drives; the errors from simulation of the nonlinear loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from fsw_control import Command, Measurement, Reference
from fsw_control.units import RAD_PER_S_PER_RPM
from fsw_control.weld import DEPTH_MM, TEMPERATURE_C
from fsw_decentral import DecentralController, Gains
from fsw_decentral.loops import KW_PER_NM_RPM, share
from fsw_model import STEP_S, ModelParameters, OperatingPointError, ProcessModel, nominal

Vector = NDArray[np.float64]
#: Standard deviations of the sensors, in the order of the outputs: mm, degC, N m (plant.yaml).
NOISE = (2e-3, 0.1, 2.0)
#: A bound is kept with so much to spare, so that it holds after rounding.
_MARGIN = 0.985
_PENALTY = 50.0
#: Ticks of the tracking and of the disturbance run.
_TRACKING, _DISTURBED = 2000, 1600


@dataclass(frozen=True)
class Bounds:
    """What a set of gains may not exceed, and how much it weighs the disturbance of the other loop."""

    sensitivity: float
    force_move_kn: float
    speed_move_rpm: float
    coupling_weight: float


BOUNDS = {
    "conservative": Bounds(sensitivity=1.6, force_move_kn=0.03, speed_move_rpm=0.5, coupling_weight=0.5),
    "tight": Bounds(sensitivity=2.0, force_move_kn=0.12, speed_move_rpm=0.8, coupling_weight=0.1),
}

#: Searched for, with the largest value where there is one; the rest is fixed or follows by rule.
SEARCHED = {
    "depth_gain": math.inf,
    "depth_integral_time": math.inf,
    "depth_weight": 1.0,
    "depth_reference_filter": math.inf,
    "temperature_gain": math.inf,
    "temperature_integral_time": math.inf,
    "temperature_weight": 1.0,
    "temperature_reference_filter": math.inf,
    "power_gain": 6.0,
    "feedforward_filter": math.inf,
}


def start_of(name: str, parameters: ModelParameters) -> Gains:
    """Where the search starts: internal model control of the loops by themselves."""
    p = parameters
    tight = name == "tight"
    closed_s = (1.0 if tight else 2.0) * p.dead_time_s
    heat = p.thermal_gain_c_per_kw / p.copper_lag_s
    depth_gain = (0.5 if tight else 0.2) / (p.depth_gain_mm_per_kn_s * p.depth_zero_s / p.depth_pole_slow_s)
    return with_rules(
        Gains(
            depth_gain=depth_gain,
            depth_integral_time=4.0,
            depth_derivative_time=0.0,
            depth_filter=0.3 if tight else 0.5,
            depth_weight=0.2 if tight else 1.0,
            depth_reference_filter=0.1 if tight else 5.0,
            depth_tracking_time=1.0,
            temperature_gain=1.0 / (heat * (closed_s + p.dead_time_s + p.tool_lag_s)),
            temperature_integral_time=p.copper_lag_s,
            temperature_filter=0.3 if tight else 0.5,
            temperature_weight=1.0,
            temperature_reference_filter=0.2 if tight else 3.0,
            temperature_tracking_time=1.0,
            power_gain=1.0,
            power_integral_time=2.0,
            power_filter=0.2 if tight else 0.3,
            feedforward_filter=0.3,
        )
    )


def with_rules(gains: Gains) -> Gains:
    """Apply the rules that tie gains to each other."""
    return replace(
        gains,
        depth_tracking_time=gains.depth_integral_time / 4.0,
        temperature_tracking_time=gains.temperature_integral_time / 2.0,
    )


class Loop:
    """Controller and process model in closed loop, as the plant runs them."""

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
        disturbance: Callable[[int], tuple[float, float]] = lambda k: (0.0, 0.0),
    ) -> Vector:
        """Rows (ticks, 4) of depth and temperature shown, force and speed; ``disturbance`` adds to the outputs."""
        rows = np.empty((ticks, 4))
        for k in range(ticks):
            now, (before, acting) = self.queue[-1], self.queue[:2]
            shown = self.model.outputs(self.state, acting.force_kn, acting.speed_rpm)
            depth_more, temperature_more = disturbance(k)
            depth, temperature = shown.depth_mm + depth_more, shown.temperature_c + temperature_more
            rows[k] = depth, temperature, now.force_kn, now.speed_rpm
            torque = shown.motor_torque_nm + self.inertia * (acting.speed_rpm - before.speed_rpm)
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


def disturbances(k: int) -> tuple[float, float]:
    """Output disturbances: +0.1 mm from 40 s, -5 degC from 100 s."""
    return (0.1 if k >= 400 else 0.0, -5.0 if k >= 1000 else 0.0)


def loop_response(
    gains: Gains, parameters: ModelParameters, omega: Vector, latency_ticks: int = 1
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
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

    def lag(time_s: float) -> NDArray[np.complex128]:
        take = share(time_s, STEP_S)
        return take / (1.0 - (1.0 - take) * back)

    def pi(gain: float, time_s: float) -> NDArray[np.complex128]:
        return gain * (1.0 + STEP_S / time_s / (1.0 - back))

    power = pi(gains.power_gain, gains.power_integral_time)
    by_torque = -speed / torque * lag(gains.feedforward_filter)
    by_torque = by_torque - power * KW_PER_NM_RPM * speed * lag(gains.power_filter)
    inertia = p.spindle_inertia_kgm2 * RAD_PER_S_PER_RPM / STEP_S
    friction = p.friction_linear_nm_per_rpm + 2.0 * p.friction_quadratic_nm_per_rpm2 * speed
    # of the speed, through what the controller takes off the torque; the peak is in the measurement as well, later
    own = inertia * (1.0 - back) * (back ** (1 + latency_ticks) - back) - friction * back
    solved = 1.0 - by_torque * own + power * KW_PER_NM_RPM * torque * back
    by_power = 1.0 / (torque * KW_PER_NM_RPM) + power
    controller = np.zeros((len(omega), 2, 3), dtype=np.complex128)
    controller[:, 0, 0] = pi(gains.depth_gain, gains.depth_integral_time) * lag(gains.depth_filter)
    temperature = pi(gains.temperature_gain, gains.temperature_integral_time) * lag(gains.temperature_filter)
    controller[:, 1, 1] = by_power * temperature / solved
    controller[:, 1, 2] = -by_torque / solved
    sensitivity = np.linalg.inv(np.eye(3) + process @ controller)
    return sensitivity, -controller @ sensitivity


_OMEGA = np.geomspace(2e-3, 0.95 * math.pi / STEP_S, 400)
_EVEN = np.linspace(0.0, math.pi / STEP_S, 402)[1:-1]


def sensitivity(gains: Gains, parameters: ModelParameters | None = None) -> tuple[float, float]:
    """Peak of the sensitivity of the depth loop and of the temperature loop, the other one closed."""
    found, _ = loop_response(gains, parameters or nominal(), _OMEGA)
    return float(np.abs(found[:, 0, 0]).max()), float(np.abs(found[:, 1, 1]).max())


def noise_moves(gains: Gains, parameters: ModelParameters | None = None) -> tuple[float, float]:
    """Standard deviation of the moves per tick of force (kN) and speed (rpm) under sensor noise."""
    _, by_noise = loop_response(gains, parameters or nominal(), _EVEN, latency_ticks=0)
    moves = by_noise * (1.0 - np.exp(-1j * _EVEN * STEP_S))[:, None, None] * np.array(NOISE)
    deviation = np.sqrt((np.abs(moves) ** 2).mean(axis=0).sum(axis=1))
    return float(deviation[0]), float(deviation[1])


def errors(gains: Gains, parameters: ModelParameters | None = None) -> dict[str, float]:
    """Errors of a set of gains, noise-free: IAE in mm s and degC s, peaks of the other loop in degC and mm."""
    tracked = Loop(gains, parameters).run(_TRACKING, steps)
    wanted = np.array([(r.depth_mm, r.temperature_c) for r in (steps(k * STEP_S) for k in range(_TRACKING))])
    depth, temperature = np.abs(tracked[:, :2] - wanted).T
    disturbed = Loop(gains, parameters).run(_DISTURBED, constant, disturbances)
    depth_off, temperature_off = np.abs(disturbed[:, :2] - (DEPTH_MM, TEMPERATURE_C)).T
    # what swings on at the end would swing for ever
    swings = temperature_off[-100:].max() > 1.0 or temperature[-100:].max() > 2.0
    return {
        "tracking_iae_depth": float(depth.sum() * STEP_S),
        "tracking_iae_temperature": float(temperature.sum() * STEP_S),
        "disturbance_iae_depth": float(depth_off.sum() * STEP_S),
        "disturbance_iae_temperature": float(temperature_off.sum() * STEP_S),
        "peak_c_depth_up": float(temperature[400:800].max()),
        "peak_c_depth_down": float(temperature[1200:1600].max()),
        "peak_c_depth_disturbance": float(temperature_off[400:1000].max()),
        "peak_mm_temperature_step": float(np.r_[depth[800:1200], depth[1600:]].max()),
        "variation_force": float(np.abs(np.diff(tracked[:, 2])).sum()),
        "variation_speed": float(np.abs(np.diff(tracked[:, 3])).sum()),
        "swings": float(swings),
    }


def cost(gains: Gains, bounds: Bounds, parameters: ModelParameters) -> float:
    """Errors relative to a usual size, and a steep penalty beyond the bounds."""
    peaks, moves = sensitivity(gains, parameters), noise_moves(gains, parameters)
    ratios = (
        *(peak / bounds.sensitivity for peak in peaks),
        moves[0] / bounds.force_move_kn,
        moves[1] / bounds.speed_move_rpm,
    )
    excess = sum(max(ratio - _MARGIN, 0.0) for ratio in ratios)
    try:
        k = errors(gains, parameters)
    except OperatingPointError:
        return 1e3 + _PENALTY * excess
    total = k["tracking_iae_depth"] / 1.5 + k["tracking_iae_temperature"] / 200.0
    total += k["disturbance_iae_depth"] / 0.35 + 1.5 * k["disturbance_iae_temperature"] / 45.0
    coupling = k["peak_c_depth_up"] + k["peak_c_depth_down"] + k["peak_c_depth_disturbance"]
    coupling += 100.0 * k["peak_mm_temperature_step"]
    return total + bounds.coupling_weight * coupling + _PENALTY * (excess + k["swings"])


def tune(
    name: str,
    parameters: ModelParameters | None = None,
    evaluations: int = 1500,
    progress: Callable[[int], None] | None = None,
) -> Gains:
    """Search for a set of gains by Nelder-Mead over the logarithms, restarted twice from what it has found.

    Parameters
    ----------
    name : str
        One of ``BOUNDS``.
    parameters : ModelParameters, optional
        The paper's by default.
    evaluations : int
        Of the cost.
    progress : callable, optional
        Called with the number of evaluations so far.
    """
    p, bounds = parameters or nominal(), BOUNDS[name]
    gains, done = start_of(name, p), 0

    def gains_of(x: Vector) -> Gains:
        values = {key: min(math.exp(v), most) for (key, most), v in zip(SEARCHED.items(), x, strict=True)}
        return with_rules(replace(gains, **values))

    def cost_of(x: Vector) -> float:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done)
        return cost(gains_of(x), bounds, p)

    for size in (0.4, 0.25, 0.15):
        x = np.log([max(getattr(gains, key), 0.02) for key in SEARCHED])
        down = np.array([-1.0 if most < math.inf else 1.0 for most in SEARCHED.values()])
        simplex = np.vstack([x, x + size * np.diag(down)])
        options = {
            "maxfev": evaluations // 3,
            "initial_simplex": simplex,
            "xatol": 0.01,
            "fatol": 1e-3,
            "adaptive": True,
        }
        gains = gains_of(minimize(cost_of, x, method="Nelder-Mead", options=options).x)
    rounded = {f.name: float(f"{getattr(gains, f.name):.3g}") for f in fields(Gains)}
    return replace(gains, **rounded)
