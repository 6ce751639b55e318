"""The physical limit: what no controller can beat, by an offline optimisation with full knowledge.

One nonlinear program per event, on the process model itself (the same step function, dead time and limits as the
plant), every move free, with the joint cost ``weight * |depth error| + |temperature error|`` and next to no move
penalty. An event is known from the moment it begins, with its whole further course (a ramp, a sine); with ``preview_s``
it is known so much earlier. The next event takes over from the state that the last one has left.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from fsw_control import Limits
from fsw_model import STEP_S, ModelParameters, ProcessModel
from fsw_model.equations import N_STATES, step_function

Vector = NDArray[np.float64]
#: per tick: two inputs, five states, three power nodes, four error parts and the excess over the bound
_WIDTH = 15
#: only makes the optimum unique
_REGULARISATION = 1e-5


@dataclass(frozen=True, slots=True)
class Goal:
    """What the outputs shall do, tick by tick, as it is known from one tick on.

    Attributes
    ----------
    tick : int
        From here on this is known; earlier ticks are history.
    depth_mm, temperature_c : (n,) arrays
        Set-point less output disturbance: where the undisturbed output should be.
    force_kn, speed_rpm : (n,) arrays
        Input disturbances.
    """

    tick: int
    depth_mm: Vector
    temperature_c: Vector
    force_kn: Vector
    speed_rpm: Vector


@dataclass(frozen=True, slots=True)
class PhysicalLimit:
    """Trajectories of the physical limit.

    Attributes
    ----------
    depth_error_mm, temperature_error_c, force_kn, speed_rpm : (n,) arrays
        At the ticks.
    solved : bool
        Whether every program was solved.
    """

    depth_error_mm: Vector
    temperature_error_c: Vector
    force_kn: Vector
    speed_rpm: Vector
    solved: bool


@dataclass(frozen=True, slots=True)
class _Optimum:
    """One program's answer; row k of ``states`` and ``errors`` is at its tick k."""

    states: Vector
    inputs: Vector
    power: list[Vector]
    errors: Vector
    solved: bool


