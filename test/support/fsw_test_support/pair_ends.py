"""The actuator ends of a pair's world: the plant, and the gateway with a PLC behind it."""

from __future__ import annotations

from fsw_control.command_gate import CommandGate
from fsw_control.contract import Command
from fsw_control.fence import Fence, Signature
from fsw_control.stop import Stop, StopCause
from fsw_control.units import NANOSECONDS
from fsw_control.weld import TICK_NS, TICK_S
from fsw_machine.gateway import Order
from fsw_machine.samples import CycleTracker
from fsw_plant.emulator import Watchdog, WatchdogState
from fsw_plant.pace import TickStamps
from fsw_test_support.pair_parts import Holder
from fsw_test_support.pair_settings import (
    CONFIG,
    DEPTH_MM,
    HOME,
    SETTINGS,
    TORQUE_NM,
    TORQUE_NM_PER_KN,
)
from fsw_test_support.plc import Plc, new_gateway
from fsw_test_support.supervisor_pair import SUPERVISORS, Process, World

#: states of the link between gateway and PLC; ``deaf``: writes do not arrive, ``mute``: the
#: answers do not, ``slow``: they are late
PLC_LINKS = ("well", "lost", "deaf", "mute", "slow")
#: time of a read or write, of a slow answer, and after which a write counts as failed [s]
_FLIGHT_S, _SLOW_S, _TIMEOUT_S = 0.002, 0.15, 0.4
#: what a machine moves by itself and is not noticed: within a move, or, by the gateway, within a
#: node's rounding [kN]
_MOVE_KN = SETTINGS.drive_limits.force_step_kn
_ROUNDED_KN = 0.6 * _MOVE_KN


class ActuatorEnd(Holder):
    """What plant and gateway have in common: they measure, and hold fence and register."""

    def __init__(self, name: str, world: World) -> None:
        super().__init__(name, world)
        self.fence = Fence()

    @property
    def is_well(self) -> bool:
        """Whether it measures, and commands that it takes act."""
        return True

    def on_stop(self, stop: Stop) -> None:
        """Take another part's copy."""
        self.fence.hear(stop)
        self.look()

    def set_plc(self, state: str) -> None:
        """Disturb the PLC or its link; a plant has none."""

    def _restart(self, fence: Fence) -> None:
        self.fence, self.register, self._published = fence, fence.register, None
        self.world.rules.begins()
        self.repeat()

    def _report(self, stamp_ns: int, drives: Command, values: tuple[float, ...]) -> None:
        """Publish a measurement.

        The drives first, because the sensors' last sample completes the tick.
        """
        world = self.world
        world.broadcast(self.name, SUPERVISORS, "on_drives", self.fence.state, stamp_ns, drives)
        world.broadcast(self.name, SUPERVISORS, "on_samples", stamp_ns, values)
        world.send(self.name, "controllers", "on_samples", stamp_ns, drives)

    def _sensors(self, acting: Command) -> tuple[float, float, float]:
        torque_nm = TORQUE_NM + TORQUE_NM_PER_KN * (acting.force_kn - HOME.force_kn)
        return DEPTH_MM, torque_nm, self.world.temperature_c


class PlantEnd(ActuatorEnd):
    """The plant as ``plant_node.py`` runs its cores; the process itself stands."""

    applied = HOME  #: what acts; outlasts the process

    def begin(self) -> None:
        """Begin as a fresh process: force and speed stay as they are."""
        self.watchdog, self.stamps = Watchdog(CONFIG), TickStamps()
        self.gate = CommandGate(SETTINGS.drive_limits, 0.5)
        self._stamp_ns: int | None = None
        self._stepped_s = self.world.now_s
        self._restart(Fence())
        self.tick()

    def tick(self) -> None:
        """End a step and measure."""
        world = self.world
        if self._stamp_ns is not None:
            self._step(self._stamp_ns)
        self.fence.measure()
        world.rules.measured.append(self.applied)
        steady_ns = round(world.now_s * NANOSECONDS)
        self._stamp_ns = self.stamps.next(world.clock_ns + steady_ns, steady_ns)
        self._report(self._stamp_ns, self.applied, self._sensors(self.applied))
        self.look()
        world.at(world.now_s + TICK_S, self, "tick", is_timer=True)

    def _step(self, stamp_ns: int) -> None:
        if self.fence.overdue:
            self.watchdog.expire()
        was, now_s = self.watchdog.state, self.world.now_s
        before_s, self._stepped_s = self._stepped_s, now_s
        force_kn = self.watchdog.advance(self.applied.force_kn, now_s - before_s)
        self.applied = self.applied._replace(force_kn=force_kn)
        if self.watchdog.state is WatchdogState.SAFE:
            if was is not WatchdogState.SAFE:
                self.world.rules.reacted(now_s)
            self.fence.stop(StopCause.WATCHDOG, stamp_ns)

    def on_command(
        self, signature: Signature, stamp_ns: int, source: str, command: Command
    ) -> None:
        """Take or refuse a command."""
        rules = self.world.rules
        barred = self.fence.check(signature, source)
        refused: str = barred.code if barred else ""
        if not refused:
            refused = self.gate.check(command, stamp_ns, source, True, self._stamp_ns)
        if not refused:
            before, self.applied = self.applied, SETTINGS.drive_limits.clip(command, None)
            self.watchdog.feed()
            self.fence.take(source, stamp_ns)
            late = round(((self._stamp_ns or stamp_ns) - stamp_ns) / TICK_NS)
            rules.acts(signature, stamp_ns, source, command, before, self.world.now_s, late)
            rules.in_force(source)
        elif refused == "repeated":
            rules.refused_as_second(signature)
        self.look()


