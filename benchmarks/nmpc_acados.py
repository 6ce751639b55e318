#!/usr/bin/env python3
"""Measures acados' SQP-RTI on the NMPC's horizon beside the library's solver, in closed loop.

    python3 benchmarks/nmpc_acados.py [--quick] [--json FILE]

Preset ``default``, sensor noise, the weld of nmpc.py. In every tick both solve the same problem
from the same last plan, with the same blocks of moves, cost and limits; the plan of one is
applied. ``NAME_preparation_ms`` linearises and condenses, ``NAME_feedback_ms`` solves the QP, with
``_p99``: the 99th percentile; ``own_ms`` is the library's, all together. Times are CPU times; what
brings acados the problem's numbers and the last plan's states is not counted. ``move_difference``
is the largest between the first moves of both, in largest moves. The exit code is 1 if a loop
needed a fallback, or 3 if acados is not available here.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import _benchmark
import numpy as np
from nmpc import WELD_S, close_loop, make, reference_at

from fsw_nmpc.library import Library, SolveStatus, Vector
from fsw_test_support.nmpc_acados import Acados, AcadosSolver, install
from fsw_test_support.nmpc_ipopt import largest_moves
from fsw_test_support.nmpc_problems import solve, use_solver
from fsw_test_support.nmpc_stages import Stages

#: QP solvers of acados by the names of their figures, and stages after partial condensing; the
#: first one is applied
QPS = {
    "hpipm": ("full condensing, HPIPM", 0),
    "partial": ("partial condensing, HPIPM", 5),
    "qpoases": ("full condensing, qpOASES", 0),
}
_TICKS_LEFT_OUT = 10


class SideBySide:
    """Solves each problem by the library and by acados; returns the solution of ``applied``."""

    name = "side by side"

    def __init__(self, library: Library, rivals: dict[str, AcadosSolver], applied: str) -> None:
        self._library, self._rivals, self._applied = library, rivals, applied
        self._largest = np.array(largest_moves(library.state.tuning))
        self.own_s: list[float] = []
        self.difference = dict.fromkeys(rivals, 0.0)
        self.unsolved = dict.fromkeys(rivals, 0)

    def solve(self, problem: Any, moves: Vector) -> tuple[int, Vector, Vector, Vector]:
        """As the library's own."""
        began = time.thread_time()
        own = solve(self._library, problem, moves)
        self.own_s.append(time.thread_time() - began)
        answers = {"own": own}
        for name, rival in self._rivals.items():
            answer = answers[name] = rival.solve(problem, moves)
            if answer[0] is not SolveStatus.OK:
                self.unsolved[name] += 1
                continue
            off = np.abs(answer[1] - own[1])[:2] / self._largest
            self.difference[name] = max(self.difference[name], float(off.max()))
        return answers[self._applied]


def compare(acados: Acados, quick: bool) -> _benchmark.Figures:
    """Two closed loops: with the library's plans applied, and with acados'."""
    figures: _benchmark.Figures = {}
    duration_s = WELD_S / 8 if quick else WELD_S
    compiled = None
    for applied in ("own", "hpipm"):
        controller = make()
        library, model = controller.library, controller.settings.model
        if compiled is None:
            compiled = acados.compiled(Stages(library, model))
        rivals = {
            name: AcadosSolver(acados, compiled, library, model, *qp) for name, qp in QPS.items()
        }
        solver = SideBySide(library, rivals, applied)
        use_solver(controller, solver)
        rows, _ = close_loop(
            controller, lambda t: reference_at(t, WELD_S / duration_s), duration_s, noise=1.0
        )
        for what, column in (("depth_mm_s", 1), ("temperature_c_s", 2)):
            figures[f"{applied}_iae_{what}"] = 0.1 * float(
                np.abs(rows[:, column] - rows[:, column + 2]).sum()
            )
        figures[f"{applied}_fallbacks"] = library.output.bad_cycles
    figures |= of_times("own", solver.own_s)
    for name, rival in rivals.items():
        phases = rival.preparation_s, rival.feedback_s
        figures |= of_times(f"{name}_preparation", phases[0])
        figures |= of_times(f"{name}_feedback", phases[1])
        both = [sum(pair) for pair in zip(*phases, strict=True)]
        figures |= of_times(name, both)
        ratios = np.array(both) / np.array(solver.own_s)
        figures[f"{name}_ratio"] = float(np.median(ratios[_TICKS_LEFT_OUT:]))
        figures[f"{name}_move_difference"] = solver.difference[name]
        figures[f"{name}_unsolved"] = solver.unsolved[name]
    return figures | {"ticks": len(solver.own_s)}


def of_times(name: str, times_s: list[float]) -> _benchmark.Figures:
    """Median and 99th percentile."""
    times_ms = 1e3 * np.array(times_s[_TICKS_LEFT_OUT:])
    return {
        f"{name}_ms": float(np.median(times_ms)),
        f"{name}_p99_ms": float(np.quantile(times_ms, 0.99)),
    }


def measure(quick: bool) -> tuple[_benchmark.Figures, _benchmark.Figures]:
    """Figures of both loops; exit code 3 where there is no acados."""
    folder = install()
    if isinstance(folder, str):
        print(f"acados not measured: {folder}", file=sys.stderr)
        sys.exit(3)
    return compare(Acados(folder), quick), {}


def main() -> int:
    """Run the comparison; returns the exit code."""
    figures = _benchmark.run(__doc__, "half a minute of weld instead of four", measure)
    return int(any(value for name, value in figures.items() if name.endswith("_fallbacks")))


if __name__ == "__main__":
    sys.exit(main())
