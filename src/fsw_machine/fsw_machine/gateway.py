"""The gateway's rules: what of a read is published, and which command is written. No middleware, no OPC UA."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from math import nan
from typing import Any

from fsw_control import weld
from fsw_control.command_check import refusal
from fsw_control.command_gate import CommandGate
from fsw_control.contract import Command, Limits
from fsw_control.message_synchronizer import JUMP_NS
from fsw_control.units import NANOSECONDS
from fsw_machine.machine_file import MachineFile
from fsw_machine.samples import CycleRead, Sample, bit, sample
from fsw_machine.stamps import Stamps

#: why a command can be refused here, besides the reasons of the gate
REASONS = ("disconnected", "not_permissive", "stale_read", "unanswered", "paused", "jump", "unknown_stamp")
#: after a pause of so long supervisor and controllers start over from what the drives report: 20 % above their limit
PAUSE_S = 1.2 * JUMP_NS / NANOSECONDS
#: a read counts as fresh for so many cycles
FRESH_CYCLES = 2.5
#: so many commands in a row that do not reach the machine, and it is started over from the drives
_LOST_COMMANDS = 3
#: for so many cycles after a command was written, the next ones are compared with it
_UNDERWAY_CYCLES = 3
#: ticks of which the counter is known
_KEPT = 32
_NUMBERS = ("depth", "torque", "temperature", "force_acting", "speed_acting", "force_in_force", "speed_in_force")


@dataclass(frozen=True, slots=True)
class Publication:
    """The samples of one tick, NaN where they must not be used (mm, N m, degC, kN, rpm)."""

    stamp_ns: int
    depth_mm: float
    torque_nm: float
    temperature_c: float
    drives: Command


@dataclass(frozen=True, slots=True)
class Order:
    """A command that may be written: the nodes' numbers, and the cycle that it answers as the heartbeat."""

    command: Command
    force: float
    speed: float
    heartbeat: int
    accepted_s: float


