#!/usr/bin/env python3
"""Measures the NMPC.

CPU time per controller step, quality against the converged problem, worst cases, memory.

    python3 benchmarks/nmpc.py [--quick] [--json FILE]

Times are CPU times of the controller's thread for a whole step: estimator, trajectories, solver,
acceptance, plan. ``rti`` is the default tuning with 20 blocks, ``rti108`` the same with a move of
both inputs in every interval, ``paper`` the preset with the paper's cost, which has 108 moves too.

``ratio_NAME`` is the CPU time of IPOPT, CasADi's SQP with PIQP, or FATROP over the library's, all
cold on the same problems of a weld, with 108 moves; the library linearises three times, and the
costs that all of them reach are compared. ``ratio_NAME_to_tick`` is over the one linearisation
about the last plan that a tick does: its cost is compared too. The exit code is 1 if a solver does
not agree on what its solution costs, or reaches another cost.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import _benchmark
import numpy as np

from fsw_control import Command, Measurement, Reference, weld
from fsw_control.sensors import REQUIRED, SENSORS
from fsw_model import STEP_S, ProcessModel, nominal
from fsw_nmpc.controller import NmpcController
from fsw_nmpc.library import KERNEL, SolveStatus, Vector
from fsw_test_support.nmpc_fatrop import TOLERANCE as FATROP_TOLERANCE
from fsw_test_support.nmpc_fatrop import FatropSolver
from fsw_test_support.nmpc_ipopt import (
    ReferenceSolver,
    cumulation,
    input_bounds,
    largest_moves,
    objective,
)
from fsw_test_support.nmpc_problems import (
    predict,
    problem_of,
    solve,
    use_solver,
)

#: Two steps of the depth and two of the temperature: when, and what they add to the operating
#: point.
EVENTS = ((20.0, 0.2, 0.0), (70.0, 0.0, 0.0), (130.0, 0.0, 10.0), (180.0, 0.0, 0.0))
WELD_S = 240.0
#: Standard deviations of depth, torque and temperature.
NOISE = tuple(SENSORS[name].noise for name in REQUIRED)
#: A cold problem is solved by so many linearisations, the first two coarsely.
COLD_TOLERANCES = (1e-1, 1e-3, 1e-5)
#: When after an event a problem is taken.
TAKEN_S = (0.5, 1.0, 2.0, 4.0, 8.0)
#: Other solvers: CasADi's name and options. SQP has exact second derivatives; of the QP solvers
#: PIQP takes them as they are, and is the fastest that does.
RIVALS: dict[str, tuple[str, dict[str, Any] | None]] = {
    "ipopt": ("ipopt", None),
    "sqp_piqp": (
        "sqpmethod",
        {
            **{f"print_{what}": False for what in ("header", "iteration", "status")},
            "qpsol": "piqp",
            "qpsol_options": {"error_on_fail": False},
            "error_on_fail": False,
            "max_iter": 50,
        },
    ),
}
#: FATROP on the same formulation as the others
UNSTAGED_FATROP = {
    "error_on_fail": False,
    "fatrop": {"print_level": 0, "tolerance": FATROP_TOLERANCE, "max_iter": 200},
}
#: All of them; FATROP gets the problem in stages.
RIVAL_NAMES = (*RIVALS, FatropSolver.name)
#: Costs that differ by more, relatively, are not of the same problem or not of a solution.
SAME_COST = 1e-3


def measure(quick: bool, only_ratios: bool) -> tuple[_benchmark.Figures, _benchmark.Figures]:
    """Figures of all measurements."""
    figures: _benchmark.Figures = {}
    for part in (ratios,) if only_ratios else (step_times, ratios, against_converged):
        print(f"{(part.__doc__ or '').splitlines()[0]} ...", file=sys.stderr, flush=True)
        figures |= part(quick)
    return figures, {}


def main() -> int:
    """Run all measurements; returns the exit code."""
    only = {"action": "store_true", "help": "only the comparison with other solvers"}
    quick = "shorter runs: minutes become seconds"
    figures = _benchmark.run(__doc__, quick, measure, options={"--only-ratios": only})
    others = [
        name
        for name, value in figures.items()
        if name.startswith("cost_") and value and abs(value) > SAME_COST
    ]
    for name in others:
        print(f"not the same: {name} is beyond {SAME_COST}", file=sys.stderr)
    return int(bool(others))


def reference_at(time_s: float, compressed: float = 1.0) -> Reference:
    """Set-points of the weld; ``compressed`` runs it faster."""
    now = Reference(weld.DEPTH_MM, weld.TEMPERATURE_C)
    for at_s, deeper_mm, warmer_c in EVENTS:
        if time_s * compressed >= at_s:
            now = Reference(weld.DEPTH_MM + deeper_mm, weld.TEMPERATURE_C + warmer_c)
    return now


def close_loop(
    controller: NmpcController,
    reference: Callable[[float], Reference],
    duration_s: float,
    noise: float = 0.0,
    watch: Callable[[float, Any, Vector], None] | None = None,
) -> tuple[Vector, Vector]:
    """Run controller and process from rest; ``noise`` is the share of the sensors' noise.

    Returns rows of time, depth, temperature and the set-points (n, 5), and the CPU time of each
    step (n,). ``watch`` is told every tick's time, problem and where its solve began.
    """
    model, rng = ProcessModel(), np.random.default_rng(1)
    rest = model.equilibrium()
    state, applied = rest.state.copy(), Command(rest.force_kn, rest.speed_rpm)
    library = controller.library
    controller.reset(applied)
    rows, cpu_s = [], []
    for k in range(round(duration_s / STEP_S)):
        shown = model.outputs(state, applied.force_kn, applied.speed_rpm)
        off = noise * rng.normal(size=3) * NOISE
        time_s = STEP_S * k
        target = reference(time_s)
        measurement = Measurement(
            time_s,
            shown.depth_mm + off[0],
            shown.motor_torque_nm + off[1],
            shown.temperature_c + off[2],
        )
        start = (
            np.array(list(library.state.plan.start[0 : 2 * library.horizon.n_blocks]))
            if watch
            else None
        )
        began = time.thread_time()
        proposal = controller.step(measurement, target, applied, STEP_S)
        cpu_s.append(time.thread_time() - began)
        if watch:
            watch(time_s, problem_of(library), start)
        rows.append(
            (time_s, shown.depth_mm, shown.temperature_c, target.depth_mm, target.temperature_c)
        )
        applied = proposal.command
        model.step(state, applied.force_kn, applied.speed_rpm)
    return np.array(rows), np.array(cpu_s)


def make(blocks: int | None = None, **values: Any) -> NmpcController:
    """A controller with these parameters, and blocks other than those of its preset."""
    if blocks is None:
        return NmpcController(values)
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as tuning:
        tuning.write(f"blocks: {blocks}\n")
        tuning.flush()
        return NmpcController({"tuning_file": tuning.name, **values})


def step_times(quick: bool) -> _benchmark.Figures:
    """CPU time per step in closed loop, with sensor noise."""
    figures: _benchmark.Figures = {}
    duration_s = WELD_S / 4 if quick else WELD_S
    for name, controller in (
        ("rti", make()),
        ("rti108", make(54)),
        ("paper", make(preset="paper")),
    ):
        _, cpu_s = close_loop(
            controller, lambda t: reference_at(t, WELD_S / duration_s), duration_s, noise=1.0
        )
        figures |= _benchmark.percentiles(name, 1e3 * cpu_s[10:])
        figures[f"{name}_failures"] = controller.library.output.bad_cycles
    return figures


def problems_of_weld(controller: NmpcController, quick: bool) -> list[tuple[Any, Vector]]:
    """Problems as they come after the set-points' steps, each with the last plan's moves."""
    problems: list[tuple[Any, Vector]] = []
    wanted = {
        round(10 * (at_s + later_s))
        for at_s, _, _ in EVENTS
        for later_s in (TAKEN_S[1:2] if quick else TAKEN_S)
    }

    def watch(time_s: float, problem: Any, start: Vector) -> None:
        if round(10 * time_s) in wanted:
            kept = KERNEL.new("fsw_problem")
            kept[0] = problem[0]
            problems.append((kept, start))

    close_loop(controller, reference_at, WELD_S, noise=1.0, watch=watch)
    return problems


@dataclass(frozen=True, slots=True)
class Answer:
    """CPU time of a solver, its moves (None: failed), and its own cost of them."""

    cpu_s: float
    moves: Vector | None = None
    cost: float = np.nan


class Comparison:
    """The library and its rivals on the same problems, with 54 moves of both inputs.

    None gets help from a solution: moves start at zero.
    """

    def __init__(self, controller: NmpcController) -> None:
        self._library = controller.library
        self._tuning, self._horizon = self._library.state.tuning, self._library.horizon
        self._exact = self._tuning.tolerance
        self._cold = np.zeros(2 * self._horizon.n_blocks)
        self._rivals: dict[str, ReferenceSolver | FatropSolver] = {
            name: ReferenceSolver(
                self._library, controller.settings.model, method=method, options=options
            )
            for name, (method, options) in RIVALS.items()
        }
        self._rivals[FatropSolver.name] = FatropSolver(self._library, controller.settings.model)
        self._series: dict[str, list[float]] = defaultdict(list)
        self._unsolved = dict.fromkeys(RIVAL_NAMES, 0)

    def compare(self, problem: Any, start: Vector) -> str:
        """Solve one problem by all solvers; the costs in words."""
        own, tick = (
            self._by_library(problem, self._cold, COLD_TOLERANCES),
            self._by_library(problem, start),
        )
        answers = {"rti108": own, "tick": tick}
        for name in RIVAL_NAMES:
            answers[name] = self._by_rival(name, problem)
            self._unsolved[name] += answers[name].moves is None
        moves = {
            name: answer.moves for name, answer in answers.items() if answer.moves is not None
        }
        costs = {name: self._cost_of(problem, its) for name, its in moves.items()}
        best = min(
            *costs.values(),
            self._cost_of(
                problem, self._by_library(problem, self._cold, (self._exact,) * 8).moves
            ),
        )
        for name, cost in costs.items():
            for key, value in {
                "solve_{}_ms": 1e3 * answers[name].cpu_s,
                "cost_excess_{}": cost / best - 1.0,
                "limit_excess_{}": self._beyond(problem, moves[name]),
                "cost_error_{}": answers[name].cost / cost - 1.0,
                "ratio_{}": answers[name].cpu_s / own.cpu_s,
                "ratio_{}_to_tick": answers[name].cpu_s / tick.cpu_s,
            }.items():
                self._series[key.format(name)].append(value)
        return f"cost {best:.4g}; " + ", ".join(
            f"{name} {cost / best - 1.0:+.1e}" for name, cost in costs.items()
        )

    def figures(self) -> _benchmark.Figures:
        """Medians of times, and the largest excesses."""
        series, figures = self._series, _benchmark.Figures()
        for key in (
            ratio for name in RIVAL_NAMES for ratio in (f"ratio_{name}", f"ratio_{name}_to_tick")
        ):
            figures[key] = self._middle(key)
        for name in ("rti108", "tick", *RIVAL_NAMES):
            figures[f"solve_{name}_ms"] = self._middle(f"solve_{name}_ms")
            figures[f"limit_excess_{name}"] = max(series[f"limit_excess_{name}"], default=None)
        for name in ("rti108", *RIVAL_NAMES):
            figures[f"cost_excess_{name}"] = max(series[f"cost_excess_{name}"], default=None)
        figures["tick_cost_excess_p50"] = self._middle("cost_excess_tick")
        figures["tick_cost_excess_max"] = max(series["cost_excess_tick"])
        for name in RIVAL_NAMES:
            figures[f"cost_error_{name}"] = max(
                series[f"cost_error_{name}"], key=abs, default=None
            )
            figures[f"unsolved_{name}"] = self._unsolved[name]
        return figures

    def _middle(self, key: str) -> float | None:
        return statistics.median(self._series[key]) if self._series[key] else None

    def _by_rival(self, name: str, problem: Any) -> Answer:
        solver, began = self._rivals[name], time.process_time()
        status, moves, _, _ = solver.solve(problem, self._cold)
        cpu_s = time.process_time() - began
        return Answer(cpu_s, moves, solver.cost) if status is SolveStatus.OK else Answer(cpu_s)

    def _by_library(
        self, problem: Any, start: Vector, tolerances: tuple[float, ...] = ()
    ) -> Answer:
        times = []
        for _ in range(10):
            began, moves = time.thread_time(), start
            for tolerance in tolerances or (self._exact,):
                self._tuning.tolerance = tolerance
                status, moves, _, _ = solve(self._library, problem, moves)
            times.append(time.thread_time() - began)
            if status not in (SolveStatus.OK, SolveStatus.ITERATION_CAP):
                raise RuntimeError(
                    f"the library cannot solve a problem of the weld: {status.name}"
                )
        self._tuning.tolerance = self._exact
        return Answer(statistics.median(times), moves)

    def _cost_of(self, problem: Any, moves: Vector | None) -> float:
        outputs = predict(self._library, KERNEL.ffi.addressof(problem, "start"), moves)[:2]
        return objective(problem, self._tuning, self._horizon, moves, *outputs)

    def _beyond(self, problem: Any, moves: Vector) -> float:
        """By how much moves are beyond the limits, in largest moves."""
        largest = np.outer(self._horizon.block_reach, largest_moves(self._tuning)).ravel()
        low, high = input_bounds(problem, self._tuning, self._horizon)
        reached = cumulation(self._horizon) @ moves
        return float(np.max([np.abs(moves) - largest, reached - high, low - reached] / largest))


def ratios(quick: bool) -> _benchmark.Figures:
    """The same problems by other solvers, with 54 moves of both inputs."""
    controller = make(preset="paper")
    problems = problems_of_weld(controller, quick)
    comparison = Comparison(controller)
    for i, (problem, start) in enumerate(problems):
        costs = comparison.compare(problem, start)
        print(f"  problem {i + 1} of {len(problems)}: {costs}", file=sys.stderr, flush=True)
    figures = comparison.figures() | limits_of_fatrop(
        controller, [problem for problem, _ in problems]
    )
    return {"ratio_problems": len(problems)} | figures


def limits_of_fatrop(controller: NmpcController, problems: list[Any]) -> _benchmark.Figures:
    """Medians of FATROP on the problems in stages, with the tolerance of IPOPT, without stages."""
    library, model = controller.library, controller.settings.model
    cold = np.zeros(2 * library.horizon.n_blocks)
    ways: dict[str, ReferenceSolver | FatropSolver] = {
        "staged": FatropSolver(library, model),
        "strict": FatropSolver(library, model, tolerance=1e-8),
        "unstaged": ReferenceSolver(library, model, method="fatrop", options=UNSTAGED_FATROP),
    }
    figures: _benchmark.Figures = {}
    for name, solver in ways.items():
        iterations, cpu_s, unsolved = [], [], 0
        for problem in problems:
            began = time.process_time()
            unsolved += solver.solve(problem, cold)[0] is not SolveStatus.OK
            cpu_s.append(time.process_time() - began)
            iterations.append(solver.iterations)
        figures |= {
            f"fatrop_{name}_s": statistics.median(cpu_s),
            f"fatrop_{name}_iterations": statistics.median(iterations),
            f"fatrop_{name}_unsolved": unsolved,
        }
    return figures


def against_converged(quick: bool) -> _benchmark.Figures:
    """Closed loop of the library against the converged nonlinear problem (IPOPT, cold)."""

    def iae(rows: Vector, column: int) -> float:
        return float(0.1 * np.abs(rows[:, column] - rows[:, column + 2]).sum())

    figures: _benchmark.Figures = {}
    for preset, ending, duration_s in (("default", "", 120.0), ("paper", "_paper", 60.0)):
        length_s = duration_s / (10 if quick else 1)

        def reference(t: float, length_s: float = length_s) -> Reference:
            return reference_at(t, WELD_S / length_s)

        own, _ = close_loop(make(preset=preset), reference, length_s)
        converged = make(preset=preset)
        use_solver(converged, ReferenceSolver(converged.library, nominal()))
        best, _ = close_loop(converged, reference, length_s)
        figures |= {
            f"iae_depth_vs_nlp{ending}": iae(own, 1) / iae(best, 1) - 1.0,
            f"iae_temperature_vs_nlp{ending}": iae(own, 2) / iae(best, 2) - 1.0,
            f"largest_depth_difference_um{ending}": 1e3
            * float(np.abs(own[:, 1] - best[:, 1]).max()),
            f"largest_temperature_difference_c{ending}": float(
                np.abs(own[:, 2] - best[:, 2]).max()
            ),
            f"nlp_failures{ending}": converged.library.output.bad_cycles,
        }
    return figures


if __name__ == "__main__":
    sys.exit(main())
