#!/usr/bin/env python3
"""What the graph of processes costs: ticks per second in lockstep, and at 10 Hz delay, processor, memory and start.

usage: graph.py [--quick] [--json FILE]

The delay is from the last sensor of a tick to its command, by the times of their publication in
the bag.
"""

import os
import platform
import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent / "scripts"))

if __name__ == "__main__":
    from _bootstrap import ensure

    ensure()

import numpy as np
import rclpy
from processes import memory_mib, processor_s
from report import parser, save, show

from fsw_analysis.messages import SENSOR_TOPICS
from fsw_control.fast_dds import stay_on_this_machine
from fsw_control.free_domain import free_domain
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.weld_clock import stamp_ns
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make
from fsw_scenario.graph import WeldGraph
from fsw_scenario.launcher import Launcher
from fsw_scenario.scenario_file import load

AIMS = {"offline_steps_per_s": 20_000, "graph_with_nmpc_steps_per_s": 200}
SENSORS = set(SENSOR_TOPICS.values())
#: of nodes whose start is timed by itself
NODES = ("plant", "decentral", "nmpc", "supervisor", "recorder")


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


def ten_hertz(name):
    """Eight nodes at 10 Hz: time to the first tick, delay of the commands, processor and memory of each node."""
    with (
        tempfile.TemporaryDirectory() as folder,
        free_domain() as domain,
        Launcher(Path(folder) / "log", domain) as launcher,
    ):
        place, controllers = Path(folder) / "weld", ("nmpc", "decentral")
        graph = WeldGraph(
            load(name), place, controllers, True, standby=True, companions=["monitor"]
        )
        began_s, spent = time.perf_counter(), []

        def note(_):
            pids = {
                name: child.process.pid
                for name, child in launcher.children.items()
                if child.running
            }
            used = {name: (processor_s(pid), memory_mib(pid)) for name, pid in pids.items()}
            spent.append((time.perf_counter(), used))

        graph.run(launcher, note)
        (first_s, first), (last_s, last) = (
            spent[0],
            next(row for row in reversed(spent) if "scenario" in row[1]),
        )
        figures = {"nodes": len(first), "start_of_graph_s": first_s - began_s} | delays_ms(
            graph.bag
        )
        for node in first:
            cpu_s = last[node][0] - first[node][0]
            figures[f"{node}_cpu_percent"] = 100.0 * cpu_s / (last_s - first_s)
            figures[f"{node}_mib"] = max(used[node][1] for _, used in spent if node in used)
        return figures


def delays_ms(bag):
    """From the last sensor of a tick to its command."""
    sensed, answered = {}, {}
    with BagReader(bag) as reader:
        for record in reader.records():
            stamp = stamp_ns(record.data)
            if record.topic in SENSORS:
                sensed[stamp] = max(sensed.get(stamp, 0), record.publish_time_ns)
            elif record.topic == "/fsw/command":
                answered.setdefault(stamp, record.publish_time_ns)
    delays = [(answered[stamp] - sensed[stamp]) * 1e-6 for stamp in answered if stamp in sensed]
    return {f"delay_p{share}_ms": float(np.percentile(delays, share)) for share in (50, 99, 100)}


def starts_s(repetitions):
    """Seconds from the start of a process until its node is seen in the graph; medians."""
    figures = {}
    with (
        tempfile.TemporaryDirectory() as folder,
        free_domain() as domain,
        Launcher(Path(folder), domain) as launcher,
    ):
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        stay_on_this_machine(os.environ)
        rclpy.init(args=[])
        observer = rclpy.create_node("observer")
        for program in NODES:
            node = f"fsw_{program}"
            bag = ["--ros-args", "-p", f"output:={folder}/bag"] if node == "fsw_recorder" else []
            times = []
            for _ in range(repetitions):
                began_s = time.perf_counter()
                launcher.start(node, program, bag)
                launcher.wait_until(
                    lambda name=node: name in observer.get_node_names(), 60.0, node, [node]
                )
                times.append(time.perf_counter() - began_s)
                launcher.stop(node)
                shutil.rmtree(f"{folder}/bag", ignore_errors=True)
                launcher.wait_until(
                    lambda name=node: name not in observer.get_node_names(), 60.0, node, []
                )
            figures[f"start_of_{node}_s"] = statistics.median(times)
        observer.destroy_node()
        rclpy.shutdown()
    return figures


def main():
    """Measure, print a table, write JSON."""
    arguments = parser(__doc__, "shorter scenario, fewer repetitions").parse_args()
    name, repetitions = ("quick", 1) if arguments.quick else ("reference_tracking", 3)
    result = {
        "scenario": name,
        "repetitions": repetitions,
        "cpus": os.cpu_count(),
        "python": platform.python_version(),
    }
    result["offline_steps_per_s"] = offline_steps_per_s(name, 3 * repetitions)
    result["graph_steps_per_s"], result["graph_start_and_stop_s"] = graph_steps_per_s(
        name, (), repetitions
    )
    result["graph_with_nmpc_steps_per_s"], _ = graph_steps_per_s(name, ("nmpc",), repetitions)
    result |= starts_s(repetitions) | ten_hertz("quick")
    show(result, AIMS)
    save(result, arguments.json)


if __name__ == "__main__":
    main()
