"""The arbiter: one command per tick, whatever happens.

Pure: no middleware, every time is handed in (steady seconds), every input is a method, and what has to be sent
comes back as a list of decisions. The modes and their transitions are the table in ``state_machine.py``.
"""

from __future__ import annotations

from collections.abc import Mapping

from fsw_control.command_check import refusal
from fsw_control.contract import SENSORS, Command
from fsw_control.message_synchronizer import StampFilter
from fsw_control.validity import SensorGuard
from fsw_supervisor.arbitration import Arbitration
from fsw_supervisor.controller_registry import ControllerRegistry
from fsw_supervisor.operator_requests import OperatorRequests
from fsw_supervisor.safety_monitor import Interlocks, SafetyMonitor
from fsw_supervisor.settings import ArbiterSettings
from fsw_supervisor.state_machine import OPERATOR_TRIGGERS, Level, Machine, Mode, Trigger
from fsw_supervisor.tick import NANOSECONDS, CommandWatch, Decision, ProposalInput, Tick

#: name under which the drives' feedback of force and speed takes part in the making of ticks
DRIVES = "drives"
#: without measurements for so long, what is applied must be found out anew [s]
_GAP_S = 1.0
#: in real time a stamp far away is believed after so many tick periods in which nothing else has come
_SILENT_TICKS = 2.5


