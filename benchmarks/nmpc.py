#!/usr/bin/env python3
"""Measures the NMPC: CPU time per controller step, quality against the converged problem, worst cases, memory.

    python3 benchmarks/nmpc.py [--quick] [--json FILE]

Times are CPU times of the controller's thread for a whole step: estimator, corridors, solver, acceptance, plan.
GEKKO and do-mpc are compared where they are installed (.venv/bin/pip install gekko do-mpc); nothing else needs them.
Ratios are CPU times of a solve (with its processes) over that of the kernel with all 108 moves; those that end on
``_to_default`` over that of the kernel with 20 blocks.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "scripts"))

from _bootstrap import ensure

Figures = dict[str, float | int | None]
#: two steps of the depth and two of the temperature
EVENTS = ((20.0, 2.86, 850.0), (70.0, 2.66, 850.0), (130.0, 2.66, 860.0), (180.0, 2.66, 850.0))


def main() -> int:
    """Run all measurements; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="shorter runs: minutes become seconds")
    parser.add_argument("--json", metavar="FILE", help="write the figures as flat JSON")
    options = parser.parse_args()
    figures: Figures = {}
    for part in (step_times, ratios, worst_cases, against_converged):
        print(f"{part.__doc__.splitlines()[0]} ...", file=sys.stderr, flush=True)
        figures |= part(options.quick)
        if options.json:
            Path(options.json).write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    width = max(map(len, figures))
    for name, value in figures.items():
        print(f"{name:<{width}}  {'-' if value is None else f'{value:.4g}'}")
    return 0


def reference_at(time_s: float, compressed: float = 1.0):
    """Set-points of the scenario; ``compressed`` runs it faster."""
    from fsw_control import Reference

    now = Reference(2.66, 850.0)
    for at_s, depth_mm, temperature_c in EVENTS:
        if time_s * compressed >= at_s:
            now = Reference(depth_mm, temperature_c)
    return now


def close_loop(controller, reference: Callable, duration_s: float, noise: float = 0.0):
    """Run controller and process; returns rows (t, depth, temperature, set-points) and CPU seconds per step."""
    import numpy as np

    from fsw_control import Command, Measurement
    from fsw_model import ProcessModel

    model, rng = ProcessModel(), np.random.default_rng(1)
    rest = model.equilibrium()
    state, applied = rest.state.copy(), Command(rest.force_kn, rest.speed_rpm)
    rows, cpu_s = [], []
    for k in range(round(10 * duration_s)):
        shown = model.outputs(state, applied.force_kn, applied.speed_rpm)
        n = noise * rng.normal(size=3)
        target = reference(0.1 * k)
        measurement = Measurement(
            0.1 * k,
            shown.depth_mm + 2e-3 * n[0],
            shown.motor_torque_nm + 2.0 * n[1],
            shown.temperature_c + 0.1 * n[2],
        )
        began = time.thread_time()
        proposal = controller.step(measurement, target, applied, 0.1)
        cpu_s.append(time.thread_time() - began)
        rows.append((0.1 * k, shown.depth_mm, shown.temperature_c, target.depth_mm, target.temperature_c))
        applied = proposal.command
        model.step(state, applied.force_kn, applied.speed_rpm)
    return np.array(rows), np.array(cpu_s)


def make(kind: str, blocks: int, iterations: int = 50):
    """A controller with the default tuning."""
    from fsw_model import nominal
    from fsw_nmpc.controller import NmpcController
    from fsw_nmpc.solvers.choice import make_solver

    return NmpcController(make_solver(kind, nominal(), blocks, iterations)[0], nominal())


def step_times(quick: bool) -> Figures:
    """CPU time per step in closed loop, with sensor noise"""
    import numpy as np

    figures: Figures = {}
    for name, kind, blocks, duration_s in (
        ("rti", "rti", 20, 240.0),
        ("rti108", "rti", 54, 240.0),
        ("casadi", "casadi", 20, 60.0 if quick else 240.0),
    ):
        controller = make(kind, blocks)
        _, cpu_s = close_loop(controller, lambda t, d=duration_s: reference_at(t, 240.0 / d), duration_s, noise=1.0)
        cpu_ms = 1e3 * cpu_s[10:]
        figures[f"{name}_p50_ms"] = float(np.median(cpu_ms))
        figures[f"{name}_p99_ms"] = float(np.quantile(cpu_ms, 0.99))
        figures[f"{name}_max_ms"] = float(cpu_ms.max())
        figures[f"{name}_failures"] = controller.bad_cycles
    return figures


