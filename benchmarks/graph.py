#!/usr/bin/env python3
"""Ticks per second: the whole graph in lockstep (processes over DDS) and the closed loop in one process.

usage: graph.py [--quick] [--json FILE]
"""

import os
import platform
import statistics
import sys
import tempfile
import time
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent / "scripts"))

if __name__ == "__main__":
    from _bootstrap import ensure

    ensure()

from report import parser, save, show

from fsw_control.free_domain import free_domain
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make
from fsw_scenario.graph import WeldGraph
from fsw_scenario.launcher import Launcher
from fsw_scenario.scenario_file import load

AIMS = {"offline_steps_per_s": 20_000, "graph_steps_per_s": 300}


def offline_steps_per_s(name, repetitions):
    """Best of several runs of plant emulator and decentralized controller in this process."""
    rates = []
    for _ in range(repetitions):
        loop = ClosedLoop(load(name), {"decentral": make("decentral")})
        began = time.perf_counter()
        loop.run()
        rates.append(loop.scenario.n_ticks / (time.perf_counter() - began))
    return max(rates)


def graph_steps_per_s(name, controllers, repetitions):
    """Ticks per second and seconds from start to first tick; medians of several runs of the whole graph."""
    rates, starts = [], []
    for _ in range(repetitions):
        scenario = load(name)
        with (
            tempfile.TemporaryDirectory() as folder,
            free_domain() as domain,
            Launcher(Path(folder) / "log", domain) as launcher,
        ):
            began = time.perf_counter()
            elapsed_s = WeldGraph(scenario, Path(folder) / "weld", controllers).run(launcher)
            starts.append(time.perf_counter() - began - elapsed_s)
        rates.append(scenario.n_ticks / elapsed_s)
    return statistics.median(rates), statistics.median(starts)


def main():
    """Measure, print a table, write JSON."""
    arguments = parser(__doc__, "shorter scenario, fewer repetitions").parse_args()
    name, repetitions = ("quick", 1) if arguments.quick else ("reference_tracking", 3)
    result = {"scenario": name, "repetitions": repetitions, "cpus": os.cpu_count(), "python": platform.python_version()}
    result["offline_steps_per_s"] = offline_steps_per_s(name, 3 * repetitions)
    result["graph_steps_per_s"], result["graph_start_and_stop_s"] = graph_steps_per_s(name, (), repetitions)
    result["graph_with_nmpc_steps_per_s"], _ = graph_steps_per_s(name, ("nmpc",), repetitions)
    show(result, AIMS)
    save(result, arguments.json)


if __name__ == "__main__":
    main()
