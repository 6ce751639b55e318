"""Ticks of a weld for the monitor.

The model's own process in open loop, with noise, to be spoilt by tests.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import exp, sqrt

import numpy as np

from fsw_control.weld import FORCE_KN, SPEED_RPM
from fsw_model import ModelParameters, ProcessModel
from fsw_quality.monitor import Sample


def inputs(seconds: float, excited: bool) -> tuple[np.ndarray, np.ndarray]:
    """Force and speed of each tick.

    Pulses around the operating point, so that gains and dead time show.
    """
    time_s = 0.1 * np.arange(round(10 * seconds))
    push = np.where(
        time_s % 60.0 < 8.0,
        1.5,
        np.where((time_s % 60.0 >= 30.0) & (time_s % 60.0 < 38.0), -1.5, 0.0),
    )
    turn = np.where(time_s % 80.0 < 40.0, 4.0, -4.0)
    if not excited:
        push, turn = 0.0 * push, 0.0 * turn
    return FORCE_KN + push, SPEED_RPM + turn


def noise(random: np.random.Generator, n: int, correlation_s: float = 0.0) -> np.ndarray:
    """Noise of standard deviation 1, white or correlated over a time."""
    fresh = random.standard_normal(n)
    if not correlation_s:
        return fresh
    kept, correlated = exp(-0.1 / correlation_s), [float(fresh[0])]
    for value in fresh[1:].tolist():
        correlated.append(kept * correlated[-1] + sqrt(1.0 - kept**2) * value)
    return np.array(correlated)


def samples(
    seconds: float = 300.0, excited: bool = True, correlation_s: float = 0.0, **factors: float
) -> list[Sample]:
    """A weld whose model has its parameters multiplied by ``factors``.

    Its noise may be correlated.
    """
    force, speed = inputs(seconds, excited)
    shown = ProcessModel(ModelParameters().scaled(**factors)).simulate(
        force.tolist(), speed.tolist()
    )
    random = np.random.default_rng(1)
    n = force.size
    # row k of the simulation is at the begin of step k, before its inputs act
    acting, turning = np.append([FORCE_KN], force[:-1]), np.append([SPEED_RPM], speed[:-1])
    depth = shown["depth_mm"] + 0.002 * noise(random, n, correlation_s)
    torque = shown["motor_torque_nm"] + 2.0 * noise(random, n, correlation_s)
    temperature = shown["temperature_c"] + 0.1 * noise(random, n, correlation_s)
    columns = (depth, torque, temperature, acting, turning, acting, turning)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return [Sample(0.1 * (k + 1), *row) for k, row in enumerate(rows)]


def drifting(
    weld: list[Sample], name: str, per_s: float, from_s: float = 120.0
) -> Iterator[Sample]:
    """A value that drifts from a time on."""
    for tick in weld:
        yield tick._replace(**{name: getattr(tick, name) + per_s * max(0.0, tick.time_s - from_s)})
