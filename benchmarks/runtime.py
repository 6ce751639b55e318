"""What the runtime costs: CPU at 10, 100 and 1,000 Hz, service round trip, timer jitter, idle CPU, memory, start-up.

The latency of topics is in `latency.py`. Where ROS_DISTRO is set the same file measures genuine rclpy.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

SOURCE = Path(__file__).resolve().parent.parent / "src" / "rclpy_embedded"
START = """
import time; start = time.perf_counter()
import rclpy
from std_msgs.msg import String
rclpy.init()
rclpy.create_node("starter").create_publisher(String, "chat", 10)
print(time.perf_counter() - start)
"""


def _percentile(values: list[float], fraction: float) -> float:
    return sorted(values)[min(len(values) - 1, int(fraction * len(values)))]


def cpu_at_rate(hz: float, seconds: float) -> dict[str, float]:
    """Publish at a rate to a subscription of the same process; CPU in percent of a core, timer jitter in ms."""
    import rclpy
    from std_msgs.msg import String

    node = rclpy.create_node(f"rate_{hz:.0f}")
    publisher = node.create_publisher(String, "rate", 10)
    received: list[str] = []
    ticks: list[float] = []
    node.create_subscription(String, "rate", lambda message: received.append(message.data), 10)

    def tick() -> None:
        ticks.append(time.perf_counter())
        publisher.publish(String(data="x" * 64))

    node.create_timer(1 / hz, tick)
    cpu, start = time.process_time(), time.perf_counter()
    while time.perf_counter() < start + seconds:
        rclpy.spin_once(node, timeout_sec=0.1)
    used = (time.process_time() - cpu) / (time.perf_counter() - start)
    node.destroy_node()
    since = [now - ticks[0] for now in ticks]
    # Distance to the nearest point of the grid: a tick that was missed does not count for those after it.
    late = [abs(elapsed - round(elapsed * hz) / hz) * 1e3 for elapsed in since]
    return {
        f"cpu_{hz:.0f}hz_percent": 100 * used,
        f"jitter_{hz:.0f}hz_p50_ms": statistics.median(late),
        f"jitter_{hz:.0f}hz_p99_ms": _percentile(late, 0.99),
        f"lost_{hz:.0f}hz": float(max(0, len(ticks) - len(received) - 1)),
    }


def idle_cpu(seconds: float) -> dict[str, float]:
    """Spin a node that has nothing to do."""
    import rclpy

    node = rclpy.create_node("idle")
    executor = rclpy.get_global_executor()
    executor.add_node(node)
    executor.spin_once(timeout_sec=0.2)
    cpu, start = time.process_time(), time.perf_counter()
    while (left := start + seconds - time.perf_counter()) > 0:
        executor.spin_once(timeout_sec=left)
    used = (time.process_time() - cpu) / (time.perf_counter() - start)
    executor.remove_node(node)
    node.destroy_node()
    return {"idle_cpu_percent": 100 * used}


def service_round_trip(count: int) -> dict[str, float]:
    """Call a service of the same process."""
    import rclpy
    from std_srvs.srv import Trigger

    node = rclpy.create_node("service")
    node.create_service(Trigger, "trigger", lambda request, response: response)
    client = node.create_client(Trigger, "trigger")
    client.wait_for_service(10)
    executor: Any = rclpy.get_global_executor()
    executor.add_node(node)
    times = []
    for _ in range(count):
        start = time.perf_counter()
        future = client.call_async(Trigger.Request())
        while not future.done():
            executor.spin_once(timeout_sec=1)
        times.append((time.perf_counter() - start) * 1e3)
    executor.remove_node(node)
    node.destroy_node()
    return {"service_p50_ms": statistics.median(times), "service_p99_ms": _percentile(times, 0.99)}


def memory_per_node(count: int) -> dict[str, float]:
    """Growth of the resident set with nodes of one process."""
    import rclpy

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    nodes = [rclpy.create_node(f"memory_{number}") for number in range(count)]
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for node in nodes:
        node.destroy_node()
    return {"memory_process_mb": before / 1024, "memory_per_node_kb": (after - before) / count}


def start_up(count: int) -> dict[str, float]:
    """Time from the first import to the first publisher, in fresh processes."""
    command = [sys.executable, "-c", START]
    times = [float(subprocess.run(command, check=True, capture_output=True, text=True).stdout) for _ in range(count)]
    return {"start_up_s": statistics.median(times)}


def main() -> None:
    """Measure, print a table and, if asked for, write flat JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="shorter runs")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to FILE")
    arguments = parser.parse_args()
    if "ROS_DISTRO" not in os.environ:
        sys.path.insert(0, str(SOURCE))
        os.environ["PYTHONPATH"] = f"{SOURCE}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    os.environ.setdefault("ROS_DOMAIN_ID", str(101 + os.getpid() % 60))
    import rclpy

    seconds = 2.0 if arguments.quick else 10.0
    figures = start_up(3 if arguments.quick else 10)
    rclpy.init(args=[])
    figures.update(idle_cpu(seconds))
    for hz in (10.0, 100.0, 1000.0):
        figures.update(cpu_at_rate(hz, seconds))
    figures.update(service_round_trip(200 if arguments.quick else 2000))
    figures.update(memory_per_node(20))
    rclpy.shutdown()
    runtime = f"genuine rclpy ({os.environ['ROS_DISTRO']})" if "ROS_DISTRO" in os.environ else "rclpy_embedded"
    print(f"{runtime}:")
    for name, value in figures.items():
        print(f"  {name:<24}{value:>10.3f}")
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n")


if __name__ == "__main__":
    main()
