#!/usr/bin/env python3
"""How fast bags are written and read, and whether the recorder loses anything.

usage: recorder.py [--quick] [--json FILE]

Writes the messages of a made-up weld with the recorder's writer and with that of ``rosbags``;
records a publisher of 1,000 messages/s with the recorder as a process of
its own; reads the bag of a 45-minute weld. Every figure is of this run on this machine; compare
the columns with each other, not with other machines.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent / "scripts"))

if __name__ == "__main__":
    from _bootstrap import ensure

    ensure()

import numpy as np
import rclpy
from processes import processor_s
from rclpy.duration import Duration
from rclpy.serialization import serialize_message
from report import parser, save, show
from rosbags import rosbag2

from fsw_analysis.kpi import compute
from fsw_analysis.signals import load_weld
from fsw_control.fast_dds import stay_on_this_machine
from fsw_control.free_domain import free_domain
from fsw_msgs.msg import ShoulderDepth
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.bag_writer import BagWriter
from fsw_scenario.launcher import Launcher
from fsw_test_support.sample_weld import TOPICS, sample_messages, sample_topics, write_sample_weld

WELD_TICKS = 27_000
RATE_HZ = 1000
Messages = list[tuple[str, int, bytes]]


def talk(count: int) -> None:
    """Publish so many messages at the rate, in this process; prints for how long [s]."""
    stay_on_this_machine(os.environ)
    rclpy.init()
    node = rclpy.create_node("talker")
    publisher = node.create_publisher(ShoulderDepth, "/load", 1000)
    while publisher.get_subscription_count() == 0:
        rclpy.spin_once(node, timeout_sec=0.01)
    message = ShoulderDepth()
    message.header.frame_id = "tool"
    begin = time.monotonic()
    for index in range(count):
        while (wait := begin + index / RATE_HZ - time.monotonic()) > 0:
            time.sleep(wait)
        message.depth = float(index)
        publisher.publish(serialize_message(message))
    print(time.monotonic() - begin)
    publisher.wait_for_all_acked(Duration(seconds=10.0))  # what has not come by then is lost


def with_recorder(folder: Path, messages: Messages) -> list[float]:
    """Write with the recorder's writer; returns how long each hand-over took [s]."""
    taken: list[float] = []
    clock = time.perf_counter
    with BagWriter(folder) as writer:
        for topic in sample_topics():
            writer.add_topic(topic)
        for name, time_ns, data in messages:
            start = clock()
            writer.write(name, data, time_ns, time_ns)
            taken.append(clock() - start)
    statistics = writer.statistics()
    assert statistics["written"] == len(messages), statistics
    return taken


