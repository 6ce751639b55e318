#!/usr/bin/env python3
"""Latency of the arbiter hop: measurement to proposal and to applied command, real processes in real time.

A measuring process publishes the sensors; two controllers and the supervisor answer: at 10 Hz the
decentralized controller and the NMPC, at 10 Hz and at 100 Hz two small ones that cost nothing. The
hop is what the supervisor adds between the active controller's proposal and the command, both as
they arrive at the measuring process.

usage: arbiter.py [--quick] [--json FILE]
"""

import argparse
import os
import platform
import random
import statistics
import sys
import tempfile
import time
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent / "scripts"))

if __name__ == "__main__":
    from _bootstrap import ensure

    ensure()

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from report import parser, save, show

from fsw_control import Command, Proposal, run_controller, weld
from fsw_control import messages_ros as convert
from fsw_control.fast_dds import stay_on_this_machine
from fsw_control.free_domain import free_domain
from fsw_control.topics_ros import sensor_publishers
from fsw_msgs.msg import DriveFeedback, WeldCommand, WeldReference
from fsw_scenario.launcher import Launcher

ACTIVE, SHADOW = "decentral", "nmpc"
MODULES = {ACTIVE: "fsw_decentral.decentral_node", SHADOW: "fsw_nmpc.nmpc_node"}


def run_dummy(name, arguments):
    """Run a controller that proposes what is applied, in this process."""

    class Dummy:
        tolerated_sensors = ()

        def __init__(self):
            self.name = name

        def step(self, measurement, reference, applied, dt_s):
            return Proposal(applied)

        def reset(self, applied):
            pass

    return run_controller(Dummy, name=name, args=["dummy", *arguments])


#: by sensor, its mean and spread
_SHOWN = (
    ("depth", weld.DEPTH_MM, 1e-3),
    ("torque", 1052.86, 1.0),
    ("thermocouple", weld.TEMPERATURE_C, 0.2),
)


class Meter:
    """Publishes measurements at a rate and notes when proposals and commands come back."""

    def __init__(self, domain, rate_hz):
        rclpy.init(args=[], domain_id=domain)
        self._acting = Command(weld.FORCE_KN, weld.SPEED_RPM)
        self.node = rclpy.create_node("meter")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._drives = self.node.create_publisher(DriveFeedback, "fsw/drives", 10)
        self._sensors = sensor_publishers(self.node)
        kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._references = self.node.create_publisher(WeldReference, "fsw/reference", kept)
        self._references.publish(
            WeldReference(depth=weld.DEPTH_MM * 1e-3, temperature=weld.TEMPERATURE_C)
        )
        self.sent, self.proposed, self.commanded, self.sources = {}, {}, {}, {}
        self.node.create_subscription(WeldCommand, f"fsw/{ACTIVE}/proposal", self._on_proposal, 10)
        self.node.create_subscription(WeldCommand, "fsw/command", self._on_command, 10)
        self._period_s = 1.0 / rate_hz
        self._noise = random.Random(1)

    def ready(self):
        """Whether both controllers and the supervisor hear the sensors, and this process hears them."""
        self._executor.spin_once(timeout_sec=0.0)
        heard = min(sensor.get_subscription_count() for sensor in self._sensors) >= 3
        return heard and self.node.count_publishers("/fsw/command") >= 1

    def run(self, ticks):
        """Publish so many ticks at the rate."""
        next_s = time.monotonic()
        for _ in range(ticks):
            self._spin_until(next_s)
            self._tick()
            next_s += self._period_s
        self._spin_until(time.monotonic() + 0.2)

    def _spin_until(self, end_s):
        while (left_s := end_s - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left_s)

    def forget(self):
        """Leave out the ticks so far."""
        for record in (self.sent, self.proposed, self.commanded, self.sources):
            record.clear()

    def _tick(self):
        stamp, noise = time.time_ns(), self._noise.gauss
        self.sent[stamp] = time.monotonic()
        self._drives.publish(convert.drives_message(self._acting, stamp))
        for name, value, spread in _SHOWN:
            self._sensors[name].publish(convert.sensor_message(name, noise(value, spread), stamp))

    def _on_proposal(self, message):
        self.proposed.setdefault(convert.stamp_ns(message.header.stamp), time.monotonic())

    def _on_command(self, message):
        stamp = convert.stamp_ns(message.header.stamp)
        self.commanded.setdefault(stamp, time.monotonic())
        self.sources[stamp] = message.source
        self._acting = convert.command(message)

    def close(self):
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()


def measure(rate_hz, ticks, real):
    """Latencies [ms] at one rate as a flat dict; ``real``: with this project's controllers."""
    period_s = 1.0 / rate_hz
    supervisor = [f"tick_period_s:={period_s}", f"deadline_s:={0.8 * period_s}"]
    controller = [f"period:={period_s}", f"deadline:={0.3 * period_s}"]
    with (
        tempfile.TemporaryDirectory() as folder,
        free_domain() as domain,
        Launcher(Path(folder), domain) as launcher,
    ):
        stay_on_this_machine(os.environ)
        launcher.start(
            "supervisor",
            "fsw_supervisor.supervisor_node",
            ["--ros-args", *_parameters(supervisor)],
        )
        for name in (ACTIVE, SHADOW):
            if real:
                launcher.start(name, MODULES[name])
            else:
                launcher.start(
                    name, "arbiter", ["--controller", name, "--ros-args", *_parameters(controller)]
                )
        meter = Meter(domain, rate_hz)
        try:
            launcher.wait_until(meter.ready, 60.0, "the graph")
            meter.run(round(3 * rate_hz))
            meter.forget()
            meter.run(ticks)
        finally:
            meter.close()
    both = [stamp for stamp in meter.sent if stamp in meter.commanded and stamp in meter.proposed]
    series = {
        "measurement_to_proposal": [meter.proposed[stamp] - meter.sent[stamp] for stamp in both],
        "measurement_to_command": [meter.commanded[stamp] - meter.sent[stamp] for stamp in both],
        "arbiter_hop": [meter.commanded[stamp] - meter.proposed[stamp] for stamp in both],
    }
    case = f"{rate_hz}hz" + ("_real" if real else "")
    result = {}
    for name, values in series.items():
        hundredths = statistics.quantiles(
            [1e3 * value for value in values], n=100, method="inclusive"
        )
        result |= {
            f"{name}_p50_ms_{case}": hundredths[49],
            f"{name}_p99_ms_{case}": hundredths[98],
        }
    result[f"ticks_{case}"] = ticks
    result[f"ticks_without_command_{case}"] = len(meter.sent) - len(meter.commanded)
    result[f"ticks_not_by_active_{case}"] = sum(
        source != ACTIVE for source in meter.sources.values()
    )
    return result


def _parameters(settings):
    return [item for setting in settings for item in ("-p", setting)]


def main():
    """Measure, print a table, write JSON."""
    cli = parser(__doc__, "10, 10 and 5 s instead of 60, 60 and 30 s")
    cli.add_argument("--controller", help=argparse.SUPPRESS)
    arguments, rest = cli.parse_known_args()
    if arguments.controller:
        return run_dummy(arguments.controller, rest)
    if rest:
        cli.error(f"unrecognized arguments: {' '.join(rest)}")
    result = {"cpus": os.cpu_count(), "python": platform.python_version()}
    slow_s, fast_s = (10, 5) if arguments.quick else (60, 30)
    for rate_hz, seconds, real in ((10, slow_s, True), (10, slow_s, False), (100, fast_s, False)):
        result |= measure(rate_hz, rate_hz * seconds, real)
    show(result)
    save(result, arguments.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
