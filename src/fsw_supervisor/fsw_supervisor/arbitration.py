"""Decision of one tick, mode by mode, and the automatic changes of mode between two ticks.

Priority within a tick: interlocks (``safety_monitor.py``) first, then the active controller's
proposal, then the first usable fallback in the same tick, then hold. Changes of mode happen
between two ticks, so that a tick is decided in a single mode.
"""

from __future__ import annotations

from dataclasses import dataclass

from fsw_control.cause import Cause
from fsw_control.contract import Command, towards
from fsw_control.reason import Reason, ReasonCode
from fsw_control.sensors import REQUIRED
from fsw_control.validity import Flaw
from fsw_supervisor.controller_registry import ControllerRegistry
from fsw_supervisor.facts import Code
from fsw_supervisor.in_force import CommandInForce, CommandWatch
from fsw_supervisor.operator_requests import OperatorRequests
from fsw_supervisor.safety_monitor import SafetyMonitor
from fsw_supervisor.start_up import StartUp
from fsw_supervisor.state_machine import Level, Machine, Mode
from fsw_supervisor.tick import Decision, Tick, same

#: in lockstep, shortest wait for late samples [s]
_LOCKSTEP_GRACE_S = 1.0


@dataclass(slots=True)
class Arbitration:
    """Decides the present tick as soon as it can be decided; the arbiter begins and ends ticks."""

    machine: Machine
    registry: ControllerRegistry
    safety: SafetyMonitor
    operator: OperatorRequests
    watch: CommandWatch
    in_force: CommandInForce
    start_up: StartUp
    lockstep: bool
    _now_s: float = 0.0
    _excused_tick: int = -10

    @property
    def _grace_s(self) -> float:
        """Time for which a decision waits for the rest of the tick's sensors."""
        grace_s = self.machine.settings.sensor_grace_s
        return max(grace_s, _LOCKSTEP_GRACE_S) if self.lockstep else grace_s

    def wakeup_s(self, tick: Tick, now_s: float) -> float:
        """Steady time of the tick's next check if nothing arrives before."""
        times = [tick.deadline_s]
        if not tick.judged:
            times.append(tick.started_s + self._grace_s)
        if self.lockstep:
            times.append(tick.started_s + self.machine.settings.lockstep_shadow_wait_s)
        if self.start_up.listening_ends_s is not None:
            times.append(self.start_up.listening_ends_s)
        return min((time for time in times if time > now_s), default=tick.deadline_s)

    # ---------------------------------------------------------------- between two ticks

    def change_between_ticks(self, now_s: float) -> None:
        """Swap without a failure (request, return to the target), or leave a mode by time-out."""
        machine, settings = self.machine, self.machine.settings
        self.operator.serve(now_s)
        # From hold back to auto: the target first, then the fallbacks; not while swaps are too
        # frequent, so that two failing controllers do not alternate.
        if machine.mode is Mode.HOLD and machine.target_mode is Mode.AUTO:
            name = "" if machine.storming() else self.registry.first_ready()
            if name:
                reason = Reason(ReasonCode.READY_AGAIN, subject=name)
                machine.fire(Cause.CONTROLLER_BACK, reason, "failover", name)
        elif machine.mode is Mode.AUTO and settings.return_to_target and not self.operator.waiting:
            name = machine.target
            if name != machine.active and self.registry.is_ready(name) and not machine.storming():
                reason = Reason(ReasonCode.READY_AGAIN, subject=name)
                machine.swap(name, Cause.SWAP_BACK, reason, "failover")
        self._time_out()

    def _time_out(self) -> None:
        """Limit the time in start, hold and blind manual, where the process is not controlled."""
        machine, settings = self.machine, self.machine.settings
        since_ns, why = machine.mode_since_ns, machine.reason
        if machine.mode is Mode.START:
            trigger, limit_s = Cause.START_TIMEOUT, settings.start_timeout_s
        elif machine.mode is Mode.HOLD:
            by_operator = machine.target_mode is not Mode.AUTO
            trigger = Cause.HOLD_TIMEOUT
            limit_s = settings.operator_hold_timeout_s if by_operator else settings.hold_timeout_s
        elif machine.mode is Mode.MANUAL and self.safety.blind_since_ns is not None:
            trigger, limit_s = Cause.BLIND_TIMEOUT, settings.operator_hold_timeout_s
            # Manual may last for ever as long as the operator sees what the process does.
            since_ns = max(since_ns, self.safety.blind_since_ns)
            why = Reason(ReasonCode.INVALID_SENSOR, self.safety.invalid_sensors)
        else:
            return
        if machine.elapsed(since_ns, limit_s):
            mode = str(machine.mode)
            reason = Reason(ReasonCode.TIMEOUT, limit_s=limit_s, subject=mode, because=why)
            machine.fire(trigger, reason, "failover")

    # ---------------------------------------------------------------- the decision

    def decide(self, tick: Tick, now_s: float, final: bool) -> Tick:
        """Return the tick, settled if that is possible.

        ``final``: it is, with the inputs at hand, as after the deadline.
        """
        # Called at each arrival and by the clock until the tick is settled: a branch settles it,
        # or leaves it to a later call, so that the order of messages does not matter.
        self._now_s = now_s
        final = final or now_s >= tick.deadline_s
        if not final and not self._inputs_complete(tick):
            return tick
        if not tick.judged:
            # Interlocks first: a trip decides the mode of this very tick, before any proposal.
            tick = self.safety.judge(tick, self.in_force.acting(tick, self.safety.hold_s))
        if tick.answered:
            return tick.settle()
        if self.in_force.applied is None:
            tick = self.start_up.find_command(tick, now_s, final)
        if self.in_force.applied is None:
            if not final:
                return tick
            self.machine.explain(Reason(ReasonCode.COMMAND_UNKNOWN))
            return tick.settle()
        if not self.start_up.may_command(tick, now_s, final):
            if not final:
                return tick
            # A command now would deselect every controller; the command in force may still change.
            self.in_force.forget()
            return tick.settle()
        if self.machine.mode is Mode.START:
            tick = self.start_up.correct_command(tick)
            if reason := self.start_up.decide(tick, final):
                tick = self._hold(tick, reason.head)
        if self.machine.mode is Mode.AUTO and not tick.settled:
            tick = self._decide_auto(tick, final)
        if self.machine.mode in (Mode.MANUAL, Mode.HOLD, Mode.SAFE_STOP) and not tick.settled:
            tick = self._decide_without_controller(tick)
        return tick

    def _inputs_complete(self, tick: Tick) -> bool:
        """Whether all inputs have arrived whose order must not influence the decision."""
        mode, active = self.machine.mode, self.machine.active
        missing = [name for name in REQUIRED if name not in tick.samples]
        if missing and not tick.judged:
            proposed = active in tick.candidates
            in_grace = self._now_s < tick.started_s + self._grace_s
            known, held = self.safety.sensor_flaws, self.safety.held_sensors
            lost = all(known[name] == Flaw.MISSING and name not in held for name in missing)
            # Once the proposal has arrived, a sensor known to be lost is not awaited; it may still
            # come back. Before that nothing can be decided, and on a busy machine a late sample
            # is not a missing one.
            if (in_grace and not (lost and proposed)) or (mode is Mode.AUTO and not proposed):
                return False
            if mode is Mode.START and self.start_up.controller not in tick.candidates:
                return False
        # In lockstep a decision also waits for the shadows that answered the last tick. Otherwise
        # which of them is ready would depend on the order of arrival, and runs would differ.
        wait_s = self.machine.settings.lockstep_shadow_wait_s  # until then, as ``wakeup_s`` says
        if not self.lockstep or self._now_s >= tick.started_s + wait_s:
            return True
        return not any(
            record.silent_ticks == 0
            and record.last_stamp_ns >= 0
            and record.name not in tick.candidates
            for record in self.registry
            if record.name != active
        )

    # ---------------------------------------------------------------- auto

    def _decide_auto(self, tick: Tick, final: bool) -> Tick:
        """Apply the active controller's proposal, or the first fallback's in the same tick."""
        if not tick.failure:
            tick = self._apply_active(tick, final)
        return self._fall_back(tick, final) if tick.failure else tick

    def _apply_active(self, tick: Tick, final: bool) -> Tick:
        """Apply the active controller's proposal, hold if it is excused, or note its failure."""
        machine = self.machine
        name = machine.active
        candidate, record = tick.candidates.get(name), self.registry.get(name)
        # In order of severity: an unknown or ambiguous controller is not followed even if its
        # proposal is good; a missing proposal is a failure only at the deadline.
        if record is None:
            return self._fail(tick, Reason(ReasonCode.UNKNOWN_CONTROLLER), inhibit=False)
        if record.conflicts >= machine.settings.duplicate_ticks:
            return self._fail(tick, Reason(ReasonCode.NAMESAKE), inhibit=True)
        if blind := self.registry.blind(name):
            return self._fail(tick, blind, inhibit=False)
        if candidate is not None and not candidate.refusal:
            return self._follow(tick, candidate.command)
        if candidate and candidate.jump and machine.tick - self.watch.foreign_tick <= 1:
            # Controllers track the command topic, including a foreign command, for one tick.
            return self._hold(tick, Reason(ReasonCode.FOREIGN))
        if candidate is not None:
            return self._fail(tick, candidate.refusal, inhibit=True)
        if not final:
            return tick
        if excuse := tick.excuse or self._partial_measurement(tick):
            return self._hold(tick, excuse, excuse)
        return self._fail(tick, Reason(ReasonCode.NO_PROPOSAL), inhibit=True)

    def _partial_measurement(self, tick: Tick) -> Reason:
        """Excuse for missing samples, which controllers may lack, too; never twice in a row."""
        if not tick.dropouts or self.machine.tick - self._excused_tick <= 1:
            return Reason()
        self._excused_tick = self.machine.tick
        return Reason(ReasonCode.INCOMPLETE, tick.dropouts)

    def _fail(self, tick: Tick, reason: Reason, inhibit: bool) -> Tick:
        name = self.machine.active
        failure = Reason(ReasonCode.FAILED, subject=name, because=reason)
        record = self.registry.get(name)
        if record is not None and inhibit:
            record.inhibit(reason)
        self.machine.log(Level.ERROR, "failover", Code.FAILED, reason=failure)
        self.operator.failed(name, failure)
        return tick._replace(failure=failure)

    def _fall_back(self, tick: Tick, final: bool) -> Tick:
        machine, settings = self.machine, self.machine.settings
        # Too many swaps within the window: the cause is probably not the controllers, and another
        # swap would add a transient. Hold, until the window has passed, and let the controllers
        # settle meanwhile.
        if machine.storming():
            window_s = settings.storm_window_s
            reason = Reason(ReasonCode.STORM, limit_s=window_s, because=tick.failure)
            machine.fire(Cause.STORM, reason, "failover")
            return tick
        for name in settings.fallbacks:
            # Only controllers that were ready at the tick's begin qualify, so that the order
            # of messages within the tick does not influence the choice.
            if name == machine.active or name not in tick.ready or self.registry.blind(name):
                continue
            candidate = tick.candidates.get(name)
            may_extend = self.lockstep and not (tick.extended or tick.drained or tick.stalled)
            if candidate is None and final and may_extend:
                # The plant waits: a slow fallback gets as much time as the active controller had.
                deadline_s = self._now_s + settings.lockstep_deadline_s
                return tick._replace(extended=True, deadline_s=deadline_s)
            if candidate is None and not final:
                return tick
            if candidate is not None and not candidate.refusal:
                machine.swap(name, Cause.SWAP_FAILED, tick.failure, "failover")
                return self._follow(tick, candidate.command)
        reason = Reason(ReasonCode.NO_FALLBACK, because=tick.failure)
        machine.fire(Cause.NO_CONTROLLER, reason, "failover")
        return tick

    def _follow(self, tick: Tick, proposed: Command) -> Tick:
        """Apply a proposal, rate-limited (bumpless transfer) just after a swap."""
        machine, settings, applied = self.machine, self.machine.settings, self.in_force.applied
        assert applied is not None
        command, reason = proposed, Reason()
        # Two controllers seldom agree to the last digit. Just after a swap the command approaches
        # the new proposal in steps smaller than a move, until it arrives.
        if machine.slewing:
            force = towards(applied.force_kn, proposed.force_kn, settings.force_transition_kn)
            speed = towards(applied.speed_rpm, proposed.speed_rpm, settings.speed_transition_rpm)
            command = Command(force, speed)
            arrived = same(command, proposed)
            machine.slew(arrived)
            reason = Reason(ReasonCode.NONE if arrived else ReasonCode.SLEWING)
        return self._commit(tick, command, machine.active, reason)

    # ---------------------------------------------------------------- without a controller

    def _decide_without_controller(self, tick: Tick) -> Tick:
        """Manual, hold and safe stop."""
        machine, settings, applied = self.machine, self.machine.settings, self.in_force.applied
        assert applied is not None
        target = applied
        if machine.mode is Mode.MANUAL and self.operator.manual is not None:
            target = self.operator.manual
        elif machine.mode is Mode.SAFE_STOP:
            # Between slow measurements the ramp needs more than one move; like every command, it
            # is limited to one.
            step_kn = settings.safe_rate_kn_per_s * machine.step_s
            ramp_kn = max(settings.safe_force_kn, applied.force_kn - step_kn)
            target = Command(min(ramp_kn, applied.force_kn), applied.speed_rpm)
        return self._commit(tick, target, str(machine.mode), machine.reason.head)

    def _hold(self, tick: Tick, reason: Reason, excuse: Reason | None = None) -> Tick:
        assert self.in_force.applied is not None
        return self._commit(tick, self.in_force.applied, "hold", reason, excuse)

    def _commit(
        self,
        tick: Tick,
        requested: Command,
        source: str,
        reason: Reason,
        excuse: Reason | None = None,
    ) -> Tick:
        """Settle the tick with its one command, within bounds and rates whatever the source."""
        latency_s = max(0.0, self._now_s - tick.started_s)
        # Last line of defence: bounds and rates hold whatever the source has computed.
        command = self.machine.settings.drive_limits.clip(requested, self.in_force.applied)
        return tick.settle(Decision(tick.stamp_ns, command, source, reason, latency_s), excuse)