def with_rosbags(folder: Path, messages: Messages) -> None:
    """Write with the writer of ``rosbags``."""
    with rosbag2.Writer(folder, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
        connections = {
            topic.name: writer.add_connection(
                topic.name, topic.type_name, msgdef=topic.definition, rihs01=topic.type_hash
            )
            for topic in sample_topics()
        }
        for name, time_ns, data in messages:
            writer.write(connections[name], time_ns, data)


def measure(
    name: str, write: Callable[[Path], object], messages: Messages, folder: Path
) -> dict[str, float]:
    """Wall and CPU time of writing all messages."""
    target = folder / name
    cpu, wall = time.process_time(), time.perf_counter()
    taken = write(target)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    size = sum(len(one[2]) for one in messages)
    result = {
        f"{name}_messages_per_s": len(messages) / wall,
        f"{name}_mb_per_s": size / wall / 1e6,
        f"{name}_cpu_us_per_message": cpu / len(messages) * 1e6,
        f"{name}_file_mb": sum(file.stat().st_size for file in target.iterdir()) / 1e6,
    }
    if isinstance(taken, list):
        result[f"{name}_handover_p50_us"], result[f"{name}_handover_p99_us"] = (
            np.percentile(taken, [50, 99]) * 1e6
        )
        result[f"{name}_handover_max_ms"] = max(taken) * 1e3
    return result


def graph_run(folder: Path, seconds: int) -> dict[str, float]:
    """Record a publisher of 1,000 messages/s with the recorder as a process of its own."""
    bag, count = folder / "graph", RATE_HZ * seconds
    with free_domain() as domain, Launcher(folder / "log", domain) as launcher:
        recorder = launcher.start("recorder", "recorder", ["--ros-args", "-p", f"output:={bag}"])
        talker = subprocess.run(
            [sys.executable, __file__, "--talk", str(count)],
            env=os.environ | {"ROS_DOMAIN_ID": str(domain)},
            stdout=subprocess.PIPE,
            timeout=seconds + 60.0,
            check=True,
        )
        elapsed_s = float(talker.stdout)
        cpu_s = processor_s(recorder.process.pid)
        launcher.stop("recorder")
    with BagReader(bag) as reader:
        records = list(reader.records(["/load"]))
    delays = np.array([one.log_time_ns - one.publish_time_ns for one in records]) * 1e-6
    return {
        "graph_seconds": float(seconds),
        "graph_sent": float(count),
        "graph_sent_per_s": count / elapsed_s,
        "graph_lost": float(count - len({one.data for one in records})),
        "graph_recorder_cpu_percent": 100.0 * cpu_s / elapsed_s,
        "graph_receive_delay_p50_ms": float(np.percentile(delays, 50)),
        "graph_receive_delay_p99_ms": float(np.percentile(delays, 99)),
    }


def reading(folder: Path) -> dict[str, float]:
    """Read the bag of a 45-minute weld: count, signals, KPIs; ``rosbags`` only reads the bytes."""
    bag = folder / "weld"
    count = write_sample_weld(bag, WELD_TICKS)
    clock = time.perf_counter
    times = [clock()]
    with rosbag2.Reader(bag) as reader:
        assert sum(1 for _ in reader.messages()) == count
    times.append(clock())
    with BagReader(bag) as own:
        assert own.info().message_count == count
    times.append(clock())
    signals = load_weld(bag)
    times.append(clock())
    assert signals.n_ticks == WELD_TICKS and not signals.problems
    compute(signals)
    times.append(clock())
    names = ("rosbags_read", "read", "signals", "kpi")
    return {
        "weld_45min_messages": float(count),
        "weld_45min_mb": sum(file.stat().st_size for file in bag.iterdir()) / 1e6,
        **{
            f"weld_45min_{name}_s": float(taken)
            for name, taken in zip(names, np.diff(times), strict=True)
        },
    }


def main() -> None:
    """Run everything, print a table, write JSON."""
    cli = parser(__doc__, "fewer messages, 5 s instead of 60 s of recording")
    cli.add_argument("--talk", type=int, help=argparse.SUPPRESS)
    arguments = cli.parse_args()
    if arguments.talk:
        talk(arguments.talk)
        return
    ticks = 2_000 if arguments.quick else 20_000
    results: dict[str, float] = {}
    with tempfile.TemporaryDirectory(prefix="fsw_recorder_benchmark_") as name:
        folder = Path(name)
        messages = list(sample_messages(ticks))
        writers: list[tuple[str, Callable[[Path], object]]] = [
            ("recorder", lambda path: with_recorder(path, messages)),
            ("rosbags", lambda path: with_rosbags(path, messages)),
        ]
        print(f"{len(messages)} messages on {len(TOPICS)} topics", flush=True)
        for label, write in writers:
            results |= measure(label, write, messages, folder)
        messages.clear()
        print("recording 1,000 messages/s over DDS", flush=True)
        results |= graph_run(folder, 5 if arguments.quick else 60)
        print("reading a 45-minute weld", flush=True)
        results |= reading(folder)
    show(results)
    save(results, arguments.json)


if __name__ == "__main__":
    main()
