#!/usr/bin/env python3
"""A weld over a network that loses, delays or is cut.

Plant and recorder on one computer, control on another.

The computers are two network namespaces of Linux with a TAP device each, between which a thread of
this process carries the frames (``tc netem`` is not in every kernel). It needs root. Each weld is
in real time; figures are of the plant's ticks, as the recorder beside it has seen them.

usage: network.py [--quick] [--json FILE]
"""

from __future__ import annotations

import ctypes
import fcntl
import heapq
import itertools
import os
import random
import select
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import _benchmark
import numpy as np

from fsw.console import ProgressBar
from fsw_analysis.signals import load_weld
from fsw_control.contract import SAFE_STOP
from fsw_recorder.bag_reader import BagReader
from fsw_scenario.graph import WeldGraph
from fsw_scenario.launcher import Child, Launcher, LaunchError
from fsw_scenario.scenario_file import load

MACHINE, CONTROL = "fsw_machine", "fsw_control"
ADDRESSES = {MACHINE: "10.77.0.1", CONTROL: "10.77.0.2"}
#: what runs beside the machine
AT_MACHINE = ("plant", "recorder")


class Network(NamedTuple):
    """What happens to the frames of each direction."""

    lost: float = 0.0  #: share
    repeated: float = 0.0  #: share
    delay_s: float = 0.0
    jitter_s: float = 0.0  #: largest difference from the delay; frames overtake each other


