"""The clairvoyant optimum: what no controller can beat.

One nonlinear program per event, on the process model itself (the same step, dead time and limits as the plant), with
every move of force and speed free from the tick of the event on, and its whole course known. Minimising the error of
one output alone gives a true lower bound of that figure; minimising weighted sums gives the Pareto front of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from fsw_control import Limits
from fsw_control.weld import DEPTH_MM, TEMPERATURE_C
from fsw_model import STEP_S, ModelParameters, ProcessModel, nominal
from fsw_model.equations import N_POWER, N_STATES, depth_mm

Vector = NDArray[np.float64]
#: inputs, states, power, errors above and below, per tick
_WIDTH = 2 + N_STATES + N_POWER + 4
#: usual sizes of the states, which the solver works in
_SIZES = np.array([0.1, 0.1, 1e-4, 10.0, 10.0, 100.0])
#: only makes the optimum unique
_REGULARISATION = 1e-6
#: stands for a bound that is none, degC
_NO_BOUND = 1e6


@dataclass(frozen=True, slots=True)
class Event:
    """A step of a set-point, or of a disturbance of an output, at rest.

    Attributes
    ----------
    name : str
    depth_mm, temperature_c : float
        Step of the set-point.
    shown_mm, shown_c : float
        Step of the disturbance of what is shown.
    at_mm, at_c : float
        Where the process rests before.
    """

    name: str
    depth_mm: float = 0.0
    temperature_c: float = 0.0
    shown_mm: float = 0.0
    shown_c: float = 0.0
    at_mm: float = DEPTH_MM
    at_c: float = TEMPERATURE_C


#: The events of the paper's Figs. 6 to 9 in the sizes chosen here, one set-point after the other.
EVENTS = (
    Event("z up", depth_mm=0.2),
    Event("T up", temperature_c=10.0, at_mm=DEPTH_MM + 0.2),
    Event("z down", depth_mm=-0.2, at_mm=DEPTH_MM + 0.2, at_c=TEMPERATURE_C + 10.0),
    Event("T down", temperature_c=-10.0, at_c=TEMPERATURE_C + 10.0),
    Event("dz", shown_mm=0.1),
    Event("dT", shown_c=-5.0),
)


@dataclass(frozen=True, slots=True)
class Optimum:
    """An optimal course; arrays have an entry per tick, beginning with the tick of the event.

    Attributes
    ----------
    depth_error_mm, temperature_error_c, force_kn, speed_rpm : (n,) arrays
    solved : bool
    """

    depth_error_mm: Vector
    temperature_error_c: Vector
    force_kn: Vector
    speed_rpm: Vector
    solved: bool

    @property
    def iae(self) -> tuple[float, float]:
        """Integrals of the absolute errors: mm s and degC s."""
        return float(np.abs(self.depth_error_mm).sum() * STEP_S), float(np.abs(self.temperature_error_c).sum() * STEP_S)


class Clairvoyant:
    """Computes optima of events from rest.

    Parameters
    ----------
    parameters : ModelParameters, optional
    limits : Limits, optional
    window_s : float
        How far a program looks; the error after it does not count.
    """

    def __init__(
        self, parameters: ModelParameters | None = None, limits: Limits | None = None, window_s: float = 40.0
    ) -> None:
        self.model, self.limits = ProcessModel(parameters or nominal()), limits or Limits()
        self._ticks = round(window_s / STEP_S)
        self._program, self._bounds = self._build()

    def best(self, event: Event, per_mm: float, per_c: float, largest_temperature_error_c: float = np.inf) -> Optimum:
        """Minimise ``per_mm`` times the depth's IAE plus ``per_c`` times the temperature's.

        Parameters
        ----------
        event : Event
        per_mm, per_c : float
        largest_temperature_error_c : float
            Bound on the temperature's error; for events in which the temperature's set-point stays.
        """
        n, p = self._ticks, self.model.parameters
        start = self.model.equilibrium(event.at_mm, event.at_c)
        rise_c = event.at_c - p.operating_temperature_c
        goal = (event.at_mm + event.depth_mm - event.shown_mm, rise_c + event.temperature_c - event.shown_c)
        bound_c = min(largest_temperature_error_c, _NO_BOUND)
        guess = np.zeros((n, _WIDTH))
        guess[:, 0], guess[:, 1] = start.force_kn, start.speed_rpm
        guess[:, 2 : 2 + N_STATES] = np.array(start.state.x) / _SIZES
        guess[:, -4:] = 0.01
        held = (start.force_kn, start.speed_rpm)
        given = np.array([*goal, per_mm, per_c, bound_c, *held, *start.state.x, *start.state.power[0]])
        found = self._program(x0=guess.ravel(), p=given, **self._bounds)
        rows = np.array(found["x"]).reshape(n, _WIDTH)
        states = np.vstack([start.state.x, rows[:, 2 : 2 + N_STATES] * _SIZES])
        depth = np.array([float(depth_mm(p, x[0], x[1], x[2], x[4])) for x in states])
        return Optimum(
            (depth - goal[0])[:n],
            (states[:, 4] - goal[1])[:n],
            rows[:, 0],
            rows[:, 1],
            bool(self._program.stats()["success"]),
        )

    def front(
        self, event: Event, weights: Sequence[float] = (1e4, 1e3, 300.0, 100.0, 30.0, 10.0, 1.0)
    ) -> list[Optimum]:
        """Pareto front of depth and temperature: optima for weights of 1 mm in degC."""
        return [self.best(event, weight, 1.0) for weight in weights]

    def _build(self) -> tuple[ca.Function, dict[str, Vector]]:
        model, lim, n = self.model, self.limits, self._ticks
        p, delay = model.parameters, model.delay_steps
        given = ca.SX.sym("given", 7 + N_STATES + N_POWER)
        goal, weights, bound, held = given[:2], given[2:4], given[4], given[5:7]
        rest, rest_power = given[7 : 7 + N_STATES], given[7 + N_STATES :]
        v = ca.SX.sym("v", _WIDTH, n)
        inputs, scaled, power, above, below = ca.vertsplit(v, np.cumsum([0, 2, N_STATES, N_POWER, 2, 2]).tolist())
        sizes, largest = ca.DM(_SIZES), ca.DM([lim.force_step_kn, lim.speed_step_rpm])
        states = scaled * ca.repmat(sizes, 1, n)
        before = ca.horzcat(rest, states[:, :-1])
        arriving = ca.horzcat(ca.repmat(rest_power, 1, delay), power)
        newer = arriving[:, 1 : n + 1] if delay > 1 else arriving[:, :n]
        ahead = model.step_function.map(n)(before, arriving[:, :n], newer, inputs[0, :], inputs[1, :])
        moves = inputs - ca.horzcat(held, inputs[:, :-1])
        # the errors at the ticks after the first, which nothing can change
        depth = ca.horzcat(*(depth_mm(p, states[0, k], states[1, k], states[2, k], states[4, k]) for k in range(n)))
        error = ca.vertcat(depth - goal[0], states[4, :] - goal[1])
        size = above + below
        rows = ca.vertcat(
            scaled - ahead[0] / ca.repmat(sizes, 1, n),
            power - ahead[1],
            error - above + below,
            moves,
            size[1, :] - bound,
        )
        cost = STEP_S * ca.sum2(weights.T @ size) + _REGULARISATION * ca.sumsqr(moves / ca.repmat(largest, 1, n))
        low, high = np.zeros((n, rows.shape[0])), np.zeros((n, rows.shape[0]))
        high[:, -3:-1] = lim.force_step_kn, lim.speed_step_rpm
        low[:, -3:-1], low[:, -1] = -high[:, -3:-1], -np.inf
        low_x, high_x = np.full((n, _WIDTH), -np.inf), np.full((n, _WIDTH), np.inf)
        low_x[:, :2] = lim.force_min_kn, lim.speed_min_rpm
        high_x[:, :2] = lim.force_max_kn, lim.speed_max_rpm
        low_x[:, -4:] = 0.0
        options: dict[str, Any] = {
            "print_time": False,
            "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 500, "tol": 1e-7, "mu_strategy": "adaptive"},
        }
        program = {"x": ca.vec(v), "p": given, "f": cost, "g": ca.vec(rows)}
        bounds = {"lbx": low_x.ravel(), "ubx": high_x.ravel(), "lbg": low.ravel(), "ubg": high.ravel()}
        return ca.nlpsol("clairvoyant", "ipopt", program, options), bounds
