"""Expected deviation of the sensors from the prediction: the covariance along the horizon.

The estimator's covariance is propagated without further measurements while the plan is followed:
by the transition of the last tick and the random walk of every state, plus the noise of the
sensor. It thus contains the uncertainty of the disturbances and how they may wander, but neither
model errors nor disturbances larger than their walks. As in the estimator, the effect of the
torque's deviation on the heat is neglected: 5 % of the temperature's deviation at 15 s.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fsw_control import weld
from fsw_nmpc.library import KERNEL, State, pointer

Vector = NDArray[np.float64]


def output_deviations(controller: Any, time_s: Vector) -> tuple[Vector, Vector]:
    """Standard deviations of future depth [mm] and temperature [degC] samples.

    Parameters
    ----------
    controller : Any
        A ``fsw_nmpc *`` whose estimator has completed a tick.
    time_s : (n,) array
        Times from that tick on.

    Returns
    -------
    depth, temperature : (n,) array
    """
    estimator, tuning = controller.estimator, KERNEL.ffi.addressof(controller.tuning, "estimator")
    covariance = _matrix(estimator.p)
    walks = np.empty(len(State))
    KERNEL.lib.fsw_estimator_walk(tuning, pointer(walks))
    walk = walks * walks
    if not estimator.is_excited:  # the gain is held
        walk[State.DEPTH_GAIN] = 0.0
    ticks = np.rint(time_s / weld.TICK_S).astype(int)
    rows = _rows_ahead(_rows(controller), _matrix(estimator.a), ticks[-1])
    known = ((rows[ticks] @ covariance) * rows[ticks]).sum(axis=2)
    walked = np.cumsum(rows**2 @ walk, axis=0)[ticks - 1]
    depth, temperature = (
        known + walked + [tuning.depth_noise_mm**2, tuning.temperature_noise_c**2]
    ).T
    return np.sqrt(np.maximum(depth, 0.0)), np.sqrt(np.maximum(temperature, 0.0))


def _matrix(values: Any) -> Vector:
    return np.frombuffer(KERNEL.ffi.buffer(values)).reshape(len(State), len(State))


def _rows(controller: Any) -> Vector:
    """Measurement rows of depth and temperature by the present states, shape (2, n_states)."""
    model, estimator = (KERNEL.ffi.addressof(controller, name) for name in ("model", "estimator"))
    rows = np.zeros((2, len(State)))
    depth, temperature = rows
    KERNEL.lib.fsw_contact_depth(estimator, model, pointer(depth))
    depth[State.DEPTH_OFFSET] = temperature[State.TOOL] = temperature[State.TEMP_OFFSET] = 1.0
    return rows


def _rows_ahead(rows: Vector, transition: Vector, last: int) -> Vector:
    """Rows of the outputs 0 to ``last`` ticks ahead by the states, (last + 1, 2, n_states)."""
    ahead, power = rows[np.newaxis], transition
    while len(ahead) <= last:  # each product doubles the number
        ahead, power = np.concatenate([ahead, ahead @ power]), power @ power
    return ahead[: last + 1]