def cpu_now_s() -> float:
    """CPU time of this process and of those it has waited for: GEKKO's solvers are programs of their own."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def ratios(quick: bool) -> Figures:
    """The same problems by other solvers, cold, with 54 moves of both inputs"""
    import numpy as np
    from nmpc_rivals import rivals

    from fsw_model import nominal
    from fsw_nmpc.cases import random_problem
    from fsw_nmpc.horizon import horizon_of
    from fsw_nmpc.solvers.rti import RtiSolver
    from fsw_nmpc.tuning import Tuning

    p, rng = nominal(), np.random.default_rng(2)
    horizon = horizon_of(p, 54)
    rti = RtiSolver(p, horizon)
    problems = [random_problem(rng, horizon, p, Tuning.preset("paper")) for _ in range(5 if quick else 20)]

    def median_s(solve: Callable, some) -> float:
        times = []
        for problem in some:
            began = cpu_now_s()
            solve(problem)
            times.append(cpu_now_s() - began)
        return float(np.median(times))

    cold = np.zeros(108)
    own_s = median_s(lambda problem: rti.solve(problem, cold), problems * 10)
    default = RtiSolver(p, horizon_of(p, 20))
    default_s = median_s(lambda problem: default.solve(problem, cold[:40]), problems * 10)
    figures: Figures = {"solve_rti108_ms": 1e3 * own_s, "solve_rti_ms": 1e3 * default_s}
    for name, (count, solve) in rivals(p, horizon).items():
        if solve is None:
            figures[f"ratio_{name}"] = figures[f"ratio_{name}_to_default"] = None
            continue
        rival_s = median_s(solve, problems[: min(count, len(problems))])
        figures[f"solve_{name}_ms"] = 1e3 * rival_s
        figures[f"ratio_{name}"] = rival_s / own_s
        figures[f"ratio_{name}_to_default"] = rival_s / default_s
    return figures


def against_converged(quick: bool) -> Figures:
    """Closed loop of rti with all moves against the converged nonlinear problem (cold IPOPT at every tick)"""
    import numpy as np

    duration_s = 24.0 if quick else 240.0

    def reference(t: float):
        return reference_at(t, 240.0 / duration_s)

    own, _ = close_loop(make("rti", 54), reference, duration_s)
    best, _ = close_loop(make("reference", 54), reference, duration_s)

    def iae(rows, column: int) -> float:
        return float(0.1 * np.abs(rows[:, column] - rows[:, column + 2]).sum())

    return {
        "iae_depth_vs_nlp": iae(own, 1) / iae(best, 1) - 1.0,
        "iae_temperature_vs_nlp": iae(own, 2) / iae(best, 2) - 1.0,
        "largest_depth_difference_um": 1e3 * float(np.abs(own[:, 1] - best[:, 1]).max()),
        "largest_temperature_difference_c": float(np.abs(own[:, 2] - best[:, 2]).max()),
    }


def worst_cases(quick: bool) -> Figures:
    """Random states of the whole working range, and set-points out of reach"""
    import numpy as np

    from fsw_control import Reference
    from fsw_model import nominal
    from fsw_nmpc.cases import random_problem
    from fsw_nmpc.horizon import horizon_of
    from fsw_nmpc.solvers.rti import RtiSolver

    p, rng = nominal(), np.random.default_rng(3)
    horizon = horizon_of(p, 20)
    rti = RtiSolver(p, horizon)
    cold = np.zeros(40)
    iterations, cpu_s, unsolved = [], [], 0
    for _ in range(1_000 if quick else 100_000):
        problem = random_problem(rng, horizon, p)
        began = time.thread_time()
        solution = rti.solve(problem, cold)
        cpu_s.append(time.thread_time() - began)
        iterations.append(solution.iterations)
        unsolved += not solution.solved
    stress = make("rti", 20)
    close_loop(
        stress,
        lambda t: Reference(*((3.16, 910.0) if int(t / 25) % 2 else (2.16, 810.0))),
        60.0 if quick else 240.0,
        noise=1.0,
    )
    return {
        "random_states": len(iterations),
        "random_unsolved": unsolved,
        "random_worst_iterations": max(iterations),
        "random_worst_solve_ms": 1e3 * max(cpu_s),
        "random_p999_solve_ms": 1e3 * float(np.quantile(cpu_s, 0.999)),
        "stress_failures": stress.bad_cycles,
        "kernel_bytes": rti.kernel.workspace_bytes,
    }


if __name__ == "__main__":
    ensure()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(main())
