#!/usr/bin/env python3
"""Shows what a cold solve of the NMPC's 108-move problem spends its time on: a part is done ten times more, and timed.

    python3 benchmarks/nmpc_profile.py [--quick] [--json FILE]

The problems and tolerances are those of ``ratio_NAME`` in ``nmpc.py``. The library is compiled
from changed copies of its sources; the installed one stays as it is.
"""

from __future__ import annotations

import shutil
import statistics
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent / "scripts"))

if __name__ == "__main__":
    from _bootstrap import ensure

    ensure()

import numpy as np
from nmpc import COLD_TOLERANCES, make, problems_of_weld
from report import parser, save, show

from fsw_nmpc.library import KERNEL, Library, tuning_of
from fsw_test_support.nmpc_problems import solve

MORE = 10
ASSEMBLE, CHOLESKY = (
    "assemble(w);",
    "cholesky(w->scratch.matrices.factor, w->per_diagonal, w->nv);",
)
PREDICT = "fsw_predict_into(m, &problem->start, v, w);"
#: Which file is changed, before which text, and what is done more often there.
PARTS = {
    "normal matrix": ("factor.c", f"  {ASSEMBLE}\n", ASSEMBLE),
    "normal matrix and Cholesky factor": ("factor.c", f"  {ASSEMBLE}\n", f"{ASSEMBLE} {CHOLESKY}"),
    "prediction with sensitivities": ("solve.c", "  if (fsw_predict_into(", PREDICT),
}


def main() -> int:
    """Run the profile; returns the exit code."""
    options = parser(__doc__, "fewer problems").parse_args()
    controller = make(preset="paper")
    problems = problems_of_weld(controller, options.quick)
    horizon, settings = controller.library.horizon, controller.settings

    def solve_ms(library: Library) -> tuple[float, float]:
        """Median time and iterations of a problem, each the best of several tries."""
        times, iterations = [], []
        for problem, _ in problems:
            tries = []
            for _ in range(15):
                moves, count, began = np.zeros(2 * horizon.n_blocks), 0, time.thread_time()
                for library.state.tuning.tolerance in COLD_TOLERANCES:
                    _, moves, _, _ = solve(library, problem, moves)
                    count += library.output.iterations
                tries.append(time.thread_time() - began)
            times.append(1e3 * min(tries))
            iterations.append(count)
        return statistics.median(times), statistics.median(iterations)

    def changed(part: str | None) -> Library:
        with tempfile.TemporaryDirectory() as scratch:
            sources = Path(scratch) / "kernel"
            shutil.copytree(KERNEL.folder, sources)
            if part is not None:
                name, before, work = PARTS[part]
                text = (sources / name).read_text(encoding="utf-8")
                more = f"  for (int more = 0; more < {MORE}; more++) {{ {work} }}\n"
                (sources / name).write_text(text.replace(before, more + before), encoding="utf-8")
            built = replace(KERNEL, folder=sources).build(Path(scratch) / "kernel.so")
            return Library(
                settings.model, horizon, tuning_of(settings), KERNEL.ffi.dlopen(str(built))
            )

    whole_ms, iterations = solve_ms(changed(None))
    share = {part: (solve_ms(changed(part))[0] / whole_ms - 1.0) / MORE for part in PARTS}
    share["Cholesky factor"] = (
        share.pop("normal matrix and Cholesky factor") - share["normal matrix"]
    )
    share["everything else"] = 1.0 - sum(share.values())
    figures = {
        "solve_ms": whole_ms,
        "linearisations": len(COLD_TOLERANCES),
        "iterations": iterations,
    }
    figures |= {f"share of {part}": value for part, value in share.items()}
    show(figures)
    save(figures, options.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