class Yardstick:
    """Computes the physical limit of a course of events.

    Parameters
    ----------
    parameters : ModelParameters
    limits : Limits, optional
    weight_per_mm : float
        Cost of 1 mm of depth error in degC of temperature error.
    window_s : float
        How far each program looks.
    largest_temperature_error_c : float, optional
        Bound on the temperature error in events that leave the temperature's set-point alone, as far as it can be
        kept (its excess costs 100 per degC).
    preview_s : float
        How much earlier than it begins an event is known.
    """

    def __init__(
        self,
        parameters: ModelParameters,
        limits: Limits | None = None,
        weight_per_mm: float = 100.0,
        window_s: float = 45.0,
        largest_temperature_error_c: float | None = None,
        preview_s: float = 0.0,
    ) -> None:
        self.model = ProcessModel(parameters)
        self.limits = limits or Limits()
        self.preview_ticks = round(preview_s / STEP_S)
        self._weight = weight_per_mm
        self._ticks = round(window_s / STEP_S)
        self._bound = largest_temperature_error_c
        self._solvers: dict[int, tuple[ca.Function, dict[str, Vector]]] = {}

    def run(self, goals: list[Goal]) -> PhysicalLimit:
        """Optimise goal after goal.

        Parameters
        ----------
        goals : list of Goal
            In order of their ticks, the first at tick 0; all arrays have the length of the whole course.

        Raises
        ------
        ValueError
            If there is no goal, or the first does not begin at tick 0.
        """
        if not goals or goals[0].tick != 0:
            raise ValueError("physical limit: needs at least one goal, the first from tick 0 on")
        n = len(goals[0].depth_mm)
        start = self.model.equilibrium(float(goals[0].depth_mm[0]), float(goals[0].temperature_c[0]))
        state = np.array(start.state.x)
        power = [np.array(nodes) for nodes in start.state.power_kw]
        inputs = np.array([start.force_kn, start.speed_rpm])
        errors, moves, solved = np.zeros((n, 2)), np.zeros((n, 2)), True
        begins = [max(goal.tick - self.preview_ticks, 0) for goal in goals] + [n]
        for goal, begin, end in zip(goals, begins[:-1], begins[1:], strict=True):
            if end <= begin:
                continue
            ticks = max(self._ticks, end - begin)
            targets = np.array([_window(a, begin, ticks) for a in (goal.depth_mm, goal.temperature_c)])
            loads = np.array([_window(a, begin, ticks) for a in (goal.force_kn, goal.speed_rpm)])
            optimum = self._solve(ticks, state, power, inputs, targets, loads)
            solved = solved and optimum.solved
            keep = end - begin
            errors[begin:end], moves[begin:end] = optimum.errors[:keep], optimum.inputs[:keep]
            state, inputs = optimum.states[keep], optimum.inputs[keep - 1]
            power = [*power, *optimum.power][keep : keep + len(power)]
        return PhysicalLimit(errors[:, 0], errors[:, 1], moves[:, 0], moves[:, 1], solved)

    def _solve(
        self, ticks: int, state: Vector, power: list[Vector], inputs: Vector, targets: Vector, loads: Vector
    ) -> _Optimum:
        function, bounds = self._program(ticks)
        if self._bound is not None and np.abs(targets[1] - state[4]).max() > self._bound:
            # the temperature has to change: there is nothing to bound
            high = bounds["ubg"].reshape(ticks, -1).copy()
            high[:, -1] = np.inf
            bounds = bounds | {"ubg": high.ravel()}
        p = np.concatenate([state, np.concatenate(power), inputs, targets.ravel(order="F"), loads.ravel(order="F")])
        guess = np.full((ticks, _WIDTH), 0.01)
        guess[:, :2], guess[:, 2:7], guess[:, 7:10] = inputs, state, power[-1]
        answer = function(x0=guess.ravel(), p=p, **bounds)
        rows = np.array(answer["x"]).reshape(ticks, _WIDTH)
        model = self.model.parameters
        states = np.vstack([state, rows[:, 2:7]])
        outputs = np.column_stack([model.operating_depth_mm + states[:-1, :4].sum(axis=1), states[:-1, 4]])
        return _Optimum(
            states, rows[:, :2], list(rows[:, 7:10]), outputs - targets.T, bool(function.stats()["success"])
        )

    def _program(self, ticks: int) -> tuple[ca.Function, dict[str, Vector]]:
        if ticks not in self._solvers:
            self._solvers[ticks] = self._build(ticks)
        return self._solvers[ticks]

    def _build(self, ticks: int) -> tuple[ca.Function, dict[str, Vector]]:
        model, lim = self.model, self.limits
        step = step_function(model.parameters, STEP_S)
        x0, delayed = ca.SX.sym("x0", N_STATES), ca.SX.sym("delayed", 3, model.delay_steps)
        before = ca.SX.sym("before", 2)
        targets, loads = ca.SX.sym("targets", 2, ticks), ca.SX.sym("loads", 2, ticks)
        v = ca.SX.sym("v", _WIDTH, ticks)
        inputs, states, nodes, slack = v[:2, :], v[2:7, :], v[7:10, :], v[10:, :]
        previous = ca.horzcat(x0, states[:, :-1])
        powers = ca.horzcat(delayed, nodes)[:, :ticks]
        ahead = step.map(ticks)(previous, powers, inputs[0, :] + loads[0, :], inputs[1, :] + loads[1, :])
        moves = inputs - ca.horzcat(before, inputs[:, :-1])
        depth = model.parameters.operating_depth_mm + ca.sum1(states[:4, :])
        last = ca.horzcat(targets[:, 1:], targets[:, -1])
        error = ca.vertcat(depth, states[4, :]) - last
        dynamics = ca.vertcat(states - ahead[0], nodes - ahead[1])
        split = error - (slack[:2, :] - slack[2:4, :])
        rows = ca.vertcat(dynamics, split, moves)
        cost = STEP_S * ca.sum2(self._weight * (slack[0, :] + slack[2, :]) + slack[1, :] + slack[3, :])
        cost += _REGULARISATION * ca.sum2(ca.sum1((moves / ca.DM([lim.force_step_kn, lim.speed_step_rpm])) ** 2))
        if self._bound is not None:
            beyond = slack[1, :] + slack[3, :] - self._bound
            cost += STEP_S * 100.0 * ca.sum2(slack[4, :])
            rows = ca.vertcat(rows, beyond - slack[4, :])
        low = np.full((ticks, rows.shape[0]), 0.0)
        high = low.copy()
        high[:, 10:12] = lim.force_step_kn, lim.speed_step_rpm
        low[:, 10:12] = -high[:, 10:12]
        if self._bound is not None:
            low[:, 12:] = -np.inf
        low_x, high_x = np.full((ticks, _WIDTH), -np.inf), np.full((ticks, _WIDTH), np.inf)
        low_x[:, :2] = lim.force_min_kn, lim.speed_min_rpm
        high_x[:, :2] = lim.force_max_kn, lim.speed_max_rpm
        low_x[:, 10:] = 0.0
        parameters = ca.vertcat(x0, ca.vec(delayed), before, ca.vec(targets), ca.vec(loads))
        program: dict[str, Any] = {"x": ca.vec(v), "p": parameters, "f": cost, "g": ca.vec(rows)}
        options: dict[str, Any] = {
            "print_time": False,
            "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 400, "tol": 1e-6, "mu_strategy": "adaptive"},
        }
        bounds = {"lbx": low_x.ravel(), "ubx": high_x.ravel(), "lbg": low.ravel(), "ubg": high.ravel()}
        return ca.nlpsol("limit", "ipopt", program, options), bounds


def _window(values: Vector, begin: int, ticks: int) -> Vector:
    """``ticks`` values from ``begin`` on; the last one goes on."""
    part = values[begin : begin + ticks]
    return np.concatenate([part, np.full(ticks - len(part), values[-1])])
