r"""Exported controllers on other processors: equal answers, memory, stack, instructions per step.

Every controller is exported (``fsw.py export c``), built by its own CMakeLists.txt and run on its
test vectors, a weld of 240 s, where compiler and emulator are installed:

    apt-get install cmake clang gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm qemu-user
    \
        gcc-arm-linux-gnueabihf libc6-dev-armhf-cross gcc-powerpc-linux-gnu libc6-dev-powerpc-cross

QEMU counts instructions, not cycles.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import _benchmark
import numpy as np

from fsw.main import main as fsw
from fsw_export.targets import results_page
from fsw_test_support import c_targets

ROOT = Path(__file__).resolve().parent.parent
PUBLISHED = ROOT / "lab" / "fsw_export" / "fsw_export" / "targets.json"
PAGE = ROOT / "docs" / "results" / "targets.md"
ALL = tuple(c_targets.TARGETS)
#: exports: name, arguments, prefix of the library's functions, targets (108 moves take long under
#: emulation)
EXPORTS: dict[str, tuple[list[str], str, tuple[str, ...]]] = {
    "nmpc": ([], "fsw_nmpc", ALL),
    "nmpc_paper": (["--parameter", "preset=paper"], "fsw_nmpc", ("gcc", "cortex_m7")),
    "decentral": (["--controller", "decentral"], "fsw_decentral", ALL),
}


def exported(name: str, scratch: Path, quick: bool) -> dict[str, Any]:
    """All figures of one export, by target."""
    arguments, prefix, targets = EXPORTS[name]
    folder = scratch / name
    if fsw(["export", "c", *arguments, "--out", str(folder)]):
        sys.exit(1)
    figures: dict[str, Any] = {}
    for key in targets:
        target = c_targets.TARGETS[key]
        if quick and key not in ("gcc", "cortex_m7"):
            continue
        missing = target.missing()
        if missing:
            print(f"{target.title}: left out: {missing}", file=sys.stderr)
            continue
        print(f"{name}: {target.title}", file=sys.stderr)
        built = scratch / f"{name}-{key}"
        options = ["-DFSW_STACK_USAGE=1", "-DFSW_COUNTER=1"] if target.counts else []
        c_targets.build(folder, target, built, *options)
        c_targets.run_vectors(folder, built)
        own = figures[key] = {
            "title": target.title,
            "largest_difference": c_targets.largest_difference(folder, built),
        }
        if not target.counts:
            continue
        counts, iterations = c_targets.instructions(folder, built)
        own["instructions_p50"] = int(np.median(counts))
        own["instructions_p99"] = int(np.percentile(counts, 99))
        own["instructions_max"] = int(counts.max())
        if iterations.any():
            own["iterations_max"] = int(iterations.max())
            slope, base = np.polyfit(iterations, counts, 1)
            own["instructions_per_iteration"], own["instructions_without"] = (
                int(slope),
                int(base),
            )
        own["flash_bytes"], own["static_bytes"] = c_targets.sizes(built)
        own["state_bytes"] = c_targets.state_bytes(built)
        own["stack_bytes"] = c_targets.stack_bytes(built, f"{prefix}_step")
    return figures


def measure(quick: bool, publish: bool) -> tuple[_benchmark.Figures, _benchmark.Figures]:
    """Figures of all exports; writes what is shipped, if asked to."""
    with tempfile.TemporaryDirectory() as scratch:
        exports = {name: exported(name, Path(scratch), quick) for name in EXPORTS}
    if publish:
        PUBLISHED.write_text(json.dumps(exports, indent=2) + "\n", encoding="utf-8")
        PAGE.write_text(results_page(exports), encoding="utf-8")
        print(f"wrote {PUBLISHED.relative_to(ROOT)} and {PAGE.relative_to(ROOT)}", file=sys.stderr)
    return _benchmark.flat(exports, "."), {}


if __name__ == "__main__":
    what = "also write the shipped figures and docs/results"
    options = {"--publish": {"action": "store_true", "help": what}}
    _benchmark.run(__doc__, "Cortex-M7 only", measure, options=options)
