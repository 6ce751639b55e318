#!/usr/bin/env python3
"""What the graph of processes costs.

Ticks per second in lockstep, and at 10 Hz delay, processor, memory and start.

usage: graph.py [--quick] [--whole-weld] [--json FILE] [--out FOLDER]

``--whole-weld`` is the soak test: 45 minutes in real time, with the growth of every process. The
delay is from a tick's measurement to its command, as the bag has it.
"""

import os
import platform
import statistics
import tempfile
import time
from pathlib import Path

import _benchmark
import numpy as np

from fsw.console import ProgressBar
from fsw_analysis.signals import load_weld
from fsw_control.free_domain import free_domain
from fsw_control.weld import TICK_S
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make
from fsw_scenario.graph import WeldGraph
from fsw_scenario.launcher import Launcher
from fsw_scenario.scenario_file import load

AIMS = {"offline_steps_per_s": 20_000, "graph_with_nmpc_steps_per_s": 200}
#: between two looks at the processes
EVERY_S = 2.0
#: memory is judged from here on, as a share of the weld; before, caches fill
SETTLED = 0.2


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
    """Ticks per second and seconds from start to first tick.

    Medians of several runs of the whole graph.
    """
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


def ten_hertz(name, folder, with_page=False):
    """All nodes at 10 Hz.

    Start, lost ticks, delay of the commands, processor and memory of each node.
    """
    graph = WeldGraph(
        load(name, ["controller=nmpc"]),
        folder,
        ("decentral",),
        realtime=True,
        standby=True,
        companions=["monitor"],
    )
    began_s, samples = time.perf_counter(), []
    with (
        free_domain() as domain,
        Launcher(folder / "log", domain) as launcher,
        ProgressBar(name) as bar,
    ):

        def note(share):
            bar(share)
            now_s = time.perf_counter()
            if not samples or now_s >= samples[-1][0] + EVERY_S:
                running = {
                    name: child for name, child in launcher.children.items() if child.running
                }
                pids = {name: child.process.pid for name, child in running.items()}
                used = {
                    name: (_benchmark.processor_s(pid), _benchmark.memory_mib(pid))
                    for name, pid in pids.items()
                }
                samples.append((now_s, used))

        if with_page:
            launcher.start("hmi", "fsw_hmi.main", ["--port", "0"])
        graph.run(launcher, note)
    figures = {"nodes": len(samples[0][1]), "start_of_graph_s": samples[0][0] - began_s}
    return figures | ticks_of(load_weld(graph.bag)) | used_by(samples)


def ticks_of(weld):
    """What came of the ticks of a weld."""
    source, latency_ms = weld.command_source[:-1], 1e3 * weld.command_latency_s
    known = latency_ms[np.isfinite(latency_ms)]
    expected = 1 + round((weld.stamp_ns[-1] - weld.stamp_ns[0]) * 1e-9 / TICK_S)
    return {
        "ticks": weld.n_ticks,
        "ticks_lost": expected - weld.n_ticks,
        "ticks_on_hold": int(np.sum(source == "hold")),
        "ticks_without_command": int(np.sum(source == "")),
        "ticks_late": int(np.sum(known > 80.0)),
        "changes_of_source": int(np.sum(source[1:] != source[:-1])),
        "bag_problems": len(weld.problems),
        **{f"delay_p{share}_ms": float(np.percentile(known, share)) for share in (50, 99, 100)},
    }


def used_by(samples):
    """Processor and memory of each process that ran from the first sample to nearly the last.

    The growth of the memory is the slope of a line through what follows once caches are filled.
    """
    figures = {}
    for name in samples[0][1]:
        times_s, cpu_s, mib = np.array(
            [(at_s, *used[name]) for at_s, used in samples if name in used]
        ).T
        settled = slice(int(SETTLED * times_s.size), None)
        figures[f"{name}_cpu_percent"] = 100.0 * np.ptp(cpu_s) / np.ptp(times_s)
        figures[f"{name}_mib"] = mib.max()
        figures[f"{name}_growth_mib_per_min"] = (
            60.0 * np.polyfit(times_s[settled] - times_s[-1], mib[settled], 1)[0]
        )
    return {name: float(value) for name, value in figures.items()}


def measure(quick, whole_weld, out):
    """Figures of the graph."""
    name, repetitions = ("quick", 1) if quick else ("reference_tracking", 3)
    with tempfile.TemporaryDirectory() as scratch:
        folder = out or Path(scratch) / "weld"
        folder.mkdir(parents=True)
        if whole_weld:
            name = "reference_tracking" if quick else "canister_weld"
            return ten_hertz(name, folder, with_page=True), {}
        figures = {
            "scenario": name,
            "repetitions": repetitions,
            "cpus": os.cpu_count(),
            "python": platform.python_version(),
            "offline_steps_per_s": offline_steps_per_s(name, 3 * repetitions),
        }
        for words, controllers in (("graph", ()), ("graph_with_nmpc", ("nmpc",))):
            rate, start_s = graph_steps_per_s(name, controllers, repetitions)
            figures |= {f"{words}_steps_per_s": rate, f"{words}_start_and_stop_s": start_s}
        return figures | ten_hertz("quick", folder), {}


if __name__ == "__main__":
    whole = "instead, 45 minutes in real time with the operator's page"
    options = {
        "--whole-weld": {"action": "store_true", "help": whole},
        "--out": {"type": Path, "help": "keep bag and logs in this new folder"},
    }
    quick = "shorter scenario, fewer repetitions"
    _benchmark.run(__doc__, quick, measure, options=options, aims=AIMS)
