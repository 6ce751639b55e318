"""A weld as processes to which anything may be done; parts that end are started again."""

from __future__ import annotations

import os
import re
import signal
import time
from collections.abc import Callable, Sequence
from math import inf, nan
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.request import urlopen

import rclpy
from random_faults_observer import HEALTHY_TICKS, SOURCE, Observer
from rclpy.context import Context

from fsw_control import messages_ros as convert
from fsw_control import weld
from fsw_control.contract import Reference
from fsw_control.fast_dds import stay_on_this_machine
from fsw_control.topics_ros import LATCHED
from fsw_control.units import NANOSECONDS
from fsw_msgs.msg import ShoulderDepth, WeldCommand, WeldReference
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.errors import BagError
from fsw_scenario.launcher import Launcher
from fsw_test_support import machine_server
from fsw_test_support.machine import Proxy, free_port, write_machine_file
from fsw_test_support.ros_graph import Spinner

_CONTROL = ("nmpc", "decentral", "supervisor", "standby", "recorder", "page")
#: parts of a graph; nodes are named as their entry points, except those below
EMULATOR, MACHINE = ("plant", *_CONTROL), ("machine", "gateway", *_CONTROL)
_PROGRAMS = {
    "machine": machine_server.__name__,
    "gateway": "machine",
    "standby": "supervisor",
    "page": "hmi",
}
SUPERVISOR = (
    "controller:=nmpc",
    "fallbacks:=[decentral, nmpc]",
    "readmit_ticks:=10",
    "return_to_target:=true",
    *(
        f"interlocks.temperature_{name}"
        for name in ("low.warn:=210.0", "low.trip:=200.0", "high.trip:=1000.0")
    ),
    "interlocks.temperature_high.warn:=950.0",
    "storm_swaps:=0",
)
RESPAWN_S = 0.5
#: the machine's clock is stepped by this, and back
CLOCK_STEP_S = 300.0
_FLOOD_PER_SPIN = 40
#: values and offsets of stamps that a stranger on the network may send
_BAD = (nan, inf, -1e300, 1e12, 0.0, -5.0, 78.4e3, 42.0)
_OFFSETS_S = (0, 3600, -3600, 10**6)