class Arbiter:
    """Begins and ends ticks, hands each to the arbitration, and keeps the books on what is sent.

    Parameters
    ----------
    settings : ArbiterSettings
        Everything that can be set.
    lockstep : bool
        Whether the plant waits for the command, so that the wall clock only guards.
    guard : SensorGuard, optional
        Judge of the sensors.
    interlocks : Interlocks, optional
        Judge of the process.

    Attributes
    ----------
    machine : Machine
        Mode, active controller, target, reasons, events.
    safety : SafetyMonitor
        Sensors and interlocks.
    registry : ControllerRegistry
        The controllers and what is known of them.
    operator : OperatorRequests
        Where the operator asks: ``ask_switch``, ``ask_mode``.
    watch : CommandWatch
        Tells own commands from foreign ones.
    last : Decision or None
        The last decision.
    on_duty : bool
        Off duty it rehearses: decides every tick, sends nothing and takes over what the one on duty commands.
    commands, lost_ticks, stalls : int
        Counts since the start: commands sent, ticks without one, own hold-ups.
    """

    def __init__(
        self,
        settings: ArbiterSettings,
        lockstep: bool = False,
        guard: SensorGuard | None = None,
        interlocks: Interlocks | None = None,
    ) -> None:
        self.lockstep = lockstep
        self.machine = Machine(settings)
        self.safety = SafetyMonitor(self.machine, guard, interlocks)
        self.registry = ControllerRegistry(self.machine, self.safety, lockstep)
        self.operator = OperatorRequests(self.machine, self.registry, self.safety, lockstep)
        self.watch = CommandWatch()
        self.last: Decision | None = None
        self.on_duty = True
        self.commands = self.lost_ticks = self.stalls = 0
        self._arbitration = Arbitration(self.machine, self.registry, self.safety, self.operator, self.watch, lockstep)
        self._start = self._arbitration.start
        self._stamps = StampFilter(_GAP_S if lockstep else _SILENT_TICKS * settings.tick_period_s)
        self._tick: Tick | None = None
        self._now_s = 0.0
        self._silent = False
        self._outbox: list[Decision] = []
        self._rehearsed: Decision | None = None

    @property
    def settings(self) -> ArbiterSettings:
        """The settings; may be replaced at any time."""
        return self.machine.settings

    @settings.setter
    def settings(self, settings: ArbiterSettings) -> None:
        self.machine.settings = settings

    @property
    def applied(self) -> Command | None:
        """Command in force; None until it is known."""
        return self._arbitration.applied

    # ---------------------------------------------------------------- inputs

    def on_sample(self, sensor: str, stamp_ns: int, value: float, now_s: float) -> list[Decision]:
        """Take a sample of one of ``SENSORS`` (mm, N m, degC)."""
        self._see(sensor, stamp_ns, value, now_s)
        self._advance()
        return self._take()

    def on_drives(self, stamp_ns: int, feedback: Command, now_s: float) -> list[Decision]:
        """Take the drives' feedback of the force and speed that act."""
        repeated = self._start.hear_drives(stamp_ns, feedback)
        self._see(DRIVES, stamp_ns, feedback.force_kn, now_s)
        self._advance()
        again = repeated and self.lockstep and self.on_duty
        if again and self.last is not None and self.last.stamp_ns == stamp_ns:
            # The plant sends its tick again because the answer did not reach it.
            self._outbox.append(self.last)
            self.watch.sent(self.last)
        return self._take()

    def on_proposal(self, name: str, proposal: ProposalInput, now_s: float) -> list[Decision]:
        """Take a proposal that came on the topic of controller ``name``."""
        self._pass_time(now_s)
        record = self.registry.join(name)
        if record is not None:
            self.registry.take(record, proposal, self._tick, now_s)
        self._advance()
        return self._take()

    def on_status(self, name: str, tolerated_sensors: tuple[str, ...], selected: bool, now_s: float) -> list[Decision]:
        """Take what a controller declares of itself."""
        self._pass_time(now_s)
        if self.registry.hear_status(name, tolerated_sensors):
            self._start.hear_status(name, selected)
        self._advance()
        return self._take()

    def on_time(self, now_s: float) -> list[Decision]:
        """Let time pass; to be called at ``wakeup_s`` at the latest."""
        self._pass_time(now_s)
        self._advance()
        self.operator.expire(now_s)
        if not self._silent and self._tick is not None and not self.lockstep:
            self._silent = now_s - self._tick.started_s > _GAP_S
            if self._silent:
                self.machine.log(Level.ERROR, "sensors", f"no measurement for {_GAP_S:g} s")
        return self._take()

    def on_command(self, stamp_ns: int, source: str, command: Command) -> bool:
        """Take a message seen on the command topic; returns whether it was sent here, else it is a foreign writer's."""
        if self.watch.is_own(stamp_ns, source, command):
            return True
        if refusal(command) is None:
            self._start.hear_command(command)
        if self.watch.note_foreign(self._now_s, self.machine.tick):
            text = f"a foreign writer commands {command.force_kn:g} kN, {command.speed_rpm:g} rpm as {source[:40]!r}"
            self.machine.log(Level.ERROR, "command topic", text)
        return False

    # ---------------------------------------------------------------- on and off duty

    def rehearse(self) -> None:
        """Begin off duty."""
        self.on_duty = False

    def commanded(self, drives: Command) -> Command:
        """The command that the drives obey when they report ``drives``."""
        return self._start.commanded(drives)

    def follow(self, stamp_ns: int, source: str, command: Command) -> None:
        """Off duty: take over what the one on duty has commanded."""
        applied = self.settings.limits.clip(command, None)
        self._arbitration.note_applied(applied)
        self.last = Decision(stamp_ns, applied, source)
        if self._tick is not None and stamp_ns == self._tick.stamp_ns:
            self._tick.answered, self._rehearsed = True, None
        elif self._tick is not None:
            self._tick.before = applied
        self.machine.mirror(source)

    def follow_wish(self, controller: str, mode: str, inhibited: Mapping[str, str]) -> None:
        """Off duty: take over what the operator has asked the one on duty for, and who is inhibited there and why."""
        self.machine.want(controller, next((item for item in OPERATOR_TRIGGERS if item == mode), None))
        self.registry.follow_inhibitions(inhibited)

    def take_duty(self, reason: str) -> list[Decision]:
        """Send from now on, beginning with the tick that has just been rehearsed; ``reason`` is empty at a start."""
        self.on_duty = True
        if reason:
            self.machine.note_takeover(reason)
        self.operator.begin_manual_at(self.applied)
        decision, self._rehearsed = self._rehearsed, None
        if decision is not None:
            self._send(decision)
        self._advance()
        return self._take()

    def leave_duty(self, unsent: list[Decision], reason: str) -> None:
        """Send nothing from now on, nor what was decided last."""
        self._disown(unsent)
        self.on_duty = False
        # What was decided last has perhaps not been obeyed: what acts is heard from the one on duty or the drives.
        self._arbitration.forget_applied(self._tick)
        if self._tick is not None:
            self._tick.answered = True
        self.operator.dismiss(f"refused: {reason}")
        self.machine.log(Level.WARN, "duty", f"on standby: {reason}")

    def start_anew(self, unsent: list[Decision]) -> None:
        """Find out what is applied: something else has acted while this process was held up."""
        self._disown(unsent)
        self._interrupt("what acts has changed while the arbiter was held up")

    def _disown(self, unsent: list[Decision]) -> None:
        self._outbox.clear()
        self.commands -= len(unsent)
        self.lost_ticks += len(unsent)

    # ---------------------------------------------------------------- what can be seen

    @property
    def wakeup_s(self) -> float | None:
        """Steady time at which ``on_time`` must be called at the latest; None: nothing is waited for."""
        tick = self._tick
        if tick is None or tick.decided:
            return None
        times = [tick.deadline_s]
        if not tick.evaluated:
            times.append(tick.started_s + self._arbitration.grace_s)
        if self.lockstep:
            times.append(tick.started_s + self.settings.lockstep_shadow_wait_s)
        listening_s = self._start.ends_s(self.settings.takeover_wait_s)
        if listening_s is not None:
            times.append(listening_s)
        return min((time for time in times if time > self._now_s), default=tick.deadline_s)

    @property
    def tick(self) -> Tick | None:
        """The present tick; None before the first."""
        return self._tick

    @property
    def foreign_writer(self) -> bool:
        """Whether someone else has written commands lately."""
        return self.watch.seen_lately(self._now_s)

    @property
    def measuring(self) -> bool:
        """Whether measurements come."""
        return self._tick is not None and not self._silent

    # ---------------------------------------------------------------- ticks

    def _see(self, source: str, stamp_ns: int, value: float, now_s: float) -> None:
        """Let a stamp begin a tick, or enter the sample in the tick that it belongs to."""
        self._pass_time(now_s)
        newest_ns = self._stamps.newest_ns
        believed = self._stamps.offer(source, stamp_ns, value, now_s)
        if believed is None:
            return
        # Without a jump, a clock that went back a little is caught up with soon.
        if believed.jumped or newest_ns is None or stamp_ns > newest_ns:
            self._begin(stamp_ns)
        tick = self._tick
        if tick is not None and stamp_ns == tick.stamp_ns:
            tick.drives = self._start.feedback(stamp_ns) or tick.drives
            for name, sample in believed.samples.items():
                if name in SENSORS:
                    tick.samples.setdefault(name, sample)

    def _pass_time(self, now_s: float) -> None:
        """Note the time, and whether this process was held up itself: then the queues get time to drain."""
        self._now_s = now_s
        tick = self._tick
        if tick is None or tick.decided or tick.stalled:
            return
        if now_s > tick.deadline_s + self.settings.stall_tolerance_s:
            tick.stalled = True
            tick.deadline_s = now_s + self.settings.stall_tolerance_s / 2.0
            self.stalls += 1
            self.machine.log(Level.WARN, "arbiter", f"was held up for {now_s - tick.started_s:.3f} s")

    def _begin(self, stamp_ns: int) -> None:
        """End the tick before and begin one: the moment between two ticks."""
        now_s, past = self._now_s, self._tick
        back = past is not None and stamp_ns < past.stamp_ns
        gap = past is not None and (back if self.lockstep else now_s - past.started_s > _GAP_S)
        if past is not None:
            if not past.decided and gap:
                past.decide()
                self.lost_ticks += 1
            elif not past.decided:
                past.stalled = True
                self._advance(final=True)
            self.registry.close(past)
        self.machine.advance(stamp_ns)
        if back:
            self.machine.log(Level.WARN, "clock", "time went back: counting on from there")
            self.safety.forget_time()
            self.registry.forget_time()
        self._start.begin(now_s)
        self._silent = False
        self._rehearsed = None
        period_s = self.settings.lockstep_deadline_s if self.lockstep else self.settings.deadline_s
        if not self.on_duty:
            # The one on duty decides first.
            period_s = self.settings.takeover_s(self.lockstep)
        self._tick = Tick(stamp_ns, now_s, now_s + period_s, self.applied)
        if gap:
            self._interrupt("measurements are back after a gap")
        self._change_between_ticks()
        self.registry.take_early(self._tick, now_s)

    def _interrupt(self, reason: str) -> None:
        """The plant or this process was away: whatever acts now must be found out anew."""
        self._start.interrupt(self.applied, self.machine.active)
        self._arbitration.forget_applied(self._tick)
        self.machine.log(Level.WARN, "sensors", reason)
        self.machine.fire(Trigger.INTERRUPTED, reason, "start")

    def _change_between_ticks(self) -> None:
        """The active controller may change here without having failed."""
        machine, settings = self.machine, self.settings
        self.operator.serve(self._now_s)
        if machine.mode is Mode.HOLD and machine.target_mode is Mode.AUTO:
            name = "" if machine.storming() else self.registry.first_ready()
            if name:
                machine.fire(Trigger.CONTROLLER_BACK, f"{name} is ready again", "failover", name)
            elif machine.ticks_in_mode >= settings.ticks(settings.hold_timeout_s):
                text = f"held for {settings.hold_timeout_s:g} s: {machine.reason}"
                machine.fire(Trigger.HOLD_TIMEOUT, text, "failover")
        elif machine.mode is Mode.AUTO and settings.return_to_target and machine.active != machine.target:
            name = machine.target
            if not self.operator.waiting and not self.registry.obstacle(name) and not machine.storming():
                machine.swap(name, f"{name} is ready again", "failover", automatic=True)

    # ---------------------------------------------------------------- decisions

    def _advance(self, final: bool = False) -> None:
        """Decide the present tick if that can be done now."""
        tick = self._tick
        if tick is None or tick.decided:
            return
        decision = self._arbitration.decide(tick, self._now_s, final)
        if decision is not None and self.on_duty:
            self._send(decision)
        elif decision is not None:
            self._rehearsed = decision
        elif tick.decided and not tick.answered:
            self.lost_ticks += 1

    def _send(self, decision: Decision) -> None:
        self._arbitration.note_applied(decision.command)
        self.last = decision
        self.commands += 1
        self._outbox.append(decision)
        self.watch.sent(decision)
        self.operator.applied(decision.source, decision.stamp_ns / NANOSECONDS)

    def _take(self) -> list[Decision]:
        decisions, self._outbox = self._outbox, []
        return decisions
