"""The clairvoyant optimum: what even a controller that knows all can hardly beat.

A nonlinear program on the process model itself (the same step, dead time and limits as the plant),
in which every move of force and speed is free from the tick of an event on. Minimising the error
of one output alone gives the best that is found for that figure; minimising weighted sums gives
the front of both. The program is not convex and the solver is a local one, so none of these is a
certified bound; further starts of the search show how far they differ.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from fsw.console import ProgressBar
from fsw_control import Limits, Reference
from fsw_model import STEP_S, ProcessModel
from fsw_model.equations import N_POWER, N_STATES, depth_mm
from fsw_tuning.standard_cases import DISTURBANCES, EVENTS, REST, SET_POINTS, set_points

Vector = NDArray[np.float64]
#: inputs, states, power, errors above and below, per tick
_WIDTH = 2 + N_STATES + N_POWER + 4
#: usual sizes of the states, which the solver works in
_SIZES = np.array([0.1, 0.1, 1e-4, 10.0, 10.0, 100.0])
#: of random inputs that a search starts with
_HELD_TICKS = 40
#: only makes the optimum unique
_REGULARISATION = 1e-6
#: Weights of 1 mm in °C for the front between both outputs, and for their joint optimum, which is
#: one of them.
_FRONT, _JOINT = (1e4, 1e3, 300.0, 100.0, 30.0, 10.0, 1.0), 100.0
#: further searches for the optimum of one output, from random inputs
_STARTS = 8


@dataclass(frozen=True, slots=True)
class Optimum:
    """An optimal course.

    Arrays (n,) have an entry per tick, beginning with the tick of the event.
    """

    depth_error_mm: Vector
    temperature_error_c: Vector
    force_kn: Vector
    speed_rpm: Vector
    solved: bool

    @property
    def iae(self) -> tuple[float, float]:
        """Integrals of the absolute errors: mm s and degC s."""
        return float(np.abs(self.depth_error_mm).sum() * STEP_S), float(
            np.abs(self.temperature_error_c).sum() * STEP_S
        )


_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "ipopt": {
        "print_level": 0,
        "sb": "yes",
        "max_iter": 500,
        "tol": 1e-7,
        "mu_strategy": "adaptive",
    },
}


class Clairvoyant:
    """Computes optima of events from rest, on the paper's process.

    What comes after ``window_s`` does not count.
    """

    def __init__(self, window_s: float = 40.0) -> None:
        self.model = ProcessModel()
        self._ticks = round(window_s / STEP_S)
        self._program, self._bounds = self._build()

    def best(
        self,
        rest: Reference,
        goal: Reference,
        per_mm: float,
        per_c: float,
        generator: np.random.Generator | None = None,
    ) -> Optimum:
        """Minimise ``per_mm`` times the depth's IAE plus ``per_c`` times the temperature's.

        The process rests at ``rest`` and has to go to ``goal``; with a disturbance of an output,
        less the disturbance. With a ``generator`` the search starts with random force and speed
        within their limits, else with those at rest.
        """
        n, p = self._ticks, self.model.parameters
        start = self.model.equilibrium(rest.depth_mm, rest.temperature_c)
        aim = (goal.depth_mm, goal.temperature_c - p.operating_temperature_c)
        held = (start.force_kn, start.speed_rpm)
        guess = np.zeros((n, _WIDTH))
        guess[:, :2] = held
        guess[:, 2 : 2 + N_STATES] = np.array(start.state.x) / _SIZES
        guess[:, -4:] = 0.01
        if generator is not None:
            guess[:, :2] = self._random_inputs(generator)
        given = np.array([*aim, per_mm, per_c, *held, *start.state.x, *start.state.power[0]])
        solution = self._program(x0=guess.ravel(), p=given, **self._bounds)
        rows = np.array(solution["x"]).reshape(n, _WIDTH)
        states = np.vstack([start.state.x, rows[:, 2 : 2 + N_STATES] * _SIZES])
        depth = np.array([float(depth_mm(p, x[0], x[1], x[2], x[4])) for x in states])
        return Optimum(
            (depth - aim[0])[:n],
            (states[:, 4] - aim[1])[:n],
            rows[:, 0],
            rows[:, 1],
            bool(self._program.stats()["success"]),
        )

    def _random_inputs(self, generator: np.random.Generator) -> Vector:
        """Force and speed, shape (n, 2), constant over some seconds each."""
        lim = Limits()
        low, high = (lim.force_min_kn, lim.speed_min_rpm), (lim.force_max_kn, lim.speed_max_rpm)
        drawn = generator.uniform(low, high, size=(-(-self._ticks // _HELD_TICKS), 2))
        return np.repeat(drawn, _HELD_TICKS, axis=0)[: self._ticks]

    def _build(self) -> tuple[ca.Function, dict[str, Vector]]:
        model, lim, n = self.model, Limits(), self._ticks
        p, delay = model.parameters, model.delay_steps
        given = ca.SX.sym("given", 6 + N_STATES + N_POWER)
        aim, weights, held, rest, rest_power = ca.vertsplit(
            given, np.cumsum([0, 2, 2, 2, N_STATES, N_POWER]).tolist()
        )
        v = ca.SX.sym("v", _WIDTH, n)
        inputs, scaled, power, above, below = ca.vertsplit(
            v, np.cumsum([0, 2, N_STATES, N_POWER, 2, 2]).tolist()
        )
        sizes, largest = ca.DM(_SIZES), ca.DM([lim.force_step_kn, lim.speed_step_rpm])
        states = scaled * ca.repmat(sizes, 1, n)
        before = ca.horzcat(rest, states[:, :-1])
        arriving = ca.horzcat(ca.repmat(rest_power, 1, delay), power)
        newer = arriving[:, 1 : n + 1] if delay > 1 else arriving[:, :n]
        ahead = model.step_function.map(n)(
            before, arriving[:, :n], newer, inputs[0, :], inputs[1, :]
        )
        moves = inputs - ca.horzcat(held, inputs[:, :-1])
        # the errors at the ticks after the first, which nothing can change
        depth = ca.horzcat(
            *(
                depth_mm(p, states[0, k], states[1, k], states[2, k], states[4, k])
                for k in range(n)
            )
        )
        error = ca.vertcat(depth - aim[0], states[4, :] - aim[1])
        size = above + below
        rows = ca.vertcat(
            scaled - ahead[0] / ca.repmat(sizes, 1, n),
            power - ahead[1],
            error - above + below,
            moves,
        )
        cost = STEP_S * ca.sum2(weights.T @ size) + _REGULARISATION * ca.sumsqr(
            moves / ca.repmat(largest, 1, n)
        )
        high = np.zeros((n, rows.shape[0]))
        high[:, -2:] = lim.force_step_kn, lim.speed_step_rpm
        low_x, high_x = np.full((n, _WIDTH), -np.inf), np.full((n, _WIDTH), np.inf)
        low_x[:, :2] = lim.force_min_kn, lim.speed_min_rpm
        high_x[:, :2] = lim.force_max_kn, lim.speed_max_rpm
        low_x[:, -4:] = 0.0
        program = {"x": ca.vec(v), "p": given, "f": cost, "g": ca.vec(rows)}
        bounds = {
            "lbx": low_x.ravel(),
            "ubx": high_x.ravel(),
            "lbg": -high.ravel(),
            "ubg": high.ravel(),
        }
        return ca.nlpsol("clairvoyant", "ipopt", program, _OPTIONS), bounds


def courses() -> dict[str, tuple[Reference, Reference]]:
    """For each standard event, where the process rests before, and where it has to go."""
    moves = dict(zip(SET_POINTS, pairwise(set_points()), strict=True))
    for name, step in DISTURBANCES.items():
        against = step._replace(depth_mm=-step.depth_mm, temperature_c=-step.temperature_c)
        moves[name] = (REST, against.after(REST))
    return moves


def bounds() -> dict[str, Any]:
    """The clairvoyant optimum of each event.

    Of one output alone, of both, and the front between them.

    Of one output alone from several starts: the best, from how many it was solved, and how far
    they differ.
    """
    clairvoyant, data = Clairvoyant(), {}
    with ProgressBar("clairvoyant optima", len(EVENTS)) as bar:
        for name, (rest, goal) in courses().items():
            of_depth = EVENTS[name].of_depth
            weights, of = ((1e4, 1e-3), 0) if of_depth else ((1e-3, 1.0), 1)
            generator = np.random.default_rng(1)
            starts = [
                clairvoyant.best(rest, goal, *weights, inputs)
                for inputs in (None, *[generator] * _STARTS)
            ]
            errors = [optimum.iae[of] for optimum in starts if optimum.solved]
            front = {weight: clairvoyant.best(rest, goal, weight, 1.0) for weight in _FRONT}
            data[name] = {
                "alone": min(errors),
                "starts": len(errors),
                "spread": max(errors) / min(errors) - 1.0,
                "joint": front[_JOINT].iae,
                "front": [optimum.iae for optimum in front.values()],
                "solved": starts[0].solved and all(optimum.solved for optimum in front.values()),
            }
            bar(len(data))
    return data
