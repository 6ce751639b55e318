"""The arbiter: one command per tick, whatever happens.

Pure: no middleware, every time is handed in (steady seconds), every input is a method, and what has to be sent
comes back as a list of decisions. The modes and their transitions are the table in ``state_machine.py``.

What always holds:

- Each tick gets one command, or is counted as lost: before the first command, and in a gap.
- Each command is finite, inside the limits and one move at most from the command in force; after a start or a gap,
  from where the drives are.
- While an interlock is tripped the mode is safe stop, from the tick's judgement on: interlocks act by level. A safe
  stop is left only by the operator, with valid sensors, after an acknowledgement that no cause has followed. A restart
  goes on with it.
- Nothing without control lasts for ever: start, hold and manual with an invalid sensor have time-outs that lead to
  safe stop.
- Each request is answered once, with the reason if it is refused.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fsw_control.contract import SENSORS, Command
from fsw_control.message_synchronizer import StampFilter
from fsw_control.units import NANOSECONDS
from fsw_control.validity import sensor_limits
from fsw_supervisor.arbitration import Arbitration
from fsw_supervisor.command_watch import BumplessStart, CommandWatch
from fsw_supervisor.controller_registry import ControllerRegistry
from fsw_supervisor.operator_requests import OperatorRequests
from fsw_supervisor.safety_monitor import SafetyMonitor, interlocks_from
from fsw_supervisor.settings import ArbiterSettings
from fsw_supervisor.state_machine import OPERATOR_TRIGGERS, Level, Machine, Mode, Trigger
from fsw_supervisor.tick import Decision, ProposalInput, Tick

#: without measurements for so long, what is applied must be found out again [s]
_GAP_S = 1.0
#: in real time a stamp far away is believed after so many tick periods in which nothing else has come
_SILENT_TICKS = 2.5


class Arbiter:
    """Begins and ends ticks, has each decided by the arbitration, and keeps the books on what is sent.

    Parameters
    ----------
    settings : ArbiterSettings
        Everything that can be set.
    lockstep : bool
        Whether the plant waits for the command, so that the wall clock only guards.

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
    leading : bool
        Otherwise it is on standby: it decides every tick, sends nothing and takes over what the leader commands.
    tick : Tick or None
        The present tick; None before the first.
    last : Decision or None
        The last command sent, here or by the leader.
    commands, lost_ticks, stalls : int
        Counts since the start: commands sent, ticks without one, own hold-ups.
    """

    def __init__(self, settings: ArbiterSettings, lockstep: bool = False) -> None:
        self.lockstep = lockstep
        self.machine = Machine(settings)
        self.safety = SafetyMonitor(self.machine)
        self.registry = ControllerRegistry(self.machine, self.safety, lockstep)
        self.operator = OperatorRequests(self.machine, self.registry, self.safety, lockstep)
        self.watch = CommandWatch()
        self.leading = True
        self.tick: Tick | None = None
        self.last: Decision | None = None
        self.commands = self.lost_ticks = self.stalls = 0
        self._start = BumplessStart()
        self._arbitration = Arbitration(
            self.machine, self.registry, self.safety, self.operator, self.watch, self._start, lockstep
        )
        self._stamps = StampFilter(_GAP_S if lockstep else _SILENT_TICKS * settings.tick_period_s)
        self._now_s = 0.0
        self._silent = False
        self._outbox: list[Decision] = []

    def configure(self, values: Mapping[str, Any]) -> None:
        """Work with the node's parameters from now on, without forgetting."""
        self.machine.settings = ArbiterSettings.from_values(values)
        self.safety.configure(values)

    @property
    def settings(self) -> ArbiterSettings:
        """The settings at present."""
        return self.machine.settings

    @property
    def applied(self) -> Command | None:
        """Command in force; None until it is known."""
        return self._start.applied

    @property
    def foreign_writer(self) -> bool:
        """Whether someone else has written commands lately."""
        return self.watch.seen_lately(self._now_s)

    @property
    def measuring(self) -> bool:
        """Whether measurements come."""
        return self.tick is not None and not self._silent

    @property
    def wakeup_s(self) -> float | None:
        """Steady time at which ``on_time`` must be called at the latest; None: nothing is waited for."""
        tick = self.tick
        if tick is None or tick.decided:
            return None
        times = [tick.deadline_s]
        if not tick.judged:
            times.append(tick.started_s + self._arbitration.grace_s)
        if self.lockstep:
            times.append(tick.started_s + self.settings.lockstep_shadow_wait_s)
        listening_ends_s = self._start.listening_ends_s(self.settings.takeover_wait_s)
        if listening_ends_s is not None:
            times.append(listening_ends_s)
        return min((time for time in times if time > self._now_s), default=tick.deadline_s)

    # ---------------------------------------------------------------- inputs

    def on_sample(self, sensor: str, stamp_ns: int, value: float, now_s: float) -> list[Decision]:
        """Take a sample of one of ``SENSORS`` (mm, N m, degC)."""
        self._see(sensor, stamp_ns, value, now_s)
        return self._decide()

    def on_drives(self, stamp_ns: int, feedback: Command, now_s: float) -> list[Decision]:
        """Take the drives' feedback of the force and speed that act."""
        repeated = self._start.hear_drives(stamp_ns, feedback)
        self._see("drives", stamp_ns, feedback.force_kn, now_s)
        decisions = self._decide()
        again = repeated and self.lockstep and self.leading
        if again and self.last is not None and self.last.stamp_ns == stamp_ns:
            # The plant sends its tick again because the answer did not reach it.
            decisions.append(self.last)
            self.watch.sent(self.last)
        return decisions

    def on_proposal(self, name: str, proposal: ProposalInput, now_s: float) -> list[Decision]:
        """Take a proposal that came on the topic of controller ``name``."""
        self._pass_time(now_s)
        self.registry.take(name, proposal, self.tick, now_s)
        return self._decide()

    def on_status(
        self, name: str, tolerated_sensors: tuple[str, ...], selected: bool, now_s: float, applied_source: str = ""
    ) -> list[Decision]:
        """Take what a controller declares of itself, and whose command it has seen applied last."""
        self._pass_time(now_s)
        self.hear_source(applied_source)
        if self.registry.hear_status(name, tolerated_sensors):
            self._start.hear_status(name, selected)
        return self._decide()

    def on_time(self, now_s: float) -> list[Decision]:
        """Let time pass; to be called at ``wakeup_s`` at the latest."""
        self._pass_time(now_s)
        decisions = self._decide()
        self.operator.expire(now_s)
        if self.measuring and not self.lockstep and self._gap(now_s):
            self._silent = True
            self.machine.log(Level.ERROR, "sensors", f"no measurement for {_GAP_S:g} s")
        return decisions

    def on_command(self, stamp_ns: int, source: str, command: Command) -> bool:
        """Take a message seen on the command topic; returns whether it was sent here, else it is a foreign writer's."""
        if self.watch.is_own(stamp_ns, source, command):
            return True
        self._start.hear_command(command)
        self.hear_source(source)
        if self.watch.note_foreign(self._now_s, self.machine.tick):
            text = f"a foreign writer commands {command.force_kn:g} kN, {command.speed_rpm:g} rpm as {source[:40]!r}"
            self.machine.log(Level.ERROR, "command topic", text)
        return False

    def hear_source(self, source: str) -> None:
        """Take whose command is in force, as others have seen it: a safe stop outlives the supervisor that began it.

        Before the first command, sent here or by a leader, that can only be one of the supervisor before.
        """
        if source == Mode.SAFE_STOP and self.last is None:
            self.machine.fire(Trigger.RESTARTED, "a safe stop was in force before the restart", "start")

    # ---------------------------------------------------------------- leader and standby

    def commanded(self, drives: Command) -> Command:
        """The command that the drives obey when they report ``drives``."""
        return self._start.commanded(drives)

    def follow(self, stamp_ns: int, source: str, command: Command) -> None:
        """On standby: take over what the leader has commanded."""
        applied = self.settings.limits.clip(command, None)
        self._start.note_applied(applied)
        self.last = Decision(stamp_ns, applied, source)
        if self.tick is not None and stamp_ns == self.tick.stamp_ns:
            self.tick.answered, self.tick.decision = True, None
        elif self.tick is not None:
            self.tick.before = applied
        if not self.safety.tripped:
            # A cause that is seen here keeps this supervisor in the safe stop, whatever the leader has missed.
            self.machine.mirror(source)

    def follow_operator(self, controller: str, mode: str, inhibited: Mapping[str, str]) -> None:
        """On standby: take over what the operator has asked the leader for, and who is inhibited there and why."""
        self.machine.want(controller, Mode(mode) if mode in OPERATOR_TRIGGERS else None)
        self.registry.mirror_inhibitions(inhibited)

    def lead(self, reason: str) -> list[Decision]:
        """Send from now on, beginning with the tick decided on standby; ``reason`` is empty at a start."""
        self.leading = True
        if reason:
            self.machine.lead(reason)
        self.operator.keep(self.applied)
        self._send()
        return self._decide()

    def step_down(self, unsent: list[Decision], reason: str) -> None:
        """Send nothing from now on, nor what was decided last."""
        self._take_back(unsent)
        self.leading = False
        # What was decided last has perhaps not been obeyed: what acts is heard from the leader or the drives.
        self._start.forget_applied()
        if self.tick is not None:
            self.tick.answered, self.tick.before = True, None
        self.operator.drop(f"refused: {reason}")
        self.machine.log(Level.WARN, "failover", f"on standby: {reason}")

    def start_again(self, unsent: list[Decision]) -> None:
        """Find out what is applied: something else has acted while this process was held up."""
        self._take_back(unsent)
        self._interrupt("what acts has changed while the arbiter was held up")

    def _take_back(self, unsent: list[Decision]) -> None:
        self._outbox.clear()
        self.commands -= len(unsent)
        self.lost_ticks += len(unsent)

    # ---------------------------------------------------------------- ticks

    def _see(self, source: str, stamp_ns: int, value: float, now_s: float) -> None:
        """Let a stamp begin a tick, or enter the sample (of a sensor, or of the drives) in the tick it belongs to.

        The controllers' ``MessageSynchronizer`` hands over a tick once it is complete; here it begins with its first
        sample, because proposals to it arrive meanwhile and the deadline counts from there.
        """
        self._pass_time(now_s)
        newest_ns = self._stamps.newest_ns
        believed = self._stamps.offer(source, stamp_ns, value, now_s)
        if believed is None:
            return
        # Without a jump, a clock that went back a little is caught up with soon.
        if believed.jumped or newest_ns is None or stamp_ns > newest_ns:
            self._begin(stamp_ns)
        tick = self.tick
        if tick is not None and stamp_ns == tick.stamp_ns:
            tick.drives = self._start.feedback(stamp_ns) or tick.drives
            for name, sample in believed.samples.items():
                if name in SENSORS:
                    tick.samples.setdefault(name, sample)

    def _pass_time(self, now_s: float) -> None:
        """Note the time, and whether this process was held up itself: then the queues get time to drain."""
        self._now_s = now_s
        tick = self.tick
        if tick is None or tick.decided or tick.stalled:
            return
        if now_s > tick.deadline_s + self.settings.stall_tolerance_s:
            tick.stalled = True
            tick.deadline_s = now_s + self.settings.stall_tolerance_s / 2.0
            self.stalls += 1
            self.machine.log(Level.WARN, "arbiter", f"was held up for {now_s - tick.started_s:.3f} s")

    def _gap(self, now_s: float) -> bool:
        """Whether the present tick is so old that the plant or this process was away."""
        return self.tick is not None and now_s - self.tick.started_s > _GAP_S

    def _begin(self, stamp_ns: int) -> None:
        """End the tick before and begin one: the moment between two ticks."""
        now_s, past = self._now_s, self.tick
        back = past is not None and stamp_ns < past.stamp_ns
        gap = back if self.lockstep else self._gap(now_s)
        if past is not None:
            self._end(past, gap)
        self.machine.advance(stamp_ns)
        if back:
            self.machine.log(Level.WARN, "clock", "time went back: counting on from there")
            self.safety.forget_time()
            self.registry.forget_time(stamp_ns)
        self._silent = False
        period_s = self.settings.lockstep_deadline_s if self.lockstep else self.settings.deadline_s
        if not self.leading:
            # The leader decides first.
            period_s = self.settings.takeover_s(self.lockstep)
        self.tick = Tick(stamp_ns, now_s, now_s + period_s, self.applied)
        if gap:
            self._interrupt("measurements are back after a gap")
        self._start.begin(now_s)  # after a gap before the first command the time to listen begins anew
        self._change_between_ticks()
        # Before any proposal to it, so that it does not matter which comes first.
        self.tick.ready = self.registry.all_ready()
        self.registry.take_early(self.tick, now_s)

    def _end(self, tick: Tick, gap: bool) -> None:
        """Settle a tick that is over: with a command, or after a gap without one."""
        if not tick.decided and gap:
            tick.decide()
            self.lost_ticks += 1
        elif not tick.decided:
            tick.stalled = True
            self._advance(final=True)
        self.registry.close(tick)
        if not self.foreign_writer:
            # Only now, so that it does not depend on what of the tick has come first.
            self._start.learn_offset(tick, self.settings.limits)

    def _interrupt(self, reason: str) -> None:
        """The plant or this process was away: whatever acts now must be found out again."""
        self._start.interrupt(self.machine.active)
        if self.tick is not None:
            self.tick.before = None
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
        elif machine.mode is Mode.AUTO and settings.return_to_target and machine.active != machine.target:
            name = machine.target
            if not self.operator.waiting and not self.registry.why_not_ready(name) and not machine.storming():
                machine.swap(name, f"{name} is ready again", "failover", automatic=True)
        self._time_out()

    def _time_out(self) -> None:
        """Neither start, hold nor a blind manual mode lasts for ever: the force acts, nothing controls the process."""
        machine, settings = self.machine, self.machine.settings
        ticks, why = machine.ticks_in_mode, machine.reason
        if machine.mode is Mode.START:
            trigger, limit_s = Trigger.START_TIMEOUT, settings.start_timeout_s
        elif machine.mode is Mode.HOLD:
            asked_for = machine.target_mode is not Mode.AUTO
            trigger = Trigger.HOLD_TIMEOUT
            limit_s = settings.operator_hold_timeout_s if asked_for else settings.hold_timeout_s
        elif machine.mode is Mode.MANUAL:
            trigger, limit_s = Trigger.BLIND_TIMEOUT, settings.operator_hold_timeout_s
            ticks, why = min(ticks, self.safety.blind_ticks), self.safety.blind
        else:
            return
        if ticks >= settings.ticks(limit_s):
            machine.fire(trigger, f"{machine.mode} for {limit_s:g} s: {why}", "failover")

    # ---------------------------------------------------------------- decisions

    def _decide(self) -> list[Decision]:
        """Decide the present tick if that can be done now; return all that has to be sent."""
        self._advance()
        decisions, self._outbox = self._outbox, []
        return decisions

    def _advance(self, final: bool = False) -> None:
        tick = self.tick
        if tick is None or tick.decided:
            return
        self._arbitration.decide(tick, self._now_s, final)
        if tick.decided and tick.decision is None and not tick.answered:
            self.lost_ticks += 1
        if self.leading:
            self._send()

    def _send(self) -> None:
        """Put the present tick's command into the outbox."""
        tick = self.tick
        if tick is None or tick.decision is None:
            return
        decision, tick.decision = tick.decision, None
        self._start.note_applied(decision.command)
        self.last = decision
        self.commands += 1
        self._outbox.append(decision)
        self.watch.sent(decision)
        self.operator.applied(decision.source, decision.stamp_ns / NANOSECONDS)


def problem(values: Mapping[str, Any]) -> str | None:
    """Why the parameters of ``supervisor.yaml`` do not go together, or None."""
    try:
        ArbiterSettings.from_values(values)
        interlocks_from(values)
        sensor_limits(values)
    except ValueError as error:
        return str(error)
    return None
