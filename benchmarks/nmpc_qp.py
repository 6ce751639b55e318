#!/usr/bin/env python3
"""Measures the QP of the NMPC's tick.

The library's solver beside the QP solvers that come with CasADi.

    python3 benchmarks/nmpc_qp.py [--quick] [--json FILE]

All of them get the same linearisation about the last plan, in ticks after the set-points' steps of
a weld, once for the preset ``default`` (40 moves, quadratic cost) and once for ``paper`` (108
moves, L1 costs, so that each dead-band and each move has a variable of its own). The library
eliminates those; HPIPM, which is made for stages, gets one stage.

``NAME_ms`` is the CPU time in the solver, ``NAME_interface_ms`` what CasADi adds to it,
``NAME_warm_ms`` the same started from the last plan. ``own_ms`` is the library's solver from the
last plan without the prediction, which is ``prediction_ms``; ``iterations`` are its, ``active``
the limits that its solution is at. ``ratio_NAME`` is the time over the library's, of the faster of
cold and warm. Solutions are judged by their cost: ``excess_NAME`` is the largest relative
difference to the best. The exit code is 1 if the library's own solution is not the best.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import _benchmark
import casadi as ca
import numpy as np
from nmpc import make, problems_of_weld

from fsw_nmpc.library import KERNEL, Library, SolveStatus, Vector, pointer
from fsw_test_support.nmpc_ipopt import (
    cumulation,
    input_bounds,
    largest_moves,
    move_squares,
    move_weights,
    squares,
    weights,
)
from fsw_test_support.nmpc_problems import predict, solve

#: options of the solvers that differ from CasADi's; tolerances so that costs agree to SAME_COST
OPTIONS: dict[str, dict[str, Any]] = {
    "daqp": {},
    "qpoases": {"printLevel": "none"},
    "hpipm": {"hpipm": {"mode": "speed_abs", "iter_max": 200}},
    "piqp": {},
    "highs": {"highs": {"output_flag": False}},
    "proxqp": {"proxqp": {"eps_abs": 1e-7, "max_iter": 1000}},
    "osqp": {"osqp": {"verbose": False, "eps_abs": 1e-6, "eps_rel": 1e-6, "max_iter": 4000}},
}
#: costs that differ by more, relatively, are not of a solution
SAME_COST = 1e-3
#: what is so near to a limit is at it
AT_LIMIT = 1e-4
#: as in the library: a move without a cost still has a smallest one
_LEAST_CURVATURE = 1e-9
REPEATS = 7


@dataclass(frozen=True, slots=True)
class Qp:
    """min ½ x'Hx + g'x + constant with l ≤ Ax ≤ u, low ≤ x ≤ high.

    The first variables are the scaled moves.
    """

    h: Vector
    g: Vector
    a: Vector
    l: Vector  # noqa: E741  # as in the formula
    u: Vector
    low: Vector
    high: Vector
    constant: float
    start: Vector  #: scaled moves of the last plan

    def cost(self, moves: Vector) -> float:
        """Of scaled moves, with the other variables as small as they may be."""
        n = len(self.start)
        x = np.zeros(len(self.g))
        x[:n] = np.clip(moves, -1.0, 1.0)
        at_moves = self.a[:, :n] @ x[:n]
        for column in range(n, len(self.g)):
            rows = np.flatnonzero(self.a[:, column])
            over = np.where(
                self.a[rows, column] < 0,
                at_moves[rows] - self.u[rows],
                self.l[rows] - at_moves[rows],
            )
            x[column] = max(0.0, *over)
        return float(0.5 * x @ self.h @ x + self.g @ x + self.constant)

    def active(self, moves: Vector) -> int:
        """How many limits of scaled moves and of inputs these moves are at."""
        n = len(moves)
        inputs = self.a[-n:, :n] @ moves
        at_input = (inputs < self.l[-n:] + AT_LIMIT) | (inputs > self.u[-n:] - AT_LIMIT)
        return int(np.sum(np.abs(moves) > 1.0 - AT_LIMIT) + np.sum(at_input))


def qp_of(library: Library, problem: Any, plan: Vector) -> Qp:
    """The QP of a problem about a plan, with a variable for every violation and move size."""
    h, t = library.horizon, library.state.tuning
    n = 2 * h.n_blocks
    largest = np.outer(h.block_reach, largest_moves(t)).ravel()
    length = np.repeat(h.block_sizes, 2) * largest
    square = np.tile(move_squares(t), h.n_blocks) * length * largest / np.repeat(h.block_reach, 2)
    weighed = squares(t)
    hessian, gradient, constant = np.diag(square + _LEAST_CURVATURE), np.zeros(n), 0.0
    rows, low, high, weight = [], [], [], []
    depth, temperature, by_depth, by_temperature = predict(
        library, KERNEL.ffi.addressof(problem, "start"), plan
    )
    for q, (output, by) in enumerate(((depth, by_depth), (temperature, by_temperature))):
        band = np.array([list(side[q][0 : h.n_out]) for side in (problem.low, problem.high)]) - (
            output - by @ plan
        )
        for i in np.flatnonzero((h.depth_width, h.temperature_width)[q] > 0):
            row, centre = by[i] * largest, band[:, i].mean()
            hessian += weighed[q] * np.outer(row, row)
            gradient -= weighed[q] * centre * row
            constant += 0.5 * weighed[q] * centre**2
            if weights(t)[q] > 0.0:
                rows.append(row)
                low.append(band[0, i])
                high.append(band[1, i])
                weight.append(weights(t)[q])
    move_weight = np.tile(move_weights(t), h.n_blocks) * length
    sized = np.flatnonzero(move_weight > 0.0)
    n_soft, n_sized = len(rows), len(sized)
    outputs, moves = np.array(rows).reshape(n_soft, n), np.eye(n)[sized]
    soft, size = np.eye(n_soft, n_soft + n_sized), np.eye(n_sized, n_soft + n_sized, n_soft)
    bounds = input_bounds(problem, t, h)
    nothing, endless = np.zeros(n_sized), np.full(n_soft + n_sized, np.inf)
    total = n + n_soft + n_sized
    whole = np.zeros((total, total))
    whole[:n, :n] = hessian
    return Qp(
        h=whole,
        g=np.concatenate([gradient, weight, move_weight[sized]]),
        a=np.vstack(
            [
                *(np.hstack([outputs, sign * soft]) for sign in (-1.0, 1.0)),
                *(np.hstack([moves, sign * size]) for sign in (-1.0, 1.0)),
                np.hstack([cumulation(h) * largest, np.zeros((n, n_soft + n_sized))]),
            ]
        ),
        l=np.concatenate([-endless[:n_soft], low, -endless[:n_sized], nothing, bounds[0]]),
        u=np.concatenate([high, endless[:n_soft], nothing, endless[:n_sized], bounds[1]]),
        low=np.concatenate([-np.ones(n), np.zeros(n_soft + n_sized)]),
        high=np.concatenate([np.ones(n), endless]),
        constant=constant,
        start=plan / largest,
    )


@dataclass(frozen=True, slots=True)
class Answer:
    """CPU time in a solver and of the interface, and its scaled moves (None: not solved)."""

    solver_s: float
    interface_s: float
    moves: Vector | None


def by_casadi(name: str, qp: Qp, warm: bool) -> Answer:
    """Solve a QP by a solver of CasADi; the solver is made before the clock starts."""
    h, a = ca.sparsify(ca.DM(qp.h)), ca.sparsify(ca.DM(qp.a))
    options: dict[str, Any] = {"error_on_fail": False, "record_time": True, **OPTIONS[name]}
    more, bounds = {}, {"lba": qp.l, "uba": qp.u, "lbx": qp.low, "ubx": qp.high, "g": qp.g}
    n, m = len(qp.g), len(qp.l)
    if name == "hpipm":  # one stage whose inputs are the variables, and a state of no use after it
        options |= {"N": 1, "nx": [0, 1], "nu": [n, 0], "ng": [m, 0]}
        h = ca.diagcat(ca.DM(qp.h), ca.DM(1.0))
        a = ca.vertcat(ca.horzcat(ca.DM(1, n), ca.DM(-1.0)), ca.horzcat(ca.DM(qp.a), ca.DM(m, 1)))
        edges = {"lba": 0.0, "uba": 0.0, "lbx": -1.0, "ubx": 1.0, "g": 0.0}
        bounds = {
            key: np.append(value, edges[key])
            if key in ("lbx", "ubx", "g")
            else np.append(edges[key], value)
            for key, value in bounds.items()
        }
    if warm:
        more = {"x0": np.concatenate([qp.start, np.zeros(h.size1() - len(qp.start))])}
    solver = ca.conic("solver", name, {"h": h.sparsity(), "a": a.sparsity()}, options)
    times, solver_s = [], []
    for _ in range(REPEATS):
        began = time.thread_time()
        solution = solver(h=h, a=a, **bounds, **more)
        times.append(time.thread_time() - began)
        stats = solver.stats()
        solver_s.append(stats["t_proc_solver"] or times[-1])  # OSQP does not tell
    inside, outside = statistics.median(solver_s), statistics.median(times)
    moves = np.asarray(solution["x"].full().ravel()[: len(qp.start)], dtype=np.float64)
    return Answer(inside, max(0.0, outside - inside), moves if stats["success"] else None)


def median_s(function: Callable[[], Any]) -> float:
    """Median CPU time of a call."""
    times = []
    for _ in range(20):
        began = time.thread_time()
        function()
        times.append(time.thread_time() - began)
    return statistics.median(times)


def compare(preset: str, quick: bool) -> _benchmark.Figures:
    """All solvers on the problems of a weld with a preset's cost."""
    controller = make(preset=preset)
    library = controller.library
    names = [name for name in OPTIONS if ca.has_conic(name)]
    series: dict[str, list[float]] = defaultdict(list)
    unsolved = dict.fromkeys(names, 0)
    problems = problems_of_weld(controller, quick)
    for number, (problem, plan) in enumerate(problems, 1):
        qp = qp_of(library, problem, plan)
        status, own_moves, _, _ = solve(library, problem, plan)
        if status is not SolveStatus.OK:
            raise RuntimeError(f"the library cannot solve a problem of the weld: {status.name}")
        start = KERNEL.ffi.addressof(problem, "start")
        # without what predict() adds in Python, which solve() does not do
        given = (KERNEL.ffi.addressof(library.state, "model"), start, pointer(plan))
        given = (*given, KERNEL.ffi.addressof(library.state, "workspace"))
        prediction_s = median_s(lambda given=given: library.lib.fsw_predict(*given))
        whole_s = median_s(lambda problem=problem, plan=plan: solve(library, problem, plan))
        own_s = whole_s - prediction_s
        series["iterations"].append(library.output.iterations)
        largest = np.outer(
            library.horizon.block_reach, largest_moves(library.state.tuning)
        ).ravel()
        series["active"].append(qp.active(own_moves / largest))
        costs = {"own": qp.cost(own_moves / largest)}
        for name in names:
            cold, warm = by_casadi(name, qp, False), by_casadi(name, qp, True)
            unsolved[name] += cold.moves is None
            if cold.moves is None:
                continue
            costs[name] = qp.cost(cold.moves)
            series[f"{name}_ms"].append(1e3 * cold.solver_s)
            series[f"{name}_warm_ms"].append(1e3 * warm.solver_s)
            series[f"{name}_interface_ms"].append(1e3 * cold.interface_s)
            series[f"ratio_{name}"].append(min(cold.solver_s, warm.solver_s) / own_s)
        best = min(costs.values())
        for name, cost in costs.items():
            series[f"excess_{name}"].append((cost - best) / (1.0 + abs(best)))
        series["own_ms"].append(1e3 * own_s)
        series["prediction_ms"].append(1e3 * prediction_s)
        print(f"  {preset}: problem {number} of {len(problems)}", file=sys.stderr, flush=True)
    figures: _benchmark.Figures = {f"{preset}_problems": len(problems)}
    for key, values in series.items():
        figures[f"{preset}_{key}"] = (
            max(values) if key.startswith("excess_") else statistics.median(values)
        )
    return figures | {f"{preset}_unsolved_{name}": count for name, count in unsolved.items()}


def measure(quick: bool) -> tuple[_benchmark.Figures, _benchmark.Figures]:
    """Figures of both presets."""
    return compare("default", quick) | compare("paper", quick), {}


def main() -> int:
    """Run the comparison; returns the exit code."""
    figures = _benchmark.run(__doc__, "four problems a preset instead of twenty", measure)
    return int(any(figures[f"{preset}_excess_own"] > SAME_COST for preset in ("default", "paper")))


if __name__ == "__main__":
    sys.exit(main())
