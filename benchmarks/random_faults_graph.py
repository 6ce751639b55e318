"""A weld as processes to which anything may be done: starts parts again, plays the operator, keeps the score."""

from __future__ import annotations

import re
import signal
import time
from collections import deque
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.request import urlopen

import rclpy
from random_faults_floods import SOURCE, nonsense
from rclpy.context import Context
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

from fsw_control import messages_ros as convert
from fsw_control import weld
from fsw_control.contract import Command, Reference
from fsw_control.topics_ros import LATCHED, LATEST
from fsw_control.units import NANOSECONDS
from fsw_msgs.msg import DriveFeedback, ShoulderDepth, SupervisorState, WeldCommand, WeldReference
from fsw_msgs.srv import SetMode
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.errors import BagError
from fsw_scenario.launcher import Launcher
from fsw_test_support.machine import Proxy, free_port, write_machine_file
from fsw_test_support.machine_server import MACHINE_FILE, moves_between
from fsw_test_support.ros_graph import Spinner

_CONTROL = {
    "nmpc": "fsw_nmpc.nmpc_node",
    "decentral": "fsw_decentral.decentral_node",
    "supervisor": "fsw_supervisor.supervisor_node",
    "standby": "fsw_supervisor.supervisor_node",
    "recorder": "fsw_recorder.recorder_node",
    "page": "fsw_hmi.main",
}
#: by part, the module whose ``main`` it is
EMULATOR = {"plant": "fsw_plant.plant_node", **_CONTROL}
MACHINE = {"machine": "fsw_test_support.machine_server", "gateway": "fsw_machine.machine_node", **_CONTROL}
SUPERVISOR = (
    *("controller:=nmpc", "fallbacks:=[decentral, nmpc]", "readmit_ticks:=10", "return_to_target:=true"),
    *(f"interlocks.temperature_{name}" for name in ("low.warn:=210.0", "low.trip:=200.0", "high.trip:=1000.0")),
    *("interlocks.temperature_high.warn:=950.0", "storm_swaps:=0"),
)
#: ticks in a row with a controller's command, after which the graph counts as healthy
HEALTHY_TICKS = 20
RESPAWN_S = 0.5
#: the machine's clock is stepped by this, and back
CLOCK_STEP_S = 300.0
_DEEP = QoSProfile(depth=2000)
_TICK_NS = round(weld.TICK_S * NANOSECONDS)
_FLOOD_PER_SPIN = 40


def bags_in(folder: Path) -> dict[str, int]:
    """How many bags are in a folder, how many of them can be read to their end, and commands in them."""
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
        found = re.search(r"http://\S+", self._launcher.children["page"].text())
        try:
            with urlopen(found[0] if found else "", timeout=0.5) as response:
                self.is_there = response.status == 200
        except (URLError, OSError, ValueError):
            self.is_there = False


