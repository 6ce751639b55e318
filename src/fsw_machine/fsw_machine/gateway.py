"""Rules of the gateway: what is published of a read, and which commands are written.

No middleware, no OPC UA: all inputs and times are arguments.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf, nan
from typing import Any, NamedTuple

from fsw_control import weld
from fsw_control.coded import Fact, Worded
from fsw_control.command_gate import CommandGate, refusal
from fsw_control.contract import Command, Limits
from fsw_control.depth_footprint import Footprint
from fsw_control.depth_fusion import DepthEstimate
from fsw_control.fence import LOST_COMMANDS, UNSIGNED, Fence, Signature
from fsw_control.message_synchronizer import JUMP_NS
from fsw_control.sensors import SENSORS
from fsw_control.stop import StopCause
from fsw_control.units import NANOSECONDS
from fsw_machine.machine_file import MachineFile
from fsw_machine.samples import CycleRead, Sample, Stamps, bit, fault_of, sample
from fsw_model.fused_depth import FusedDepth

#: pause after which supervisor and controllers restart from the drives' feedback: 20 % above their
#: limit
PAUSE_S = 1.2 * JUMP_NS / NANOSECONDS
#: number of cycles for which a read is fresh
FRESH_CYCLES = 2.5
#: after single lost commands the next one is cut to one move: for up to this many cycles, up to
#: this many moves away
_CATCH_UP = 3
#: cycles by which a machine may show an accepted command late
_SHOWN_CYCLES = 1
#: smaller differences, in moves, are the same set-point rounded by the node's type
_SAME = 0.01
#: largest rounding of a node's type, in moves, e.g. whole kN (chosen)
_ROUNDED = 0.6
#: cycles after a command until every machine shows it as in force (chosen)
_SETTLED_CYCLES = 3
#: number of ticks whose counter is kept
_KEPT = 32
#: nodes without a number
_NO_NUMBERS = ("cycle", "permissive", "touch_off")


class Rejection(Worded):
    """Reasons for a rejection in addition to the gate's."""

    DISCONNECTED = "there is no connection to the machine"
    NOT_PERMISSIVE = "the machine does not permit it: {fault}"
    STALE_READ = "the machine was last read {age_s:.2f} s ago"
    PAUSED = "control restarts from the drives' values after a pause in the measurements"
    UNKNOWN_STAMP = "it answers {stamp_s:.3f} s, at which nothing was measured"
    UNANSWERED = "the server has not answered the write of {since_s:.3f} s ago"
    JUMP = "{jump.words} from the set-points in force at the machine"
    OUTSIDE = (
        "{jump.words} from the set-points in force at the machine, which is outside the limits: "
        "the machine has to bring it back"
    )
    NOT_KNOWN = "the set-points in force are not known: {fault}"


@dataclass(frozen=True, slots=True)
class Publication:
    """The samples of one tick, NaN where they must not be used (mm, N m, degC, kN, rpm)."""

    stamp_ns: int
    values: Mapping[str, float]  #: by sensor
    drives: Command
    fused: DepthEstimate | None = None  #: estimate behind a fused depth


@dataclass(frozen=True, slots=True)
class Order:
    """An accepted command of ``source``: the nodes' numbers, and the answered cycle as heartbeat.

    ``before`` is what the machine had at acceptance, ``stamp_ns`` the stamp of the measurement.
    """

    command: Command
    force: float
    speed: float
    heartbeat: int
    accepted_s: float
    before: Command
    source: str
    stamp_ns: int


class _Write(NamedTuple):
    """A sent order, and the cycle of the server's answer, a success or a failure."""

    order: Order
    cycle: int
    acknowledged: bool


class _SensorFusion:
    """The depth of several sensors, which are calibrated afresh by each touch-off."""

    def __init__(self, machine: MachineFile, footprint: Footprint | None) -> None:
        self._touch_off = machine.nodes.touch_off
        self._counted: int | None = None
        self._fused: FusedDepth | None = None
        if (part := machine.depth_fusion) is not None:
            self._fused = FusedDepth(footprint, part.touch_off_kn, machine.depth_sensors)

    def update(
        self, read: CycleRead, samples: Mapping[str, Sample], stamp_ns: int
    ) -> DepthEstimate | None:
        """The depth at a cycle; None if the machine delivers it."""
        if self._fused is None or self._touch_off is None:
            return None
        raw = read.values["touch_off"]
        if isinstance(raw.value, int) and not fault_of(raw, self._touch_off, read.source_ns):
            if self._counted not in (None, raw.value):
                self._fused.reset()
            self._counted = raw.value
        value = {name: entry.value for name, entry in samples.items()}
        return self._fused.update(
            stamp_ns / NANOSECONDS,
            {name: value.get(row.stem, nan) for name, row in SENSORS.items()},
            Command(value["force_acting"], value["speed_acting"]),
            value.get("angle", nan),
            value.get("travel", nan),
        )


