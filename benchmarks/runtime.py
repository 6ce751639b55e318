"""What the runtime costs next to genuine rclpy and bare cyclonedds, in one run: CPU, jitter, services, start, memory.

CPU is measured at 10, 100 and 1,000 Hz for 64 bytes and for 1 MB, with publisher and subscription in one process; the
jitter of a timer is the distance of its calls from their grid. The latency of topics between processes is in
`latency.py`. Genuine rclpy is measured where ROS 2 is sourced.
"""

from __future__ import annotations

import argparse
import json
import resource
import statistics
import time
from pathlib import Path
from typing import Any

from report import parser
from sides import BareParticipant, RclpyNode, Side, compare, output

SIZES = {"small": 64, "1mb": 1_000_000}
RATES_HZ = (10, 100, 1000)
START = {
    "rclpy": """
import time; start = time.perf_counter()
import rclpy
from std_msgs.msg import String
rclpy.init()
rclpy.create_node("starter").create_publisher(String, "chat", 10)
print(time.perf_counter() - start)
""",
    "cyclonedds": """
import time; start = time.perf_counter()
import os
from dataclasses import dataclass
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
@dataclass
class Text(IdlStruct):
    data: str
participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
DataWriter(participant, Topic(participant, "chat", Text))
print(time.perf_counter() - start)
""",
}


def percentile(values: list[float], fraction: float) -> float:
    """Return the value below which a fraction of the values lies."""
    return sorted(values)[min(len(values) - 1, int(fraction * len(values)))]


class Rclpy(RclpyNode):
    """A node that publishes to itself."""

    def __init__(self) -> None:
        from std_srvs.srv import Trigger

        super().__init__("benchmark")
        self.publisher = self.node.create_publisher(self.kind, "data", 10)
        self.received = 0
        self.node.create_subscription(self.kind, "data", self._receive, 10)
        self.node.create_service(Trigger, "trigger", lambda request, response: response)
        self.client = self.node.create_client(Trigger, "trigger")
        self.request = Trigger.Request()
        self.client.wait_for_service(10)

    def _receive(self, message: Any) -> None:
        self.received += 1

    def spin(self, seconds: float) -> None:
        """Run callbacks for some time."""
        end = time.perf_counter() + seconds
        while (left := end - time.perf_counter()) > 0:
            self.executor.spin_once(timeout_sec=left)

    def publish_at(self, hz: float, size: int, seconds: float) -> list[float]:
        """Publish at a rate; return when that was done."""
        ticks: list[float] = []
        message = self.make(size)

        def tick() -> None:
            ticks.append(time.perf_counter())
            self.publisher.publish(message)

        timer = self.node.create_timer(1 / hz, tick)
        self.spin(seconds)
        self.node.destroy_timer(timer)
        return ticks

    def call(self) -> None:
        """Call a service and wait for its response."""
        future = self.client.call_async(self.request)
        while not future.done():
            self.executor.spin_once(timeout_sec=1)


class Bare(BareParticipant):
    """The same with cyclonedds alone."""

    def __init__(self) -> None:
        super().__init__()
        topics = ("data", "request", "reply")
        self.writers = {name: self.writer(name) for name in topics}
        self.readers = {name: self.reader(name) for name in topics}
        self.received = 0

    def spin(self, seconds: float) -> None:
        """Take what comes for some time."""
        end = time.perf_counter() + seconds
        while (left := end - time.perf_counter()) > 0:
            self.waitset.wait(int(left * 1e9))
            self.received += len(self.readers["data"].take(10))

    def publish_at(self, hz: float, size: int, seconds: float) -> list[float]:
        """Publish at a rate; return when that was done."""
        ticks: list[float] = []
        message = self.make(size)
        start = time.perf_counter()
        while (now := time.perf_counter()) < start + seconds:
            self.spin(start + (int((now - start) * hz) + 1) / hz - now)
            ticks.append(time.perf_counter())
            self.writers["data"].write(message)
        return ticks

    def call(self) -> None:
        """Send a request, answer it, take the answer."""
        self.writers["request"].write(self.make(1))
        while True:
            self.waitset.wait(10**9)
            for _ in self.readers["request"].take(1):
                self.writers["reply"].write(self.make(1))
            if self.readers["reply"].take(1):
                return


SIDES: dict[str, Any] = {"rclpy_embedded": Rclpy, "genuine": Rclpy, "cyclonedds": Bare}


def measure(name: str, quick: bool) -> dict[str, float]:
    """Measure one side in this process."""
    side = SIDES[name]()
    figures: dict[str, float] = {}
    seconds = 2.0 if quick else 10.0

    def cpu_of(work: Any) -> tuple[Any, float]:
        cpu, start = time.process_time(), time.perf_counter()
        result = work()
        return result, 100 * (time.process_time() - cpu) / (time.perf_counter() - start)

    side.spin(0.3)
    figures["idle_cpu_percent"] = cpu_of(lambda: side.spin(seconds))[1]
    times = []
    for _ in range(200 if quick else 2000):
        start = time.perf_counter()
        side.call()
        times.append((time.perf_counter() - start) * 1e3)
    figures |= {"service_p50_ms": statistics.median(times), "service_p99_ms": percentile(times, 0.99)}
    for payload, size in SIZES.items():
        for hz in RATES_HZ:
            side.received = 0
            ticks, cpu = cpu_of(lambda hz=hz, size=size: side.publish_at(hz, size, seconds))
            side.spin(0.2)
            key = f"{payload}_{hz}hz"
            figures[f"cpu_{key}_percent"] = cpu
            figures[f"reached_{key}_hz"] = side.received / seconds
            if payload == "small":
                since = [tick - ticks[0] for tick in ticks]
                # To the nearest point of the grid: a tick that was missed does not count for those after it.
                late = [abs(elapsed - round(elapsed * hz) / hz) * 1e3 for elapsed in since]
                figures[f"jitter_{hz}hz_p50_ms"] = statistics.median(late)
                figures[f"jitter_{hz}hz_p99_ms"] = percentile(late, 0.99)
    figures["memory_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    if name != "cyclonedds":
        figures["memory_per_node_kb"] = memory_per_node(20)
    return figures


def memory_per_node(count: int) -> float:
    """Growth of the resident set with nodes of one process, in kB."""
    import rclpy

    def resident_kb() -> int:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return pages * resource.getpagesize() // 1024

    before = resident_kb()
    nodes = [rclpy.create_node(f"memory_{number}") for number in range(count)]
    grown = resident_kb() - before
    for node in nodes:
        node.destroy_node()
    return grown / count


def run(name: str, side: Side, quick: bool) -> dict[str, float]:
    """Measure one side in a process of its own, and its start-up in others."""
    starts = [output(side, "-c", START.get(name, START["rclpy"])) for _ in range(3 if quick else 10)]
    flags = ["--quick"] if quick else []
    figures: dict[str, float] = json.loads(output(side, __file__, "--side", name, *flags))
    figures["start_up_s"] = min(float(text) for text in starts)
    return figures


def main() -> None:
    """Measure all sides; with the hidden argument, the one that this process is to be."""
    cli = parser(__doc__, "shorter runs")
    cli.add_argument("--side", choices=SIDES, help=argparse.SUPPRESS)
    arguments = cli.parse_args()
    if arguments.side:
        print(json.dumps(measure(arguments.side, arguments.quick)))
    else:
        compare(lambda name, side: run(name, side, arguments.quick), arguments.json)


if __name__ == "__main__":
    main()