class FaultyGraph(Spinner):
    """The processes of a weld and one observer; a context.

    Parameters
    ----------
    parts : dict of str to str
        ``EMULATOR`` or ``MACHINE``.
    folder : Path
        Gets logs and bags.
    domain : int
    """

    def __init__(self, parts: dict[str, str], folder: Path, domain: int) -> None:
        self.parts, self.has_machine = tuple(parts), "machine" in parts
        self.floods = ("depth", "proposal", "command", "reference", "switch", "page")
        self._modules, self._folder = parts, folder
        self._launcher = Launcher(folder / "log", domain)
        self._context = Context()
        rclpy.init(args=[], context=self._context, domain_id=domain)
        super().__init__(self._context)
        self._died_s: dict[str, float] = {}
        self._page, self._operator_s = PageProbe(self._launcher), 0.0
        self._pending: list[Any] = []
        self.healthy_since_s = 0.0
        self._proxy: Proxy | None = None
        self._machine_file = Path()
        self._observe()
        self.begin_trial()

    def __enter__(self) -> FaultyGraph:
        self._folder.mkdir(parents=True, exist_ok=True)
        if self.has_machine:
            text = MACHINE_FILE.read_text(encoding="utf-8")
            port = free_port()
            self._server_file = write_machine_file(self._folder / "server.yaml", port, text)
            self._proxy = Proxy(port)
            self._machine_file = write_machine_file(self._folder / "machine.yaml", self._proxy.port, text)
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
            arguments = ["--machine-file", str(self._server_file), "--clock-step-s", str(CLOCK_STEP_S)]
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
            arguments = ["--ros-args", *(word for setting in settings for word in ("-p", setting)), *rename]
        self._launcher.start(name, self._modules[name], arguments)

    def signal(self, name: str, number: int) -> None:
        """Send a signal to a part that runs."""
        child = self._launcher.children[name]
        if child.running:
            child.process.send_signal(number)

    def cut_link(self, lasting_s: float) -> None:
        """Break the connections between gateway and machine, and let nothing through for a while."""
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
                print(f"{name} has ended with {code}: {self._launcher.children[name].last_lines()}", flush=True)
        return codes

    def start_over(self, patience_s: float) -> bool:
        """After a trial without recovery: end all parts and start them again."""
        self.stop()
        return self.spin_until(self.healthy, patience_s)

    def largest_move_taken(self) -> float:
        """Largest move of the set-points that the machine accepted from what it had in force."""
        log = self._launcher.children["machine"].log.read_text(encoding="utf-8")
        return max((float(one) for one in re.findall(r"largest move so far: ([\d.]+)", log)), default=1.0)

    def bags(self) -> dict[str, int]:
        """How many bags there are, how many can be read to their end, and commands in them against those seen."""
        return bags_in(self._folder) | {"commands": self._seen}

    # ---------------------------------------------------------------- what is seen

    def _observe(self) -> None:
        self._node = node = rclpy.create_node("random_faults", context=self._context)
        self.executor.add_node(node)
        self._drives: dict[int, Command] = {}
        self._answered: dict[int, str] = {}
        #: stamp and time of receipt of each tick; the stamps may step with the machine's clock
        self._ticks: deque[tuple[int, float]] = deque(maxlen=100_000)
        self._state: SupervisorState | None = None
        self._seen = 0
        node.create_subscription(ShoulderDepth, "fsw/depth", self._on_depth, _DEEP)
        node.create_subscription(DriveFeedback, "fsw/drives", self._on_drives, _DEEP)
        node.create_subscription(WeldCommand, "fsw/command", self._on_command, _DEEP)
        node.create_subscription(SupervisorState, "fsw/supervisor/state", self._on_state, LATEST)
        self._acknowledge = node.create_client(Trigger, "fsw/acknowledge")
        self._set_mode = node.create_client(SetMode, "fsw/set_mode")
        self._references = node.create_publisher(WeldReference, "fsw/reference", LATCHED)
        self._references.publish(convert.reference_message(Reference(weld.DEPTH_MM, weld.TEMPERATURE_C), 0))
        self._flooded: dict[str, Any] = {}

    def _on_depth(self, message: ShoulderDepth) -> None:
        if message.header.frame_id == SOURCE:
            return
        stamp_ns, now_s = convert.stamp_ns(message.header.stamp), time.monotonic()
        before_ns, before_s = self._ticks[-1] if self._ticks else (0, now_s)
        if stamp_ns == before_ns:
            return
        # by the receipt and by the stamps: a flood holds up the receipt here, a step of the clock moves the stamps
        gap_s = min(now_s - before_s, abs(stamp_ns - before_ns) / NANOSECONDS)
        self._score["longest_gap_s"] = max(self._score["longest_gap_s"], round(gap_s, 2))
        self._ticks.append((stamp_ns, now_s))
        self._score["ticks"] += 1

    def _on_drives(self, message: DriveFeedback) -> None:
        stamp_ns = convert.stamp_ns(message.header.stamp)
        acting = convert.command(message)
        before_ns, before = self._drives.popitem() if self._drives else (0, acting)
        if abs(stamp_ns - before_ns - _TICK_NS) < _TICK_NS // 2:
            self._score["acting_moves"] = max(self._score["acting_moves"], moves_between(acting, before))
        self._drives = {stamp_ns: acting}

    def _on_command(self, message: WeldCommand) -> None:
        if message.source == SOURCE:
            return
        self._seen += 1
        stamp_ns = convert.stamp_ns(message.header.stamp)
        self._answered[stamp_ns] = message.source
        acting = self._drives.get(stamp_ns)
        if acting is not None:
            self._score["command_moves"] = max(
                self._score["command_moves"], moves_between(convert.command(message), acting)
            )

    def _on_state(self, message: SupervisorState) -> None:
        if message.actual_mode == "safe_stop" and (self._state is None or self._state.actual_mode != "safe_stop"):
            self._score["safe_stops"] += 1
        self._state = message

    def healthy(self) -> bool:
        """Whether all parts are there and each of the last ticks was answered with a controller's command."""
        now_s = time.monotonic()
        last = list(self._ticks)[-HEALTHY_TICKS - 2 : -2]  # the newest may still be under way
        good = (
            len(last) == HEALTHY_TICKS
            and now_s - last[0][1] < 2 * HEALTHY_TICKS * weld.TICK_S
            and last[0][1] >= self._begun_s
            and all(self._answered.get(stamp_ns) in ("nmpc", "decentral") for stamp_ns, _ in last)
            and now_s - self._ticks[-1][1] < 0.5
            and all(child.running for child in self._launcher.children.values())
            and self._page.answers(now_s)
        )
        if good:
            self.healthy_since_s = now_s - HEALTHY_TICKS * weld.TICK_S
        return good

    def describe(self) -> str:
        """What an engineer would want to see when nothing recovers."""
        state = self._state
        text = "no state" if state is None else f"{state.actual_mode} {state.actual_controller}: {state.reason}"
        away = [name for name, child in self._launcher.children.items() if not child.running]
        age_s = time.monotonic() - self._ticks[-1][1] if self._ticks else inf
        newest = [self._answered.get(stamp_ns, "-") for stamp_ns, _ in list(self._ticks)[-5:]]
        return f"{text}; away: {away}; newest tick {age_s:.1f} s ago, answered by {newest}; page {self._page.is_there}"

    # ---------------------------------------------------------------- a trial

    def begin_trial(self) -> None:
        """Set the score to nothing."""
        self._begun_s = time.monotonic()
        names = ("ticks", "safe_stops", "operator_requests", "command_moves", "acting_moves", "longest_gap_s")
        self._score: dict[str, Any] = dict.fromkeys(names, 0)

    def end_trial(self) -> dict[str, Any]:
        """The score since :meth:`begin_trial`."""
        some = [stamp_ns for stamp_ns, heard_s in list(self._ticks)[:-2] if heard_s >= self._begun_s]
        return {**self._score, "ticks_without_command": sum(stamp_ns not in self._answered for stamp_ns in some)}

    def spin_for(self, seconds: float) -> None:
        """Let time pass."""
        self.spin_until(lambda: False, seconds)

    def spin_until(self, condition: Callable[[], bool], patience_s: float) -> bool:
        """Spin, start parts again and play the operator until a condition holds; returns whether it does."""
        end_s = time.monotonic() + patience_s
        while time.monotonic() < end_s:
            self.spin()
            self._keep(time.monotonic())
            self._operate(time.monotonic())
            if condition():
                return True
        return False

    def _keep(self, now_s: float) -> None:
        for name, child in self._launcher.children.items():
            if not child.running and now_s > self._died_s.setdefault(name, now_s) + RESPAWN_S:
                del self._died_s[name]
                self._start(name)
                return

    def _operate(self, now_s: float) -> None:
        """Once a second: what an operator does who wants to go on welding."""
        if self._state is None or now_s < self._operator_s + 1.0:
            return
        self._operator_s = now_s
        if self._state.actual_mode == "safe_stop" and self._acknowledge.service_is_ready():
            self._pending.append(self._acknowledge.call_async(Trigger.Request()))
            self._score["operator_requests"] += 1
        if self._state.actual_mode in ("safe_stop", "hold", "manual") and self._set_mode.service_is_ready():
            self._pending.append(self._set_mode.call_async(SetMode.Request(mode="auto")))
        self._pending = [future for future in self._pending if not future.done()][-20:]

    # ---------------------------------------------------------------- floods

    def flood(self, target: str, lasting_s: float) -> None:
        """Send a lot of nonsense for a while, as a stranger on the network."""
        end_s = time.monotonic() + lasting_s
        if target == "page":
            while time.monotonic() < end_s:
                self._page.look()
                self.spin_until(lambda: False, 0.005)
            return
        kind, topic, make = nonsense(self._ticks[-1][0])[target]
        publisher = self._node.create_publisher(kind, topic, LATCHED if target == "reference" else 10)
        while time.monotonic() < end_s:
            for number in range(_FLOOD_PER_SPIN):
                publisher.publish(make(number))
            self.spin_until(lambda: False, 0.02)
        self._node.destroy_publisher(publisher)
        if target == "reference":
            self._references.publish(convert.reference_message(Reference(weld.DEPTH_MM, weld.TEMPERATURE_C), 0))