class Gateway:
    """Decides about each read and each command, in one thread; every time is handed in (steady seconds).

    Commands reach the machine only while it is *joined*: since the last time that they did not reach it, the
    measurements have paused for ``PAUSE_S``. After such a pause supervisor and controllers start over from what the
    drives report, so the first command is no bump. While commands do not arrive the drives are not reported: they do
    not follow, and that must not be taken for something that pushes them besides.

    Attributes
    ----------
    gate : CommandGate
        Counts all refusals.
    stamps : Stamps
    connected, permissive, joined : bool
    samples : dict of str to Sample
        Of the last read.
    read : CycleRead or None
        The last read.
    ticks, paused, invalid : int
        Ticks published, reads withheld to make a pause, and invalid values seen.
    written, failed : int
        Commands written, and those that the server has not taken.
    last_failure : str
        Why the server has not taken the last of these.
    """

    def __init__(self, machine: MachineFile, values: Mapping[str, Any]) -> None:
        self._machine = machine
        self.gate = CommandGate(Limits(), 0.0, more_reasons=REASONS)
        self.configure(values)
        self.stamps = Stamps(round(weld.TICK_S * NANOSECONDS), values["clock.stamps"] == "received")
        self.connected = self.permissive = self.joined = False
        self.samples: dict[str, Sample] = {}
        self.read: CycleRead | None = None
        self.ticks = self.paused = self.invalid = 0
        self.written = self.failed = 0
        self.last_failure = ""
        self._counters: dict[int, int] = {}
        self._stamp_ns: int | None = None
        self._published_s: float | None = None
        self._under_way: Order | None = None
        self._last_written: Order | None = None
        self._lost = 0

    def configure(self, values: Mapping[str, Any]) -> None:
        """Work with the node's parameters from now on, without forgetting.

        Raises
        ------
        ValueError
            When a minimum is not below its maximum.
        """
        self.gate.configure(limits_from(values), values["commands.max_age_s"], values["commands.sources"])

    # ---------------------------------------------------------------- the server

    def on_connected(self) -> None:
        """The server's nodes can be read and written."""
        self.connected, self.samples = True, {}
        self._part()

    def on_lost(self) -> None:
        """The connection is gone."""
        self.connected = self.permissive = False
        self._part()

    def _part(self) -> None:
        """Commands do not reach the machine any more."""
        self.joined, self._lost = False, 0
        self._under_way = self._last_written = None

    def on_read(self, read: CycleRead) -> Publication | None:
        """Take the read of a new cycle; return what is to be published, None in a pause."""
        nodes, cycle_ns, now_s = self._machine.nodes, read.source_ns, read.read_s
        elapsed_s = 0.0 if self.read is None else now_s - self.read.read_s
        stamp_ns = self.stamps.next(cycle_ns, read.steps, read.read_ns, round(elapsed_s * NANOSECONDS))
        self.read = read
        self.samples = {name: sample(read.values[name], nodes[name], cycle_ns) for name in _NUMBERS}
        self.samples["permissive"] = bit(read.values["permissive"], nodes["permissive"], cycle_ns)
        self.invalid += sum(bool(one.fault) for one in self.samples.values())
        self.permissive = self.samples["permissive"].value == 1.0
        if not self.permissive:
            self._part()
        elif not self.joined:
            if self._published_s is not None and now_s - self._published_s < PAUSE_S:
                self.paused += 1
                return None
            self.joined = True
        self._stamp_ns, self._published_s = stamp_ns, now_s
        self._counters[stamp_ns] = read.counter
        if len(self._counters) > _KEPT:
            del self._counters[next(iter(self._counters))]
        self.ticks += 1
        value = {name: one.value for name, one in self.samples.items()}
        obeys = self.joined and not self._lost and self._under_way is None
        drives = Command(value["force_acting"], value["speed_acting"]) if obeys else Command(nan, nan)
        return Publication(stamp_ns, value["depth"], value["torque"], value["temperature"], drives)

    # ---------------------------------------------------------------- commands

    def on_command(self, command: Command, stamp_ns: int, source: str, healthy: bool, now_s: float) -> Order | None:
        """Take a command; return what is to be written, None if it is refused (``gate`` counts and says why)."""
        reason, words = self._closed(now_s)
        if reason:
            self.gate.refuse(reason, words)
            return None
        if self.gate.check(command, stamp_ns, source, healthy, self._stamp_ns):
            return None
        counter = self._counters.get(stamp_ns)
        if counter is None:
            self.gate.refuse("unknown_stamp", f"it answers {stamp_ns * 1e-9:.3f} s, at which nothing was measured")
            return None
        words = self._jump(command, counter)
        if words or self._under_way is not None:
            before = (
                f"the server has not answered the write of {now_s - self._under_way.accepted_s:.3f} s ago"
                if self._under_way
                else ""
            )
            self.gate.refuse("jump" if words else "unanswered", words or before)
            self._lose()
            return None
        nodes = self._machine.nodes
        force = nodes["force_setpoint"].number(command.force_kn)
        speed = nodes["speed_setpoint"].number(command.speed_rpm)
        self._under_way = Order(command, force, speed, counter, now_s)
        return self._under_way

    def _closed(self, now_s: float) -> tuple[str, str]:
        """Why nothing at all may be written at present."""
        if not self.connected or self.read is None or not self.samples:
            return "disconnected", "there is no connection to the machine"
        if not self.permissive:
            return "not_permissive", f"the machine does not permit it: {self.samples['permissive'].fault or 'bit is 0'}"
        age_s = now_s - self.read.read_s
        if age_s > FRESH_CYCLES * weld.TICK_S:
            return "stale_read", f"the machine was last read {age_s:.2f} s ago"
        if not self.joined:
            return "paused", "commands begin anew from the drives, after a pause in the measurements"
        return "", ""

    def _jump(self, command: Command, counter: int) -> str:
        """Why a command is too far from what acts, empty if it is not.

        After the last command written it may be one move away per cycle, for some cycles: single ones get lost. Then
        what the machine has in force counts.
        """
        force, speed = self.samples["force_in_force"], self.samples["speed_in_force"]
        if force.fault or speed.fault:
            return f"the set-points in force are not known: {force.fault or speed.fault}"
        jump = refusal(command, self.gate.limits, Command(force.value, speed.value))
        if jump is None:
            return ""
        before = self._last_written
        cycles = 0 if before is None else counter - before.heartbeat
        if before is not None and 0 < cycles <= _UNDERWAY_CYCLES:
            limits = self.gate.limits
            moves = replace(
                limits, force_step_kn=cycles * limits.force_step_kn, speed_step_rpm=cycles * limits.speed_step_rpm
            )
            if refusal(command, moves, before.command) is None:
                return ""
        return f"{jump.words} from what the machine has in force"

    def _lose(self) -> None:
        self._lost += 1
        if self._lost >= _LOST_COMMANDS:
            self._part()

    def on_written(self, order: Order, failure: str) -> None:
        """Take the server's answer to an order; ``failure`` says why it was not taken, and is empty if it was."""
        if order is not self._under_way:
            return
        self._under_way = None
        if failure:
            self.failed += 1
            self.last_failure = failure
            self._lose()
        else:
            self.written += 1
            self._last_written, self._lost = order, 0


def limits_from(values: Mapping[str, Any]) -> Limits:
    """Limits from the node's parameters ``limits.*``.

    Raises
    ------
    ValueError
        When a minimum is not below its maximum.
    """
    limits = Limits(**{item.name: values[f"limits.{item.name}"] for item in fields(Limits)})
    if limits.force_min_kn >= limits.force_max_kn or limits.speed_min_rpm >= limits.speed_max_rpm:
        raise ValueError("limits: the minimum of force and of speed must be below the maximum")
    return limits
