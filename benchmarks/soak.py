#!/usr/bin/env python3
"""A whole weld in real time, by default all 45 minutes of it: memory of every process, lost ticks, and the bag.

usage: soak.py [--quick] [--json FILE] [--out FOLDER]
"""

from __future__ import annotations

import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent / "scripts"))

if __name__ == "__main__":
    from _bootstrap import ensure

    ensure(extras=("hmi",))

import numpy as np
from processes import memory_mib
from report import Figures, parser, save, show

from fsw.console import ProgressBar
from fsw_analysis.signals import load_weld
from fsw_control.free_domain import free_domain
from fsw_control.weld import TICK_S
from fsw_scenario.graph import WeldGraph
from fsw_scenario.launcher import Launcher
from fsw_scenario.scenario_file import load

EVERY_S = 10.0
#: memory is compared from here on, as a share of the weld; before, caches fill
SETTLED = 0.2


class Memory:
    """Memory of all processes of a launcher, every ten seconds."""

    def __init__(self, launcher: Launcher, bar: ProgressBar) -> None:
        self._launcher, self._bar = launcher, bar
        self._next_s = time.monotonic()
        self.samples: dict[str, list[tuple[float, float]]] = {}

    def __call__(self, share: float) -> None:
        """Look, if it is time; ``share`` of the weld is done."""
        self._bar(share)
        now_s = time.monotonic()
        if now_s < self._next_s or share >= 1.0:
            return
        self._next_s = now_s + EVERY_S
        for name, child in self._launcher.children.items():
            if child.running:
                self.samples.setdefault(name, []).append((now_s, memory_mib(child.process.pid)))

    def figures(self) -> Figures:
        """First and last sample of each process after it has settled, and the slope of a line through all between."""
        result: Figures = {}
        for name, samples in self.samples.items():
            time_s, used_mb = np.array(samples[int(SETTLED * len(samples)) :]).T
            result[f"{name}_memory_first_mb"] = float(used_mb[0])
            result[f"{name}_memory_last_mb"] = float(used_mb[-1])
            slope = (
                float(np.polyfit(time_s - time_s[0], used_mb, 1)[0]) if time_s.size > 2 else None
            )
            result[f"{name}_memory_slope_mb_per_min"] = None if slope is None else 60.0 * slope
        return result


def weld(scenario: str, folder: Path) -> Figures:
    """Run a scenario in real time: both controllers, the NMPC commands, a standby supervisor, and the page."""
    chosen = load(scenario, ["controller=nmpc"])
    graph = WeldGraph(chosen, folder, ("decentral",), realtime=True, standby=True)
    with ExitStack() as stack:
        bar = stack.enter_context(ProgressBar(scenario))
        launcher = stack.enter_context(
            Launcher(folder / "log", stack.enter_context(free_domain()))
        )
        launcher.start("hmi", "fsw_hmi.main", ["--port", "0"])
        memory = Memory(launcher, bar)
        took_s = graph.run(launcher, memory)
    signals = load_weld(graph.bag)
    source = signals.command_source
    ticks = 1 + np.rint(
        np.diff(signals.stamp_ns, prepend=signals.stamp_ns[0]).cumsum() * 1e-9 / TICK_S
    ).astype(int)
    lost = int(ticks[-1] - ticks.size)
    latency_ms = 1e3 * signals.command_latency_s[np.isfinite(signals.command_latency_s)]
    return {
        "duration_s": took_s,
        "ticks": int(ticks.size),
        "ticks_lost": lost,
        "ticks_on_hold": int(np.sum(source[:-1] == "hold")),  # the last may end with the weld
        "ticks_without_command": int(np.sum(source[:-1] == "")),
        "ticks_late": int(np.sum(latency_ms > 80.0)),
        "changes_of_source": int(np.sum(source[1:-1] != source[:-2])),
        "latency_p50_ms": float(np.percentile(latency_ms, 50)),
        "latency_p99_ms": float(np.percentile(latency_ms, 99)),
        "latency_max_ms": float(latency_ms.max()),
        "bag_problems": len(signals.problems),
        "bag_mb": sum(file.stat().st_size for file in graph.bag.rglob("*") if file.is_file())
        / 1e6,
        **memory.figures(),
    }


def main() -> int:
    """Run the benchmark; returns the exit code."""
    command = parser(__doc__, "a weld of 240 s instead of the whole one")
    command.add_argument(
        "--out", type=Path, help="keep bag and logs in this folder, which must not exist"
    )
    arguments = command.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = arguments.out or Path(scratch) / "weld"
        folder.mkdir(parents=True)
        figures = weld("reference_tracking" if arguments.quick else "canister_weld", folder)
    show(figures)
    save(figures, arguments.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
