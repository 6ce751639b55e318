"""How one tick is decided, mode by mode; and how the first command after a start or a gap is no bump."""

from __future__ import annotations

from dataclasses import dataclass

from fsw_control.contract import SENSORS, Command
from fsw_supervisor.command_watch import BumplessStart, CommandWatch
from fsw_supervisor.controller_registry import ControllerRegistry
from fsw_supervisor.operator_requests import OperatorRequests
from fsw_supervisor.safety_monitor import SafetyMonitor
from fsw_supervisor.state_machine import Level, Machine, Mode, Trigger
from fsw_supervisor.tick import Decision, ProposalInput, Tick, check, same

#: in lockstep a late sample is waited for at least so long [s]
_LOCKSTEP_GRACE_S = 1.0


@dataclass(slots=True)
class Arbitration:
    """Decides the present tick as soon as it can be decided; the arbiter begins and ends ticks.

    In lockstep the plant waits for the command, so that the wall clock only guards.
    """

    machine: Machine
    registry: ControllerRegistry
    safety: SafetyMonitor
    operator: OperatorRequests
    watch: CommandWatch
    start: BumplessStart
    lockstep: bool
    _now_s: float = 0.0
    _excused_tick: int = -10

    @property
    def grace_s(self) -> float:
        """How long a decision waits for the rest of the tick's sensors."""
        grace_s = self.machine.settings.sensor_grace_s
        return max(grace_s, _LOCKSTEP_GRACE_S) if self.lockstep else grace_s

    def decide(self, tick: Tick, now_s: float, final: bool) -> None:
        """Decide a tick if that can be done now; ``final``: with what is there, as after the deadline."""
        self._now_s = now_s
        final = final or now_s >= tick.deadline_s
        if not final and not self._inputs_complete(tick):
            return
        if not tick.judged:
            self.safety.judge(tick, self.start.acting(tick, self.safety.hold_s))
        if tick.answered:
            tick.decide()
            return
        if self.start.applied is None and not self._find_applied(tick, final):
            if final:
                self.machine.explain("starting: what is applied is not known yet")
                tick.decide()
            return
        if not self._listened(tick, final):
            if final:
                # A command now would make every controller say that it is not selected; what acts may still change.
                tick.decide()
                self.start.forget_applied()
            return
        if self.machine.mode is Mode.START:
            self._decide_start(tick, final)
        if self.machine.mode is Mode.AUTO and not tick.decided:
            self._decide_auto(tick, final)
        if self.machine.mode in (Mode.MANUAL, Mode.HOLD, Mode.SAFE_STOP) and not tick.decided:
            self._decide_alone(tick)

    def _inputs_complete(self, tick: Tick) -> bool:
        """Whether all is here that the decision shall not depend on the timing of."""
        mode, active = self.machine.mode, self.machine.active
        missing = () if tick.judged else tuple(name for name in SENSORS if name not in tick.samples)
        if missing:
            proposed = active in tick.candidates
            in_grace = self._now_s < tick.started_s + self.grace_s
            lost = all(self.safety.sensor_reasons[name] == "missing" for name in missing)
            # What is known to be lost is not waited for once the proposal is there; it may still come back. Before
            # that nothing can be decided, and a sample that is only late on a busy machine is not missing.
            if (in_grace and not (lost and proposed)) or (mode is Mode.AUTO and not proposed):
                return False
            if mode is Mode.START and self._starting_with not in tick.candidates:
                return False
        if not self.lockstep or self._now_s >= tick.started_s + self.machine.settings.lockstep_shadow_wait_s:
            return True
        return not any(
            record.silent_ticks == 0 and record.last_stamp_ns >= 0 and record.name not in tick.candidates
            for record in self.registry
            if record.name != active
        )

    # ---------------------------------------------------------------- start

    def _find_applied(self, tick: Tick, final: bool) -> bool:
        """Find out what is applied at present, so that the first command is no bump; False: not known yet."""
        machine, start = self.machine, self.start
        candidate = tick.candidates.get(machine.target)
        if tick.drives is not None:
            found, origin = start.commanded(tick.drives), "the drives' feedback"
        elif not final or not self._informed():
            return False
        elif start.seen is not None:
            found, origin = start.seen, "the last command seen"
        elif candidate is not None and not candidate.refusal:
            found, origin = candidate.command, f"the proposal of {machine.target}"
        elif machine.mode is Mode.MANUAL and self.operator.manual is not None:
            found, origin = self.operator.manual, "the operator's values"
        else:
            return False
        self._begin_from(tick, found, origin)
        return True

    def _begin_from(self, tick: Tick, found: Command, origin: str) -> Command:
        applied = tick.before = self.machine.settings.limits.clip(found, None)
        self.start.begin_from(applied)
        self.registry.check_again(tick)
        text = f"taking over at {applied.force_kn:.3f} kN, {applied.speed_rpm:.3f} rpm from {origin}"
        self.machine.log(Level.INFO, "start", text)
        return applied

    def _informed(self) -> bool:
        """Whether the controllers have had the time to tell who of them was selected."""
        ends_s = self.start.listening_ends_s(self.machine.settings.takeover_wait_s)
        return ends_s is None or self._now_s >= ends_s

    def _listened(self, tick: Tick, final: bool) -> bool:
        """Whether a first command may be given in any mode, as a safe stop may have been in force before.

        Only the controllers can tell. A status comes after the proposal that it belongs to; while nobody has proposed,
        the tick is waited out, for without measurements the time to listen passes in silence.
        """
        if not self.start.asking or self.machine.mode is Mode.SAFE_STOP:
            return True
        if final:
            return self._informed() or self.registry.all_told()
        told = [one.status_seen for one in self.registry if one.name in tick.candidates]
        return self._informed() and bool(told) and all(told)

    @property
    def _starting_with(self) -> str:
        """Who was active before, else who is configured."""
        return self.start.was_active or self.machine.target

    def _decide_start(self, tick: Tick, final: bool) -> None:
        """Begin with the controller that was active before, else with the configured one."""
        machine, start, name = self.machine, self.start, self._starting_with
        if not final and name not in tick.candidates:
            return
        self._believe_who_was_active(tick)
        candidate = tick.candidates.get(name)
        why_not = "no proposal yet" if candidate is None else candidate.refusal or self.registry.blind(name)
        if not why_not:
            reason = f"{name} was active before" if start.was_active else f"{name} is configured to start with"
            machine.want(name)
            start.forget_active()
            machine.fire(Trigger.READY, reason, "start", name)
            return
        if not tick.blameless:
            if start.was_active and machine.ticks_in_mode > machine.settings.warm_ticks:
                start.forget_active()
                machine.fire(Trigger.ABANDONED, f"{name} was active before and has no usable proposal", "start")
                return
            # Who was active in mid-weld gets some ticks: after a gap one sensor may be back later than the others.
            substitute = "" if start.was_active else self._patient_substitute(tick)
            if substitute:
                machine.fire(Trigger.READY, f"{name} has no usable proposal, {substitute} has", "start", substitute)
                return
        machine.explain(f"starting: waiting for {name}: {why_not}")
        self._hold(tick, machine.reason)

    def _believe_who_was_active(self, tick: Tick) -> None:
        """After a restart: tell what was commanded from what pushes the drives besides.

        Who was active proposes at most one move away from the command in force. The plant by itself only lowers the
        force and keeps the speed; so where the drives report another speed or more force, something else pushes.
        """
        start, applied = self.start, self.start.applied
        name = start.was_active
        candidate = tick.candidates.get(name)
        if not start.asking or candidate is None or not candidate.jump or applied is None:
            return
        limits, proposed, force_kn = self.machine.settings.limits, candidate.command, applied.force_kn
        if force_kn - proposed.force_kn > limits.force_step_kn:
            force_kn = proposed.force_kn
        applied = self._begin_from(tick, Command(force_kn, proposed.speed_rpm), f"the drives and {name}")
        tick.candidates[name] = check(name, ProposalInput(tick.stamp_ns, name, proposed), applied, limits)

    def _patient_substitute(self, tick: Tick) -> str:
        """Fallback that has proposed well for so long that the configured controller need not be waited for."""
        settings = self.machine.settings
        patience = max(settings.readmit_ticks, settings.warm_ticks)
        for name in settings.fallbacks:
            record = self.registry.get(name)
            if record is None or self.registry.why_not_ready(name):
                continue
            # Counted without this tick, so that it does not matter what of it has come.
            if record.consecutive_good - (name in tick.candidates) >= patience:
                return name
        return ""

    # ---------------------------------------------------------------- auto

    def _decide_auto(self, tick: Tick, final: bool) -> None:
        """Apply the active controller's proposal, or the first fallback's in the same tick."""
        if not tick.failure:
            self._apply_active(tick, final)
        if tick.failure:
            self._fall_back(tick, final)

    def _apply_active(self, tick: Tick, final: bool) -> None:
        """Apply the active controller's proposal, hold if that does not count as its failure, or note the failure."""
        machine = self.machine
        name = machine.active
        candidate, record = tick.candidates.get(name), self.registry.get(name)
        if record is None:
            self._fail(tick, "it is unknown", inhibit=False)
        elif record.conflicts >= machine.settings.duplicate_ticks:
            self._fail(tick, "two controllers of this name propose", inhibit=True)
        elif blind := self.registry.blind(name):
            self._fail(tick, blind, inhibit=False)
        elif candidate is not None and not candidate.refusal:
            self._follow(tick, candidate.command)
        elif candidate is not None and candidate.jump and machine.tick - self.watch.foreign_tick <= 1:
            # Controllers follow the command topic: the foreign command has misled them, for one tick.
            self._hold(tick, f"a foreign command has misled {name}")
        elif candidate is not None:
            self._fail(tick, candidate.refusal, inhibit=True)
        elif final and (excuse := tick.blameless or self._cut_short(tick)):
            self._hold(tick, excuse, excuse)
        elif final:
            self._fail(tick, "no proposal at the deadline", inhibit=True)

    def _cut_short(self, tick: Tick) -> str:
        """Why a measurement that has come in part may not have reached the controllers; never two ticks in a row."""
        if not tick.absent or self.machine.tick - self._excused_tick <= 1:
            return ""
        self._excused_tick = self.machine.tick
        return f"the measurement has come without {', '.join(tick.absent)}"

    def _fail(self, tick: Tick, reason: str, inhibit: bool) -> None:
        name = self.machine.active
        tick.failure = f"{name} failed: {reason}"
        record = self.registry.get(name)
        if record is not None and inhibit:
            record.inhibit(reason)
        self.machine.log(Level.ERROR, "failover", tick.failure)
        self.operator.failed(name, tick.failure)

    def _fall_back(self, tick: Tick, final: bool) -> None:
        machine, settings = self.machine, self.machine.settings
        if machine.storming():
            reason = f"too many swaps in {settings.storm_window_s:g} s; {tick.failure}"
            machine.fire(Trigger.STORM, reason, "failover")
            return
        for name in settings.fallbacks:
            if name == machine.active or name not in tick.ready or self.registry.blind(name):
                continue
            candidate = tick.candidates.get(name)
            if candidate is None and self.lockstep and final and not (tick.extended or tick.stalled):
                # The plant waits: a slow fallback is given the time that the active controller had.
                tick.extended = True
                tick.deadline_s = self._now_s + settings.lockstep_deadline_s
                return
            if candidate is None and not final:
                return
            if candidate is not None and not candidate.refusal:
                machine.swap(name, tick.failure, "failover", automatic=True)
                self._follow(tick, candidate.command)
                return
        machine.fire(Trigger.NO_CONTROLLER, f"{tick.failure}; no fallback is ready", "failover")

    def _follow(self, tick: Tick, proposed: Command) -> None:
        """Apply a proposal; just after a swap within the transition limits."""
        machine, settings, applied = self.machine, self.machine.settings, self.start.applied
        assert applied is not None
        command, reason = proposed, ""
        if machine.slewing:
            force = _towards(applied.force_kn, proposed.force_kn, settings.force_transition_kn)
            speed = _towards(applied.speed_rpm, proposed.speed_rpm, settings.speed_transition_rpm)
            command = Command(force, speed)
            arrived = same(command, proposed)
            machine.slew(arrived)
            reason = "" if arrived else "slewing after a swap"
        self._commit(tick, command, machine.active, reason)

    # ---------------------------------------------------------------- without a controller

    def _decide_alone(self, tick: Tick) -> None:
        """Manual, hold and safe stop need no controller."""
        machine, settings, applied = self.machine, self.machine.settings, self.start.applied
        assert applied is not None
        wanted = applied
        if machine.mode is Mode.MANUAL and self.operator.manual is not None:
            wanted = self.operator.manual
        elif machine.mode is Mode.SAFE_STOP:
            step_kn = settings.safe_rate_kn_per_s * settings.tick_period_s
            ramp_kn = max(settings.safe_force_kn, applied.force_kn - step_kn)
            wanted = Command(min(ramp_kn, applied.force_kn), applied.speed_rpm)
        self._commit(tick, wanted, str(machine.mode), machine.reason)

    def _hold(self, tick: Tick, reason: str, excuse: str = "") -> None:
        assert self.start.applied is not None
        self._commit(tick, self.start.applied, "hold", reason, excuse)

    def _commit(self, tick: Tick, wanted: Command, source: str, reason: str, excuse: str = "") -> None:
        """Make the tick's one command, in limits and in rate whoever wants it."""
        latency_s = max(0.0, self._now_s - tick.started_s)
        command = self.machine.settings.limits.clip(wanted, self.start.applied)
        tick.decide(Decision(tick.stamp_ns, command, source, reason, latency_s), excuse)


def _towards(start: float, goal: float, step: float) -> float:
    return min(max(goal, start - step), start + step)
