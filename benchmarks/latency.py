"""Publish-to-receive latency between two processes, in one run: rclpy_embedded, genuine rclpy, bare cyclonedds.

Each ping carries its time of publication and is answered by the other process; what is reported is half of the round
trip, so that both directions count alike and no clock has to be shared. Genuine rclpy is measured where ROS 2 is
sourced.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from typing import Any

from report import parser
from sides import BareParticipant, RclpyNode, Side, compare, output

PAYLOADS = {"small": 64, "1mb": 1_000_000}


class Rclpy(RclpyNode):
    """Ping-pong over rclpy."""

    def __init__(self, role: str) -> None:
        super().__init__(f"latency_{role}")
        out, into = ("ping", "pong") if role == "master" else ("pong", "ping")
        self.publisher = self.node.create_publisher(self.kind, out, 10)
        self.got: list[Any] = []
        callback = self.got.append if role == "master" else self.publisher.publish
        self.node.create_subscription(self.kind, into, callback, 10)

    def matched(self) -> bool:
        """Return whether the other process is there, in both directions."""
        return bool(self.publisher.get_subscription_count() and self.node.count_publishers("pong"))

    def round_trip(self, message: Any) -> float:
        """Send, wait for the answer, return the seconds it took."""
        self.got.clear()
        start = time.perf_counter()
        self.publisher.publish(message)
        while not self.got:
            self.executor.spin_once(timeout_sec=1)
        return time.perf_counter() - start

    def serve(self) -> None:
        """Answer until killed."""
        self.executor.spin()


class Bare(BareParticipant):
    """Ping-pong over cyclonedds."""

    def __init__(self, role: str) -> None:
        super().__init__()
        out, into = ("ping", "pong") if role == "master" else ("pong", "ping")
        self._writer, self._reader = self.writer(out), self.reader(into)

    def matched(self) -> bool:
        """Return whether the other process is there, in both directions."""
        return bool(self._writer.get_matched_subscriptions() and self._reader.get_matched_publications())

    def _receive(self) -> Any:
        while True:
            samples = self._reader.take(1)
            if samples:
                return samples[0]
            self.waitset.wait(10**9)

    def round_trip(self, message: Any) -> float:
        """Send, wait for the answer, return the seconds it took."""
        start = time.perf_counter()
        self._writer.write(message)
        self._receive()
        return time.perf_counter() - start

    def serve(self) -> None:
        """Answer until killed."""
        while True:
            self._writer.write(self._receive())


SIDES: dict[str, Any] = {"rclpy_embedded": Rclpy, "genuine": Rclpy, "cyclonedds": Bare}


def measure(side: Any, size: int, count: int) -> list[float]:
    """Return `count` one-way latencies in milliseconds, after a warm-up."""
    message = side.make(size)
    for _ in range(min(50, count)):
        side.round_trip(message)
    return [side.round_trip(message) / 2 * 1e3 for _ in range(count)]


def run_master(name: str, counts: dict[str, int]) -> None:
    """Measure one side and print the result as JSON."""
    side = SIDES[name]("master")
    end = time.monotonic() + 20
    while not side.matched():
        if time.monotonic() > end:
            sys.exit(f"latency: no partner process found for {name} within 20 s")
        time.sleep(0.02)
    time.sleep(0.2)
    result: dict[str, float] = {}
    for payload, count in counts.items():
        values = sorted(measure(side, PAYLOADS[payload], count))
        result[f"{payload}_p50_ms"] = statistics.median(values)
        result[f"{payload}_p99_ms"] = values[min(len(values) - 1, int(0.99 * len(values)))]
    print(json.dumps(result), flush=True)
    os._exit(0)


def run(name: str, side: Side, counts: dict[str, int]) -> dict[str, float]:
    """Measure one side with two processes."""
    python, environ = side
    partner = subprocess.Popen([python, __file__, "--side", name, "--role", "partner"], env=environ)
    try:
        text = output(side, __file__, "--side", name, "--role", "master", "--counts", json.dumps(counts))
    finally:
        partner.kill()
        partner.wait()
    figures: dict[str, float] = json.loads(text)
    return figures


def main() -> None:
    """Measure all sides; with the hidden arguments, be one of the two processes of a side."""
    cli = parser(__doc__, "fewer samples")
    cli.add_argument("--side", choices=SIDES, help=argparse.SUPPRESS)
    cli.add_argument("--role", choices=["master", "partner"], help=argparse.SUPPRESS)
    cli.add_argument("--counts", type=json.loads, help=argparse.SUPPRESS)
    arguments = cli.parse_args()
    if arguments.role == "partner":
        SIDES[arguments.side]("partner").serve()
    elif arguments.role == "master":
        run_master(arguments.side, arguments.counts)
    else:
        counts = {"small": 500, "1mb": 20} if arguments.quick else {"small": 5000, "1mb": 200}
        compare(lambda name, side: run(name, side, counts), arguments.json)


if __name__ == "__main__":
    main()
