"""The nonlinear problem of a tick, a stage per block, solved to convergence by FATROP.

FATROP wants variables in the order x0, u0, x1, u1, ..., and for every stage the dynamics as x1 -
f(x0, u0) and then its other constraints. The problem of ``nmpc_ipopt``, which has no stages, takes
it many times as long.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from fsw_model import ModelParameters
from fsw_nmpc.library import KERNEL, Library, SolveStatus, Vector
from fsw_test_support.nmpc_ipopt import move_weights, objective, weights
from fsw_test_support.nmpc_problems import predict
from fsw_test_support.nmpc_stages import INPUTS, Stages

#: below it FATROP stalls: the cost has flat directions, and the Hessian is regularised in every
#: iteration
TOLERANCE = 1e-6


class FatropSolver:
    """Solves the problem with all slacks from nothing, for a tuning with L1 costs (preset ``paper``).

    Parameters
    ----------
    library : Library
        Its horizon, and its tuning at the time of making the solver.
    parameters : ModelParameters
    tolerance : float
    """

    name = "fatrop"

    def __init__(
        self, library: Library, parameters: ModelParameters, tolerance: float = TOLERANCE
    ) -> None:
        self._library, self._tuning = library, library.state.tuning
        self._stages = Stages(library, parameters)
        self.iterations, self.cost = 0, np.nan
        self._solver = self._made(tolerance)

    def solve(self, problem: Any, moves: Vector) -> tuple[int, Vector, Vector, Vector]:
        """Solve to convergence; ``moves`` are not used but to give back when it fails."""
        h, stages = self._library.horizon, self._stages
        data, start = stages.data(problem), stages.start(problem)
        still = np.zeros((h.n_blocks, 2))
        states = stages.rolled_out(start, still, data)
        at_rest = predict(self._library, KERNEL.ffi.addressof(problem, "start"), still.ravel())
        scale = 1.0 / (1.0 + objective(problem, self._tuning, h, still.ravel(), *at_rest[:2]))
        guess: list[Vector] = []
        low: list[Vector] = []
        high: list[Vector] = []
        low_g: list[Vector] = []
        high_g: list[Vector] = []
        given = [start, np.array([scale])]
        for k, (of_stage, state) in enumerate(zip(data, states, strict=False)):
            n_slack = len(of_stage.low) + 2
            bounds = self._state_bounds(len(state), data[k - 1] if k else None)
            guess += [state, np.zeros(2 + n_slack)]
            low += [bounds[0], -np.ones(2), np.zeros(n_slack)]
            high += [bounds[1], np.ones(2), np.full(n_slack, np.inf)]
            fixed = np.zeros(len(states[k + 1]) + (0 if k else len(start)))
            n_rows = 2 * n_slack
            low_g += [fixed, np.full(n_rows, -np.inf)]
            high_g += [fixed, np.zeros(n_rows)]
            given += [of_stage.parameter, of_stage.low, of_stage.high, of_stage.goal]
            given += [of_stage.weight, of_stage.move_weight]
        bounds = data[-1].input_low, data[-1].input_high
        solution = self._solver(
            x0=np.concatenate([*guess, states[-1]]),
            p=np.concatenate(given),
            lbx=np.concatenate([*low, bounds[0]]),
            ubx=np.concatenate([*high, bounds[1]]),
            lbg=np.concatenate(low_g),
            ubg=np.concatenate(high_g),
        )
        stats = self._solver.stats()
        self.iterations, self.cost = int(stats["iter_count"]), float(solution["f"]) / scale
        if not stats["success"]:
            nothing = np.full(h.n_out, np.nan)
            return SolveStatus.ITERATION_CAP, moves, nothing, nothing
        x = solution["x"].full().ravel()
        best = stages.moves(np.clip([x[begin : begin + 2] for begin in self._moves_at], -1.0, 1.0))
        start_of = KERNEL.ffi.addressof(problem, "start")
        return SolveStatus.OK, best, *predict(self._library, start_of, best)[:2]

    def _state_bounds(self, n: int, before: Any) -> tuple[Vector, Vector]:
        low, high = np.full(n, -np.inf), np.full(n, np.inf)
        if before is not None:
            low[list(INPUTS)], high[list(INPUTS)] = before.input_low, before.input_high
        return low, high

    def _made(self, tolerance: float) -> ca.Function:
        stages, cost_weights = self._stages.stages, weights(self._tuning)
        move_cost = np.array(move_weights(self._tuning)) * self._stages.moves(
            np.ones((len(stages), 2))
        ).reshape(-1, 2)
        move_cost *= self._library.horizon.block_sizes[:, None]
        states = [ca.MX.sym(f"x{k}", stage.n_states) for k, stage in enumerate(stages)]
        states.append(ca.MX.sym("x_end", 2))
        start, scale = ca.MX.sym("start", stages[0].n_states), ca.MX.sym("scale")
        variables, rows, equal, given, n_rows, n_inputs = [], [], [], [start, scale], [], []
        cost = ca.MX(0)
        self._moves_at, place = [], 0
        for k, stage in enumerate(stages):
            n = stage.outputs.size1_out(0)
            u, over, size = ca.MX.sym(f"u{k}", 2), ca.MX.sym(f"v{k}", n), ca.MX.sym(f"s{k}", 2)
            p, low, high, goal, weight = (
                ca.MX.sym(f"{name}{k}", length)
                for name, length in (
                    ("p", stage.n_parameters),
                    ("l", n),
                    ("h", n),
                    ("g", n),
                    ("w", n),
                )
            )
            square = ca.MX.sym(f"m{k}", 2)
            after, shown = stage.step(states[k], u, p), stage.outputs(states[k], u, p)
            l1 = np.repeat(cost_weights, [len(stage.depth_points), len(stage.tool_points)])
            cost += ca.dot(l1, over) + ca.dot(move_cost[k], size)
            cost += 0.5 * (ca.dot(weight, (shown - goal) ** 2) + ca.dot(square, u**2))
            path = [shown - high - over, low - shown - over, u - size, -u - size]
            fixed = [] if k else [states[0] - start]
            # stage by stage: the dynamics in this form, then the rest
            rows += [states[k + 1] - after, *fixed, *path]
            n_dynamics, n_path = after.size1(), 2 * n + 4
            n_fixed = 0 if k else start.size1()
            equal += [True] * (n_dynamics + n_fixed) + [False] * n_path
            n_rows.append(n_fixed + n_path)
            n_inputs.append(4 + n)
            variables += [states[k], u, over, size]
            self._moves_at.append(place + stage.n_states)
            place += stage.n_states + 4 + n
            given += [p, low, high, goal, weight, square]
        program: dict[str, Any] = {
            "x": ca.vertcat(*variables, states[-1]),
            "f": scale * cost,
            "g": ca.vertcat(*rows),
            "p": ca.vertcat(*given),
        }
        options: dict[str, Any] = {
            "structure_detection": "manual",
            "N": len(stages),
            "nx": [state.size1() for state in states],
            "nu": [*n_inputs, 0],
            "ng": [*n_rows, 0],
            "equality": equal,
            "expand": True,
            "print_time": False,
            "error_on_fail": False,
            "fatrop": {"print_level": 0, "tolerance": tolerance},
        }
        return ca.nlpsol("staged", "fatrop", program, options)
