"""At the emulated machine in real time.

From a new value of the cycle counter to the set-point that answers it.

Supervisor, both controllers, an idle scenario player, gateway and machine run as processes. Times
are the machine's own, from writing the counter to the heartbeat of the command; the cycles'
intervals show whether 10 Hz was held.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import statistics
import tempfile
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import _benchmark
import rclpy
import yaml
from rclpy.context import Context

from fsw_control import messages_ros as convert
from fsw_control import weld
from fsw_control.contract import Reference
from fsw_control.fast_dds import stay_on_this_machine
from fsw_control.free_domain import free_domain
from fsw_control.topics_ros import LATCHED
from fsw_msgs.msg import WeldReference
from fsw_scenario.graph import WeldGraph
from fsw_scenario.launcher import Launcher
from fsw_test_support import machine_server
from fsw_test_support.waiting import wait_for_text

#: cycles that do not count: while everything starts, and while it ends
WARM_UP, AT_THE_END = 50, 30


def machine_file(folder: Path, secure: bool) -> Path:
    """The shipped machine file for a free port, with certificates of its own if wanted."""
    shipped = machine_server.MACHINE_FILE
    content = yaml.safe_load(shipped.read_text(encoding="utf-8"))
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        content["endpoint"] = f"opc.tcp://127.0.0.1:{probe.getsockname()[1]}/fsw"
    if secure:
        content |= yaml.safe_load(machine_server.make_certificates(folder))
    path = folder / "machine.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


@contextlib.contextmanager
def set_points(domain: int) -> Iterator[None]:
    """States the operating point for as long as the context lasts."""
    context = Context()
    stay_on_this_machine(os.environ)
    rclpy.init(args=[], context=context, domain_id=domain)
    node = rclpy.create_node("set_points", context=context)
    publisher = node.create_publisher(WeldReference, "fsw/reference", LATCHED)
    publisher.publish(convert.reference_message(Reference(weld.DEPTH_MM, weld.TEMPERATURE_C), 0))
    yield
    node.destroy_node()
    context.try_shutdown()


def measure(cycles: int, secure: bool) -> _benchmark.Figures:
    """Run the chain for so many cycles."""
    with (
        tempfile.TemporaryDirectory() as text,
        free_domain() as domain,
        set_points(domain),
        Launcher(Path(text) / "log", domain) as launcher,
    ):
        folder = Path(text)
        file, report = machine_file(folder, secure), folder / "report.json"
        options = ["--machine-file", str(file), "--report", str(report)]
        options += ["--server-key", str(folder / "server_key.pem")] if secure else []
        launcher.start("plc", machine_server.__name__, options)
        wait_for_text(launcher, "plc", "machine serves")
        WeldGraph(
            None,
            folder,
            ("nmpc", "decentral"),
            realtime=True,
            record=False,
            machine=True,
            derived={"fsw_machine": {"machine_file": str(file)}},
        ).start(launcher)
        wait_for_text(launcher, "supervisor", r"-> auto \(nmpc\)")
        before = {
            name: _benchmark.processor_s(child.process.pid)
            for name, child in launcher.children.items()
        }
        begin_s = time.monotonic()
        time.sleep((WARM_UP + cycles + AT_THE_END) * weld.TICK_S)  # the measurement itself
        took_s = time.monotonic() - begin_s
        used = {
            name: _benchmark.processor_s(child.process.pid) - before[name]
            for name, child in launcher.children.items()
        }
        launcher.stop()
        measured = json.loads(report.read_text(encoding="utf-8"))
    window = slice(-cycles - AT_THE_END, -AT_THE_END)
    latencies_ms = [
        1e3 * latency_s for latency_s in measured["latencies_s"][window] if latency_s is not None
    ]
    intervals_ms = [1e3 * (b - a) for a, b in pairwise(measured["begun_s"][window])]
    off_ms = [abs(interval_ms - 1e3 * weld.TICK_S) for interval_ms in intervals_ms]
    kind = "secure" if secure else "plain"
    figures: _benchmark.Figures = {
        "cycles": len(intervals_ms) + 1,
        "cycles_without_a_command": cycles - len(latencies_ms),
        "cycle_mean_ms": statistics.mean(intervals_ms),
        **_benchmark.percentiles("cycle_off", off_ms),
        **_benchmark.percentiles("latency", latencies_ms),
        "gateway_processor_percent": 100.0 * used["machine"] / took_s,
        "machine_processor_percent": 100.0 * used["plc"] / took_s,
    }
    return {f"{kind}_{name}": value for name, value in figures.items()}


def both(quick: bool) -> tuple[_benchmark.Figures, _benchmark.Figures]:
    """Figures without and with encryption."""
    cycles = 300 if quick else 1200
    return measure(cycles, False) | measure(cycles, True), {}


if __name__ == "__main__":
    _benchmark.run(__doc__, "300 cycles instead of 1200", both)