class MachineProcess(Process):
    """The PLC: it has its own clock, and outlasts every gateway."""

    register = None

    def __init__(self, name: str, world: World, end: GatewayEnd) -> None:
        super().__init__(name, world)
        self.plc, self._end = Plc(CONFIG, HOME), end
        self.link, self.permissive = "well", True
        self.moved_kn = 0.0  #: by itself, since the last command
        self.noticed = False  #: a gateway has read that

    def begin(self) -> None:
        """Begin to cycle."""
        self.cycle()

    def cycle(self) -> None:
        """Let a cycle pass; the gateway sees that the counter has changed."""
        before = self.plc.in_force
        self.plc.cycle()
        self.moved_kn += before.force_kn - self.plc.in_force.force_kn
        self.world.rules.measured.append(self.plc.in_force)
        if self.link != "lost":
            self.world.at(self.world.now_s + _FLIGHT_S, self._end, "on_cycle", is_timer=True)
        self.world.at(self.world.now_s + TICK_S, self, "cycle", is_timer=True)

    def write(self, order: Order) -> None:
        """Take an order, and answer."""
        if self.link == "lost":
            return
        if self.link == "deaf" or not self.permissive:
            failure, answer_s = (
                ("no answer", _TIMEOUT_S) if self.permissive else ("not permitted", _FLIGHT_S)
            )
        else:
            self.plc.take(order.command)
            self.world.rules.in_force(order.source)
            self.moved_kn, self.noticed = 0.0, False
            failure = "no answer" if self.link == "mute" else ""
            answer_s = {"mute": _TIMEOUT_S, "slow": _SLOW_S}.get(self.link, _FLIGHT_S)
        self.world.at(self.world.now_s + answer_s, self._end, "on_written", (order, failure))


class GatewayEnd(ActuatorEnd):
    """The gateway as ``machine_node.py`` runs it, with a PLC that outlasts it."""

    def __init__(self, name: str, world: World) -> None:
        super().__init__(name, world)
        self.machine = MachineProcess("plc", world, self)
        world.rules.most_moves = 1

    @property
    def is_well(self) -> bool:
        """Whether it measures, and commands that it takes act."""
        machine = self.machine
        return machine.link == "well" and machine.permissive and self.gateway.joined

    def begin(self) -> None:
        """Begin as a fresh process, and connect."""
        self.gateway, self.tracker = new_gateway(), CycleTracker(TICK_S)
        self._sent: dict[int, Signature] = {}  # by the stamp of the measurement that is answered
        self._has_written = False  #: so this process knows what was in force
        self._restart(self.gateway.fence)
        if self.life == 0:
            self.machine.begin()
        if self.machine.link != "lost":
            self.gateway.on_connected()

    def set_plc(self, state: str) -> None:
        """Disturb the PLC or its link."""
        machine, was = self.machine, self.machine.link
        if state in ("permits", "forbids"):
            machine.permissive = state == "permits"
            return
        machine.link = state
        if self.alive and (was == "lost") != (state == "lost"):
            self.world.at(self.world.now_s, self, "on_link")

    def on_link(self) -> None:
        """The connection has changed: it is gone, or there again."""
        self.gateway.on_lost()
        if self.machine.link != "lost":
            self.gateway.on_connected()

    def on_cycle(self) -> None:
        """Read the machine as it is now."""
        machine, world = self.machine, self.world
        if machine.link == "lost" or not self.gateway.connected:
            return
        steps = self.tracker.see(machine.plc.counter, world.now_s)
        if steps is None:
            return
        self._notice_reaction()
        clock_ns, acting = world.clock_ns + round(world.now_s * NANOSECONDS), machine.plc.in_force
        sensors, permissive = self._sensors(acting), machine.permissive
        out = self.gateway.on_read(
            machine.plc.read(clock_ns, world.now_s, acting, sensors, steps, permissive)
        )
        if out is not None:
            self._report(out.stamp_ns, out.drives, tuple(out.values.values()))
            self.look()

    def _notice_reaction(self) -> None:
        """A reaction counts once it has been read and is more than a node's rounding, once for each pause of commands.

        A fresh process does not know what was in force before; its leader sees more than one move.
        """
        machine, waits = self.machine, self._has_written and not self.fence.state.source
        if (
            machine.moved_kn > (_ROUNDED_KN if self._has_written else _MOVE_KN)
            and not machine.noticed
        ):
            machine.noticed = True
            if not waits:
                self.world.rules.reacted(
                    self.world.now_s, None if self._has_written else machine.plc.in_force
                )

    def on_command(
        self, signature: Signature, stamp_ns: int, source: str, command: Command
    ) -> None:
        """Take or refuse a command."""
        gateway, now_s = self.gateway, self.world.now_s
        answered_ns = gateway.gate.last_stamp_ns
        order = gateway.on_command(command, stamp_ns, source, True, now_s, signature)
        if gateway.gate.last_stamp_ns != answered_ns:
            self._sent[stamp_ns] = signature
        self.look()
        if order is not None:
            self._write(order)

    def on_written(self, order: Order, failure: str) -> None:
        """Take the server's answer."""
        waiting = self.gateway.on_written(order, failure, self.world.now_s)
        if waiting is not None:
            self._write(waiting)

    def _write(self, order: Order) -> None:
        signature, stamp_ns = self._sent.pop(order.stamp_ns), order.stamp_ns
        before, now_s = self.machine.plc.in_force, self.world.now_s
        self._has_written = True
        self.world.rules.acts(signature, stamp_ns, order.source, order.command, before, now_s)
        self.world.at(now_s + _FLIGHT_S, self.machine, "write", (order,))


ENDS: dict[str, type[PlantEnd | GatewayEnd]] = {"plant": PlantEnd, "gateway": GatewayEnd}