NETWORKS = {
    "good": Network(),
    "loses 1 %": Network(lost=0.01),
    "loses 5 %": Network(lost=0.05),
    "loses 20 %": Network(lost=0.2),
    "delays 10 ± 5 ms, repeats 10 %": Network(repeated=0.1, delay_s=0.01, jitter_s=0.005),
}
CUT = Network(lost=1.0)
#: the cable is drawn so long after the first tick, and for how long [s] (chosen)
CUT_AFTER_S, CUT_S = 20.0, 2.0
#: settings of Fast DDS and ROS 2: shared memory would go past the cable
SETTINGS = {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4", "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
_CLONE_NEWNET = 0x40000000
#: request and flags that make a TAP device: frames of Ethernet, nothing before them
_TUNSETIFF, _IFF_TAP, _IFF_NO_PI = 0x400454CA, 0x0002, 0x1000
_LARGEST_FRAME = 2048


def ip(*words: str) -> None:
    """Run ``ip``; its error ends the benchmark."""
    ran = subprocess.run(["ip", *words], capture_output=True, text=True)
    if ran.returncode:
        raise SystemExit(f"network.py: ip {' '.join(words)}: {ran.stderr.strip()} (it needs root)")


@contextmanager
def inside(name: str) -> Iterator[None]:
    """Let this thread, and the processes that it starts, be in a namespace."""
    libc = ctypes.CDLL(None, use_errno=True)
    with open("/proc/thread-self/ns/net") as own, open(f"/run/netns/{name}") as other:
        if libc.setns(other.fileno(), _CLONE_NEWNET):
            raise OSError(ctypes.get_errno(), f"cannot enter the network namespace {name}")
        try:
            yield
        finally:
            libc.setns(own.fileno(), _CLONE_NEWNET)


class Cable(threading.Thread):
    """Carries frames between two TAP devices, as ``network`` says at the time."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.network = Network()
        self._random, self._numbers = random.Random(1), itertools.count()
        self._ends = [self._device(name) for name in ADDRESSES]
        self._ended = False

    @staticmethod
    def _device(name: str) -> int:
        with inside(name):
            descriptor = os.open("/dev/net/tun", os.O_RDWR)
            fcntl.ioctl(
                descriptor, _TUNSETIFF, struct.pack("16sH22x", b"cable", _IFF_TAP | _IFF_NO_PI)
            )
        return descriptor

    def run(self) -> None:
        """Carry frames until it is closed."""
        under_way: list[tuple[float, int, int, bytes]] = []  # due, number, into which end
        others = dict(zip(self._ends, reversed(self._ends), strict=True))
        while not self._ended:
            wait_s = min(0.1, max(0.0, under_way[0][0] - time.monotonic())) if under_way else 0.1
            for end in select.select(self._ends, [], [], wait_s)[0]:
                frame, network = os.read(end, _LARGEST_FRAME), self.network
                for _ in range(1 + (self._random.random() < network.repeated)):
                    if self._random.random() >= network.lost:
                        late_s = (
                            network.delay_s + self._random.uniform(-1.0, 1.0) * network.jitter_s
                        )
                        entry = (
                            time.monotonic() + late_s,
                            next(self._numbers),
                            others[end],
                            frame,
                        )
                        heapq.heappush(under_way, entry)
            while under_way and under_way[0][0] <= time.monotonic():
                _, _, end, frame = heapq.heappop(under_way)
                os.write(end, frame)

    def close(self) -> None:
        """Take it away."""
        self._ended = True
        self.join()
        for end in self._ends:
            os.close(end)


@contextmanager
def two_computers() -> Iterator[Cable]:
    """Two namespaces, joined by a cable."""
    with ExitStack() as undo:
        for name in ADDRESSES:
            ip("netns", "add", name)
            undo.callback(ip, "netns", "del", name)
        cable = Cable()
        for name, address in ADDRESSES.items():
            ip("-n", name, "address", "add", f"{address}/24", "dev", "cable")
            for link in ("lo", "cable"):
                ip("-n", name, "link", "set", link, "up")
            ip(
                "-n", name, "route", "add", "default", "dev", "cable"
            )  # of discovery's multicast, too
        cable.start()
        undo.callback(cable.close)
        yield cable


class TwoComputers(Launcher):
    """Starts each process on its computer."""

    def start(self, name: str, module: str, arguments: Sequence[str] = ()) -> Child:
        """As of the launcher."""
        with inside(MACHINE if name in AT_MACHINE else CONTROL):
            return super().start(name, module, arguments)


def figures_of(bag: Path) -> _benchmark.Figures:
    """What came of a weld."""
    weld = load_weld(bag)
    with BagReader(bag) as reader:
        lost = reader.metadata.custom_data["lost_messages"]
    unanswered = ~np.isfinite(weld.force_kn)
    rows = [0, *(np.flatnonzero(np.diff(unanswered.astype(int))) + 1), unanswered.size]
    longest = max(
        (end - begin for begin, end in itertools.pairwise(rows) if unanswered[begin]), default=0
    )
    return {
        "ticks": weld.n_ticks,
        "ticks without a command": int(unanswered.sum()),
        "of these in a row": int(longest),
        "commands of a safe stop": int(np.sum(weld.command_source == SAFE_STOP)),
        "messages that the bag lacks": lost,
    }


def weld(
    title: str, cable: Cable, network: Network, scenario: Any, folder: Path, cut: bool = False
) -> _benchmark.Figures:
    """Weld once; the cable is as it is to be from the beginning."""
    cable.network = network
    graph = WeldGraph(scenario, folder / "weld", ("nmpc",), realtime=True, standby=True)
    began_s: float | None = None

    def progress(share: float) -> None:
        nonlocal began_s
        if cut and began_s is None and share * scenario.duration_s >= CUT_AFTER_S:
            began_s, cable.network = time.monotonic(), CUT
        elif began_s is not None and time.monotonic() - began_s >= CUT_S:
            cable.network = network

    try:
        with TwoComputers(folder / "log", 0) as launcher:
            graph.run(launcher, progress)
    except LaunchError as error:
        return {f"{title}: failed": str(error)}
    return {f"{title}: {name}": value for name, value in figures_of(graph.bag).items()}


def measure(quick: bool) -> tuple[_benchmark.Figures, _benchmark.Figures]:
    """Figures of all networks, and of one that is cut."""
    os.environ |= SETTINGS
    scenario = load("quick")
    names = ["good", "loses 5 %"] if quick else list(NETWORKS)
    figures: _benchmark.Figures = {}
    with (
        two_computers() as cable,
        tempfile.TemporaryDirectory() as scratch,
        ProgressBar("network") as bar,
    ):
        for index, name in enumerate(names):
            figures |= weld(name, cable, NETWORKS[name], scenario, Path(scratch) / str(index))
            bar((index + 1) / (len(names) + 1))
        title = f"cut for {CUT_S:g} s"
        figures |= weld(title, cable, Network(), scenario, Path(scratch) / "cut", cut=True)
    return figures, {}


def main() -> int:
    """Run the benchmark; returns the exit code: 1 when a weld did not end."""
    figures = _benchmark.run(__doc__, "a good network and one that loses 5 %", measure)
    return int(any("failed" in name for name in figures))


if __name__ == "__main__":
    sys.exit(main())
