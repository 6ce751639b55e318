#!/usr/bin/env python3
"""Publish-to-receive latency between two processes: half of the round trip of a message, with the executor's part.

usage: latency.py [--quick] [--json FILE]
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).resolve().parent.parent / "scripts"))

if __name__ == "__main__":
    from _bootstrap import ensure

    ensure()

from report import parser, save, show

from fsw_control.fast_dds import stay_on_this_machine
from fsw_control.free_domain import free_domain

PAYLOADS = {"64 bytes": 64, "1 MB": 1_000_000}
AIMS = {"64 bytes p99 [ms]": 1.0}
PARTNER = "--partner"


class Peer:
    """A node that sends on one topic and receives on another."""

    def __init__(self, is_partner: bool) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from std_msgs.msg import UInt8MultiArray

        rclpy.init(args=[])
        self.kind = UInt8MultiArray
        self.node: Any = rclpy.create_node("partner" if is_partner else "master")
        self.executor: Any = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        out, into = ("pong", "ping") if is_partner else ("ping", "pong")
        self.publisher = self.node.create_publisher(self.kind, out, 10)
        self.received: list[Any] = []
        callback = self.publisher.publish if is_partner else self.received.append
        self.node.create_subscription(self.kind, into, callback, 10)

    def wait_for_partner(self) -> None:
        """Wait until the other process is there, in both directions."""
        end = time.monotonic() + 20.0
        while not (self.publisher.get_subscription_count() and self.node.count_publishers("pong")):
            if time.monotonic() > end:
                sys.exit("latency: no partner process within 20 s")
            time.sleep(0.02)
        time.sleep(0.2)

    def round_trip_s(self, message: Any) -> float:
        """Send, wait for the answer, return the seconds that it took."""
        self.received.clear()
        start = time.perf_counter()
        self.publisher.publish(message)
        while not self.received:
            self.executor.spin_once(timeout_sec=1.0)
        return time.perf_counter() - start


def measure(counts: dict[str, int]) -> dict[str, float]:
    """Latencies by payload."""
    began = time.perf_counter()
    peer = Peer(is_partner=False)
    figures = {"start of a node [s]": time.perf_counter() - began}
    peer.wait_for_partner()
    for payload, count in counts.items():
        message = peer.kind(data=bytes(PAYLOADS[payload]))
        values = sorted(peer.round_trip_s(message) / 2 * 1e3 for _ in range(count))
        figures[f"{payload} p50 [ms]"] = statistics.median(values)
        figures[f"{payload} p99 [ms]"] = values[int(0.99 * len(values))]
        figures[f"{payload} max [ms]"] = values[-1]
    return figures


def main() -> None:
    """Measure with two processes, print a table, write JSON."""
    if PARTNER in sys.argv:
        Peer(is_partner=True).executor.spin()
        return
    arguments = parser(__doc__, "fewer samples").parse_args()
    counts = {"64 bytes": 500, "1 MB": 20} if arguments.quick else {"64 bytes": 5000, "1 MB": 200}
    with free_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        stay_on_this_machine(os.environ)
        partner = subprocess.Popen([sys.executable, __file__, PARTNER])
        try:
            figures = measure(counts)
        finally:
            partner.kill()
            partner.wait()
    show(figures, AIMS)
    save(figures, arguments.json)


if __name__ == "__main__":
    main()