def nonsense(newest_ns: int) -> dict[str, tuple[Any, str, Callable[[int], Any]]]:
    """By name, type and topic, and what makes message number k.

    ``newest_ns`` is the stamp of the newest tick.
    """

    def stamped(message: Any, number: int) -> Any:
        stamp_ns = newest_ns + _OFFSETS_S[number % 4] * NANOSECONDS
        message.header.stamp = convert.stamp_from_ns(max(0, stamp_ns))
        message.header.frame_id = SOURCE
        return message

    def commanded(number: int) -> WeldCommand:
        force_n, speed_rad_s = _BAD[number % 8], _BAD[(number // 8) % 8]
        message = WeldCommand(
            axial_force=force_n, spindle_speed=speed_rad_s, source=SOURCE, healthy=True
        )
        return stamped(message, number)

    def measured(number: int) -> ShoulderDepth:
        return stamped(ShoulderDepth(depth=_BAD[number % 8]), 1 + number % 3)

    def referred(number: int) -> WeldReference:
        return WeldReference(depth=_BAD[number % 8], temperature=_BAD[(number // 8) % 8])

    return {
        "depth": (ShoulderDepth, "fsw/depth", measured),
        "proposal": (WeldCommand, "fsw/nmpc/proposal", commanded),
        "command": (WeldCommand, "fsw/command", commanded),
        "reference": (WeldReference, "fsw/reference", referred),
    }


def bags_in(folder: Path) -> dict[str, int]:
    """Numbers of bags in a folder, of those readable to their end, and of their commands."""
    readable, recorded = 0, 0
    folders = sorted(path for path in folder.glob("bag*") if path.is_dir())
    for bag in folders:
        try:
            with BagReader(bag) as reader:
                recorded += sum(record.topic == "/fsw/command" for record in reader.records())
            readable += 1
        except BagError as error:
            print(f"{bag.name}: {error}", flush=True)
    return {"bags": len(folders), "bags_readable": readable, "commands_recorded": recorded}


class PageProbe:
    """Whether the operator's page answers, asked at most twice a second."""

    def __init__(self, launcher: Launcher) -> None:
        self._launcher, self._looked_s, self.is_there = launcher, 0.0, False

    def answers(self, now_s: float) -> bool:
        """Whether it did when it was last asked."""
        if now_s > self._looked_s + 0.5:
            self._looked_s = now_s
            self.look()
        return self.is_there

    def look(self) -> None:
        """Ask it now."""
        address = re.search(r"http://\S+", self._launcher.children["page"].text())
        try:
            with urlopen(address[0] if address else "", timeout=0.5) as response:
                self.is_there = response.status == 200
        except (URLError, OSError, ValueError):
            self.is_there = False


class FaultyGraph(Spinner):
    """The processes of a weld and one observer; a context.

    Parameters
    ----------
    parts : sequence of str
        ``EMULATOR`` or ``MACHINE``.
    folder : Path
        Gets logs and bags.
    domain : int

    Attributes
    ----------
    observer : Observer
        What is seen of the weld.
    """

    def __init__(self, parts: Sequence[str], folder: Path, domain: int) -> None:
        self.parts, self.has_machine = parts, "machine" in parts
        self.floods = ("depth", "proposal", "command", "reference", "page")
        self._folder = folder
        self._launcher = Launcher(folder / "log", domain)
        self._context = Context()
        stay_on_this_machine(os.environ)
        rclpy.init(args=[], context=self._context, domain_id=domain)
        super().__init__(self._context)
        self._died_s: dict[str, float] = {}
        self._page = PageProbe(self._launcher)
        self.healthy_since_s = 0.0
        self._proxy: Proxy | None = None
        self._machine_file = Path()
        self._node = rclpy.create_node("random_faults", context=self._context)
        self.executor.add_node(self._node)
        self._references = self._node.create_publisher(WeldReference, "fsw/reference", LATCHED)
        self._refer()
        self.observer = Observer(self._node)

    def __enter__(self) -> FaultyGraph:
        self._folder.mkdir(parents=True, exist_ok=True)
        if self.has_machine:
            text = machine_server.MACHINE_FILE.read_text(encoding="utf-8")
            port = free_port()
            self._server_file = write_machine_file(self._folder / "server.yaml", port, text)
            self._proxy = Proxy(port)
            self._machine_file = write_machine_file(
                self._folder / "machine.yaml", self._proxy.port, text
            )
        for name in self.parts:
            self._start(name)
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self.executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()
        if self._proxy is not None:
            self._proxy.stop()

    # ---------------------------------------------------------------- processes

    def _start(self, name: str) -> None:
        if name == "machine":
            arguments = [
                "--machine-file",
                str(self._server_file),
                "--clock-step-s",
                str(CLOCK_STEP_S),
            ]
        else:
            settings = {
                "plant": ("wait_for_subscribers:=3",),
                "gateway": (f"machine_file:={self._machine_file}", "reconnect.max_s:=0.5"),
                "supervisor": SUPERVISOR,
                "standby": (*SUPERVISOR, "standby:=true"),
                "recorder": (f"output:={self._folder / 'bag'}", "number_if_taken:=true"),
                "page": ("port:=0",),
            }.get(name, ())
            rename = ["-r", "__node:=fsw_supervisor_standby"] if name == "standby" else []
            arguments = [
                "--ros-args",
                *(word for setting in settings for word in ("-p", setting)),
                *rename,
            ]
        self._launcher.start(name, _PROGRAMS.get(name, name), arguments)

    def signal(self, name: str, number: int) -> None:
        """Send a signal to a part that runs."""
        child = self._launcher.children[name]
        if child.running:
            child.process.send_signal(number)

    def cut_link(self, lasting_s: float) -> None:
        """Break the connections between gateway and machine for a while."""
        assert self._proxy is not None
        self._proxy.stall()
        self._proxy.cut()
        self.spin_for(lasting_s)
        self._proxy.flow()

    def stop(self) -> dict[str, int]:
        """End all parts; returns their exit codes."""
        for name in self.parts:
            self.signal(name, signal.SIGCONT)
        codes = self._launcher.stop()
        for name, code in codes.items():
            if code:
                print(
                    f"{name} has ended with {code}: {self._launcher.children[name].last_lines()}",
                    flush=True,
                )
        return codes

    def start_over(self, patience_s: float) -> bool:
        """After a trial without recovery: end all parts and start them again."""
        self.stop()
        return self.spin_until(self.healthy, patience_s)

    def largest_move_taken(self) -> float:
        """Largest move of the set-points that the machine accepted from what it had in force."""
        log = self._launcher.children["machine"].log.read_text(encoding="utf-8")
        return max(
            (float(move) for move in re.findall(r"largest move so far: ([\d.]+)", log)),
            default=1.0,
        )

    def bags(self) -> dict[str, int]:
        """Numbers of bags, of readable ones, and of their commands against those seen."""
        return bags_in(self._folder) | {"commands": self.observer.seen}

    # ---------------------------------------------------------------- what is seen

    def healthy(self) -> bool:
        """Whether all parts are there and a controller answered each of the last ticks."""
        now_s = time.monotonic()
        running = all(child.running for child in self._launcher.children.values())
        good = running and self.observer.commanded(now_s) and self._page.answers(now_s)
        if good:
            self.healthy_since_s = now_s - HEALTHY_TICKS * weld.TICK_S
        return good

    def describe(self) -> str:
        """What an engineer would want to see when nothing recovers."""
        seen = self.observer
        state = "no state"
        if seen.state is not None:
            state = f"{seen.state.actual_mode} {seen.state.actual_controller}: {seen.state.reason}"
        away = [name for name, child in self._launcher.children.items() if not child.running]
        age_s = time.monotonic() - seen.ticks[-1][1] if seen.ticks else inf
        newest = [seen.answered.get(stamp_ns, "-") for stamp_ns, _ in list(seen.ticks)[-5:]]
        return (
            f"{state}; away: {away}; newest tick {age_s:.1f} s ago, answered by {newest}; "
            f"page {self._page.is_there}"
        )

    def spin_for(self, seconds: float) -> None:
        """Let time pass."""
        self.spin_until(lambda: False, seconds)

    def spin_until(self, condition: Callable[[], bool], patience_s: float) -> bool:
        """Spin, start parts again and play the operator until a condition holds.

        Returns whether it does.
        """
        end_s = time.monotonic() + patience_s
        while time.monotonic() < end_s:
            self.spin()
            self._keep(time.monotonic())
            self.observer.operate(time.monotonic())
            if condition():
                return True
        return False

    def _keep(self, now_s: float) -> None:
        for name, child in self._launcher.children.items():
            if not child.running and now_s > self._died_s.setdefault(name, now_s) + RESPAWN_S:
                del self._died_s[name]
                self._start(name)
                return

    # ---------------------------------------------------------------- floods

    def flood(self, target: str, lasting_s: float) -> None:
        """Send a lot of nonsense for a while, as a stranger on the network."""
        end_s = time.monotonic() + lasting_s
        if target == "page":
            while time.monotonic() < end_s:
                self._page.look()
                self.spin_until(lambda: False, 0.005)
            return
        kind, topic, make = nonsense(self.observer.ticks[-1][0])[target]
        publisher = self._node.create_publisher(
            kind, topic, LATCHED if target == "reference" else 10
        )
        while time.monotonic() < end_s:
            for number in range(_FLOOD_PER_SPIN):
                publisher.publish(make(number))
            self.spin_until(lambda: False, 0.02)
        self._node.destroy_publisher(publisher)
        if target == "reference":
            self._refer()

    def _refer(self) -> None:
        self._references.publish(
            convert.reference_message(Reference(weld.DEPTH_MM, weld.TEMPERATURE_C), 0)
        )