def _rules(values: Mapping[str, Any]) -> tuple[Limits, float, list[str]]:
    """Arguments of the gate."""
    limits = Limits.from_parameters(values)
    return limits, values["commands.max_age_s"], values["commands.sources"]


class Gateway:
    """Decides on each read and command, in one thread; all times are passed in (steady seconds).

    Commands reach the machine only while it is *joined*: the measurements have paused for
    ``PAUSE_S`` since commands last failed to reach it. After such a pause supervisor and
    controllers restart from the drives' feedback: in that cycle the set-points in force, with
    which commands are compared, instead of a load cell's values. The first command is therefore
    bumpless. While commands do not arrive the drives are not reported: they do not follow, and
    that must not be mistaken for an external disturbance.

    Every written command is within the bounds and within one move of the machine's set-points:
    those that it shows, or, in the cycle in which it may not show it yet, the last acknowledged
    write. While the arrival of a write is uncertain, both possibilities count. A command up to
    ``_CATCH_UP`` moves away, because single ones before it were lost, is cut to one move; any
    other is rejected. A command that arrives while a write is unanswered waits for the answer.
    """

    def __init__(
        self, machine: MachineFile, values: Mapping[str, Any], footprint: Footprint | None = None
    ) -> None:
        self._machine = machine
        self._depth = _SensorFusion(machine, footprint)
        #: counts all rejections
        self.gate = CommandGate(*_rules(values), tuple(Rejection))
        self.fence = Fence()  #: the leader, and any safe stop in force
        self.stamps = Stamps(weld.TICK_NS, values["clock.stamps"] == "received")
        self.connected = self.permissive = self.joined = False
        self.samples: dict[str, Sample] = {}  #: of the last read
        self.read: CycleRead | None = None  #: the last read
        #: published ticks, reads withheld for a pause, and invalid values
        self.ticks = self.paused = self.invalid = 0
        #: written commands, those not accepted by the server, and those cut to one move
        self.written = self.failed = self.cut = 0
        self.last_failure = ""  #: why the server has not accepted the last of these
        self._counters: dict[int, int] = {}
        self._stamp_ns: int | None = None
        self._published_s = -inf
        self._under_way: Order | None = None
        self._waiting: tuple[Command, int, int, str, Signature] | None = None
        # what may have reached the machine and was not seen to be in force yet
        self._sent: list[Command] = []
        self._seen: Command | None = None  # in force at the last read so long after a command
        self._sent_cycle = 0
        self._writes: list[_Write] = []
        self._lost = self._cycle = 0

    def configure(self, values: Mapping[str, Any]) -> None:
        """Apply new parameters of the node, keeping the state.

        Raises
        ------
        ValueError
            If a minimum is not below its maximum.
        """
        self.gate.configure(*_rules(values))

    # ---------------------------------------------------------------- the server

    def on_connected(self) -> None:
        """Note that the server's nodes can be read and written."""
        self.connected, self.samples = True, {}
        self._part()

    def on_lost(self) -> None:
        """Note that the connection is lost."""
        self.connected = self.permissive = False
        self._part()

    def _part(self) -> None:
        """Note that commands no longer reach the machine."""
        if self._waiting is not None:
            self.gate.refuse(self._unanswered(self.read.read_s if self.read else 0.0))
        self.joined = False
        self._lost = 0
        self._under_way = self._waiting = None
        self._writes = []

    def on_read(self, read: CycleRead) -> Publication | None:
        """Process the read of a new cycle; returns the tick to publish, None during a pause."""
        nodes, cycle_ns, now_s = self._machine.nodes, read.source_ns, read.read_s
        elapsed_s = 0.0 if self.read is None else now_s - self.read.read_s
        elapsed_ns = round(elapsed_s * NANOSECONDS)
        stamp_ns = self.stamps.next(cycle_ns, read.steps, read.read_ns, elapsed_ns)
        self.read = read
        self._cycle += max(read.steps, 1)
        numbers = (name for name in nodes.read if name not in _NO_NUMBERS)
        self.samples = {name: sample(read.values[name], nodes[name], cycle_ns) for name in numbers}
        self.samples["permissive"] = bit(read.values["permissive"], nodes["permissive"], cycle_ns)
        self.invalid += sum(bool(entry.fault) for entry in self.samples.values())
        self.permissive = self.samples["permissive"].value == 1.0
        self._note_safe_reaction(stamp_ns)
        fused = self._depth.update(read, self.samples, stamp_ns)
        begins = False
        # then the command in force is unknown to every supervisor
        given_up = self._lost and self.fence.state.unanswered >= LOST_COMMANDS
        if not self.permissive or given_up:
            self._part()
        elif not self.joined:
            if now_s - self._published_s < PAUSE_S:
                self.paused += 1
                return None
            self.joined = begins = True
        self._stamp_ns, self._published_s = stamp_ns, now_s
        self.fence.measure()
        self._counters[stamp_ns] = read.counter
        if len(self._counters) > _KEPT:
            del self._counters[next(iter(self._counters))]
        self.ticks += 1
        value = {name: entry.value for name, entry in self.samples.items()}
        obeys = self.joined and not self._lost and self._under_way is None
        kind = "in_force" if begins else "acting"
        ends = (value[f"force_{kind}"], value[f"speed_{kind}"]) if obeys else (nan, nan)
        values = {name: value[row.stem] for name, row in SENSORS.items() if row.stem in value}
        if fused is not None:
            values["depth"] = fused.depth_mm
        return Publication(stamp_ns, values, Command(*ends), fused)

    def _note_safe_reaction(self, stamp_ns: int) -> None:
        """Begin a safe stop if the machine has moved by itself: its watchdog, or a hand.

        Some cycles after the last command, the set-points in force are unchanged, or those of a
        command whose arrival was uncertain.
        """
        force, speed = self.samples["force_in_force"], self.samples["speed_in_force"]
        if force.fault or speed.fault or self._cycle - self._sent_cycle <= _SETTLED_CYCLES:
            return
        shown = Command(force.value, speed.value)
        stays = self._seen is not None and self._is_same(shown, self._seen)
        arrived = any(self._is_same(shown, sent, _ROUNDED) for sent in self._sent)
        if (self._seen or self._sent) and not stays and not arrived:
            self.fence.stop(StopCause.WATCHDOG, stamp_ns)
        self._seen = shown
        if self._under_way is None:
            self._sent = []

    # ---------------------------------------------------------------- commands

    def on_command(
        self,
        command: Command,
        stamp_ns: int,
        source: str,
        healthy: bool,
        now_s: float,
        signature: Signature = UNSIGNED,
    ) -> Order | None:
        """Process a command; returns the values to write, None if rejected (see ``gate``)."""
        if why := self._refused(signature, source, now_s):
            self.gate.refuse(why)
            return None
        if self.gate.check(command, stamp_ns, source, healthy, self._stamp_ns):
            return None
        counter = self._counters.get(stamp_ns)
        if counter is None:
            self.gate.refuse(Fact.of(Rejection.UNKNOWN_STAMP, stamp_s=stamp_ns / NANOSECONDS))
            return None
        if self._under_way is not None:
            overtaken = self._waiting
            self._waiting = command, stamp_ns, counter, source, signature
            if overtaken is not None:
                self.gate.refuse(self._unanswered(now_s))
                self._lose()
            return None
        return self._order(command, stamp_ns, counter, source, now_s)

    def _order(
        self, command: Command, stamp_ns: int, counter: int, source: str, now_s: float
    ) -> Order | None:
        """Accept a command, cut to one move if it may catch up; else reject it."""
        has = self._may_have()
        jump = self._jump(command, has)
        if jump and self._may_catch_up(command, has):
            for possible in has:
                command = self.gate.limits.clip(command, possible)
            jump = self._jump(command, has)
            self.cut += jump is None
        if jump:
            self.gate.refuse(jump)
            self._lose()
            return None
        nodes = self._machine.nodes
        force = nodes["force_setpoint"].number(command.force_kn)
        speed = nodes["speed_setpoint"].number(command.speed_rpm)
        self._under_way = Order(command, force, speed, counter, now_s, has[0], source, stamp_ns)
        self._sent.append(command)
        self._sent_cycle = self._cycle
        return self._under_way

    def _unanswered(self, now_s: float) -> Fact:
        began_s = self._under_way.accepted_s if self._under_way else now_s
        return Fact.of(Rejection.UNANSWERED, since_s=max(0.0, now_s - began_s))

    def _refused(self, signature: Signature, source: str, now_s: float) -> Fact | None:
        """Why no command of this kind may be written; None if it may."""
        return self.fence.check(signature, source) or self._closed(now_s)

    def _closed(self, now_s: float) -> Fact | None:
        """Why nothing may be written at present."""
        if not self.connected or self.read is None or not self.samples:
            return Fact.of(Rejection.DISCONNECTED)
        if not self.permissive:
            fault = self.samples["permissive"].fault or "bit is 0"
            return Fact.of(Rejection.NOT_PERMISSIVE, fault=fault)
        age_s = now_s - self.read.read_s
        if age_s > FRESH_CYCLES * weld.TICK_S:
            return Fact.of(Rejection.STALE_READ, age_s=age_s)
        return None if self.joined else Fact.of(Rejection.PAUSED)

    def _may_have(self) -> list[Command]:
        """All set-points that the machine may have now, the likeliest first; empty if unknown.

        - Those that it shows, unless they are only those before the last acknowledged write: it
          then has that write already and shows it in the next cycle.
        - The last acknowledged write, in the one cycle in which it may not show it yet. If it
          shows anything else than what was there before, it may show an earlier write, or move by
          itself.
        - Every later write that may have arrived although the server answered with a failure, for
          the same time.
        """
        force, speed = self.samples["force_in_force"], self.samples["speed_in_force"]
        if force.fault or speed.fault:
            return []
        shown = Command(force.value, speed.value)
        recent = [write for write in self._writes if self._cycle - write.cycle <= _SHOWN_CYCLES]
        written = [write.order.command for write in recent]
        if recent and recent[0].acknowledged and self._is_same(shown, recent[0].order.before):
            return written
        return [shown, *written]

    def _is_same(self, a: Command, b: Command, moves: float = _SAME) -> bool:
        limits = self.gate.limits
        near = abs(a.force_kn - b.force_kn) <= moves * limits.force_step_kn
        return near and abs(a.speed_rpm - b.speed_rpm) <= moves * limits.speed_step_rpm

    def _may_catch_up(self, command: Command, has: list[Command]) -> bool:
        """Whether a command may be cut to one move, because single ones before it were lost."""
        cycles = [self._cycle - write.cycle for write in self._writes if write.acknowledged]
        if min(cycles, default=_CATCH_UP + 1) > _CATCH_UP:
            return False
        limits = self.gate.limits
        force_kn, speed_rpm = _CATCH_UP * limits.force_step_kn, _CATCH_UP * limits.speed_step_rpm
        moves = replace(limits, force_step_kn=force_kn, speed_step_rpm=speed_rpm)
        return all(refusal(command, moves, possible) is None for possible in has)

    def _jump(self, command: Command, has: list[Command]) -> Fact | None:
        """Why a command is too far from the machine's set-points; None if it is not."""
        if not has:
            fault = self.samples["force_in_force"].fault or self.samples["speed_in_force"].fault
            return Fact.of(Rejection.NOT_KNOWN, fault=fault)
        limits = self.gate.limits
        jump = next(filter(None, (refusal(command, limits, possible) for possible in has)), None)
        if jump is None:
            return None
        inside = refusal(limits.clip(has[0], None), limits, has[0]) is None
        return Fact.of(Rejection.JUMP if inside else Rejection.OUTSIDE, jump=jump.fact)

    def _lose(self) -> None:
        self._lost += 1
        if self._lost >= LOST_COMMANDS:
            self._part()

    def on_written(self, order: Order, failure: str, now_s: float) -> Order | None:
        """Take the server's answer to an order; return the order that waited for it, if any.

        ``failure`` is why the order was not accepted; empty if it was.
        """
        if order is not self._under_way:
            return None
        self._under_way = None
        if failure:
            self.failed += 1
            self.last_failure = failure
            self.fence.doubt()
            self._writes.append(_Write(order, self._cycle, acknowledged=False))
            self._lose()
        else:
            self.written += 1
            self.fence.take(order.source, order.stamp_ns)
            self._sent = [order.command]
            self._writes = [_Write(order, self._cycle, acknowledged=True)]
            self._lost = 0
        waiting, self._waiting = self._waiting, None
        if waiting is None:
            return None
        command, stamp_ns, counter, source, signature = waiting
        # a safe stop may have begun meanwhile
        if why := self._refused(signature, source, now_s):
            self.gate.refuse(why)
            return None
        return self._order(command, stamp_ns, counter, source, now_s)
