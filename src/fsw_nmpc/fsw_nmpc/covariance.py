"""The estimator's covariance: deviations along the horizon, and a start in mid-weld."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fsw_control import weld
from fsw_nmpc.library import KERNEL, Library, State, pointer

Vector = NDArray[np.float64]


def output_deviations(controller: Any, time_s: Vector) -> tuple[Vector, Vector]:
    """Standard deviations of future depth [mm] and temperature [degC] samples.

    The estimator's covariance is propagated without further measurements while the plan is
    followed: by the transition of the last tick and the random walk of every state, plus the
    noise of the sensor. It thus contains the uncertainty of the disturbances and how they may
    wander, but neither model errors nor disturbances larger than their walks. As in the
    estimator, the effect of the torque's deviation on the heat is neglected: 5 % of the
    temperature's deviation at 15 s.

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


#: standard deviations that leave heat and copper open (chosen)
_HEAT_KW, _COPPER_C = 3.0, 2.0
#: times the deviation at rest at which the heat counts as known (chosen)
_NEARLY = 2.0
#: longest time from a known power to a known heat; usually it takes two seconds (chosen)
_LONGEST_S = 10.0


class Rejoining:
    """Follows an estimator from its start in mid-weld until its heat is known.

    At its start the estimator takes the process for settled: the power of the last dead time is
    that of the first sample, and the heat is what keeps the temperature. In mid-weld a power on
    its way to warm the copper would be booked as heat of the other sign for half a minute. So
    heat and copper are left open, again once the power of a whole dead time has been seen, as
    before that the heat has to explain what this power does; and nothing is proposed until the
    heat is nearly as well known as at rest.

    Parameters
    ----------
    dead_time_s : float
        Of the power.
    at_rest : sequence of float
        Standard deviations, by state, with which the estimator starts at rest.
    """

    def __init__(self, dead_time_s: float, at_rest: Any) -> None:
        self._dead_time_s = dead_time_s
        self._at_rest = {state: at_rest[int(state)] for state in State}
        self._estimated: tuple[Any, ...] = ()
        self._seen_s: float | None = None

    def follow(self, library: Library, dt_s: float) -> bool:
        """Take the state after a step; returns whether the heat is known."""
        estimator = library.state.estimator
        if not estimator.started:
            self._seen_s = None
            return False
        if self._seen_s is None:
            self._estimated = tuple(k for k in State if estimator.p[int(k)][int(k)] > 0.0)
            self._open(estimator, {State.HEAT: _HEAT_KW, State.COPPER: _COPPER_C})
            self._seen_s = 0.0
            return False
        before_s, self._seen_s = self._seen_s, self._seen_s + dt_s
        if before_s < self._dead_time_s <= self._seen_s:
            copper_c = self._at_rest[State.COPPER]
            self._open(estimator, {State.HEAT: _HEAT_KW, State.COPPER: copper_c})
        return self._seen_s >= self._dead_time_s and (
            estimator.p[int(State.HEAT)][int(State.HEAT)]
            <= (_NEARLY * self._at_rest[State.HEAT]) ** 2
            or self._seen_s > self._dead_time_s + _LONGEST_S
        )

    def _open(self, estimator: Any, deviations: Mapping[Any, float]) -> None:
        """Give states new variances without covariances, where they are estimated."""
        for state, deviation in deviations.items():
            if state in self._estimated:
                for other in range(len(State)):
                    estimator.p[int(state)][other] = estimator.p[other][int(state)] = 0.0
                estimator.p[int(state)][int(state)] = deviation**2
