"""How one tick is decided, mode by mode; and how the first command after a start or a gap is no bump."""

from __future__ import annotations

from fsw_control.command_check import refusal
from fsw_control.contract import SENSORS, Command, Limits
from fsw_supervisor.controller_registry import ControllerRegistry
from fsw_supervisor.operator_requests import OperatorRequests
from fsw_supervisor.safety_monitor import SafetyMonitor
from fsw_supervisor.settings import ArbiterSettings
from fsw_supervisor.state_machine import Level, Machine, Mode, Trigger
from fsw_supervisor.tick import NANOSECONDS, CommandWatch, Decision, ProposalInput, Tick, check, same

#: for so long the drives' last sample stands in for one that has not come, as a sensor's does
_DRIVES_HOLD_NS = 3 * NANOSECONDS // 10
#: in lockstep a late sample is waited for at least so long [s]
_LOCKSTEP_GRACE_S = 0.1


class BumplessStart:
    """What is known of what went before: who was active, what was applied, and what the drives report.

    Attributes
    ----------
    asking : bool
        Until the first command nobody can have seen one of this supervisor: a controller that says it is selected
        means the one before it.
    was_active : str
        Controller that was active before; empty when unknown.
    seen : Command or None
        Last command known from before.
    """

    def __init__(self) -> None:
        self.asking = True
        self.was_active = ""
        self.seen: Command | None = None
        self._started_s: float | None = None
        self._drives: tuple[int, Command] | None = None
        self._offset = Command(0.0, 0.0)

    def begin(self, now_s: float) -> None:
        """Note that measurements come; the time to listen counts from the first."""
        if self._started_s is None:
            self._started_s = now_s

    def hear_status(self, name: str, selected: bool) -> None:
        """Take what a controller says of itself."""
        if selected and self.asking:
            self.was_active = name

    def hear_command(self, command: Command) -> None:
        """Take a (finite) command that another supervisor has sent."""
        if self.asking:
            self.seen = command

    def hear_drives(self, stamp_ns: int, feedback: Command) -> bool:
        """Take the drives' feedback; returns whether its stamp was seen before."""
        repeated = self._drives is not None and self._drives[0] == stamp_ns
        if refusal(feedback) is None:
            self._drives = (stamp_ns, feedback)
        return repeated

    def feedback(self, stamp_ns: int) -> Command | None:
        """What the drives have reported at a stamp."""
        return self._drives[1] if self._drives is not None and self._drives[0] == stamp_ns else None

    def interrupt(self, applied: Command | None, active: str) -> None:
        """Remember the own state at a gap in the measurements."""
        self.asking, self.was_active = False, active or self.was_active
        self.seen = applied or self.seen

    def ends_s(self, wait_s: float) -> float | None:
        """Steady time at which listening ends; None when it does not matter."""
        return self._started_s + wait_s if self.asking and self._started_s is not None else None

    def informed(self, now_s: float, wait_s: float) -> bool:
        """Whether the controllers had the time to tell who of them was selected."""
        return not self.asking or (self._started_s is not None and now_s - self._started_s >= wait_s)

    def learn_offset(self, tick: Tick, limits: Limits) -> None:
        """Learn what pushes besides the command; up to one move it may as well be a command on its way."""
        if tick.drives is not None and tick.before is not None:
            self._offset = Command(
                _more_than(limits.force_step_kn, tick.drives.force_kn - tick.before.force_kn),
                _more_than(limits.speed_step_rpm, tick.drives.speed_rpm - tick.before.speed_rpm),
            )

    def commanded(self, drives: Command) -> Command:
        """The command that the drives obey when they report ``drives``: a load cell sees everything that pushes."""
        return Command(drives.force_kn - self._offset.force_kn, drives.speed_rpm - self._offset.speed_rpm)

    def acting(self, tick: Tick, applied: Command | None) -> Command | None:
        """Force and speed that act: as the drives say, or said a moment ago; without them as commanded."""
        if tick.drives is not None or self._drives is None:
            return tick.drives or applied
        stamp_ns, feedback = self._drives
        return feedback if 0 <= tick.stamp_ns - stamp_ns <= _DRIVES_HOLD_NS else applied


class Arbitration:
    """Decides the present tick as soon as it can be decided; what begins and ends ticks is the arbiter's.

    Parameters
    ----------
    machine : Machine
        Mode, active controller, target.
    registry : ControllerRegistry
        Who may be selected.
    safety : SafetyMonitor
        Judges sensors and process.
    requests : OperatorRequests
        Hear of failures.
    watch : CommandWatch
        Knows of foreign commands.
    lockstep : bool
        Whether the plant waits for the command, so that the wall clock only guards.

    Attributes
    ----------
    applied : Command or None
        Command in force; None until it is known.
    start : BumplessStart
        What is known of what went before.
    """

    def __init__(
        self,
        machine: Machine,
        registry: ControllerRegistry,
        safety: SafetyMonitor,
        requests: OperatorRequests,
        watch: CommandWatch,
        lockstep: bool,
    ) -> None:
        self.applied: Command | None = None
        self.start = BumplessStart()
        self.machine = machine
        self.registry = registry
        self._safety = safety
        self._requests = requests
        self._watch = watch
        self._lockstep = lockstep
        self._now_s = 0.0
        self._failure = ""
        self._excused_tick = -10
        self._decision: Decision | None = None

    @property
    def settings(self) -> ArbiterSettings:
        """The settings; may be replaced at any time."""
        return self.machine.settings

    @property
    def grace_s(self) -> float:
        """How long a decision waits for the rest of the tick's sensors."""
        return max(self.settings.sensor_grace_s, _LOCKSTEP_GRACE_S) if self._lockstep else self.settings.sensor_grace_s

    def note_applied(self, command: Command) -> None:
        """Take a command that has been sent, here or by the supervisor on duty."""
        self.applied = command
        self.start.asking = False

    def forget_applied(self, tick: Tick | None) -> None:
        """Find out anew what is in force, beginning with ``tick``."""
        self.applied = None
        if tick is not None:
            tick.before = None

    def decide(self, tick: Tick, now_s: float, final: bool = False) -> Decision | None:
        """Decide a tick if that can be done now; returns the command, None if there is none (yet).

        Parameters
        ----------
        tick : Tick
            Is marked as decided.
        now_s : float
            Steady time.
        final : bool
            Decide with what is there, as after the deadline.
        """
        self._now_s = now_s
        if tick.decided:
            return None
        self._decision = None
        final = final or now_s >= tick.deadline_s
        if final or self._inputs_complete(tick):
            self._decide(tick, final)
        return self._decision

    def _inputs_complete(self, tick: Tick) -> bool:
        """Whether all is here that the decision shall not depend on the timing of."""
        missing = () if tick.evaluated else tuple(name for name in SENSORS if name not in tick.samples)
        if missing:
            proposed = self.machine.active in tick.verdicts
            in_grace = self._now_s < tick.started_s + self.grace_s
            lost = all(self._safety.sensor_reasons[name] == "missing" for name in missing)
            # What is known to be lost is not waited for once the proposal is there; it may still come back. Before
            # that nothing can be decided, and a sample that is only late on a busy machine is not missing.
            if (in_grace and not (lost and proposed)) or (self.machine.mode is Mode.AUTO and not proposed):
                return False
            if self.machine.mode is Mode.START and self._starting_with not in tick.verdicts:
                return False
        if self._lockstep and self._now_s < tick.started_s + self.settings.lockstep_shadow_wait_s:
            for record in self.registry:
                keeps_up = record.silent_ticks == 0 and record.last_stamp_ns >= 0
                if record.name != self.machine.active and keeps_up and record.name not in tick.verdicts:
                    return False
        return True

    def _decide(self, tick: Tick, final: bool) -> None:
        if not tick.evaluated:
            tick.evaluated = True
            self._safety.judge(tick, self.start.acting(tick, self.applied))
            if not self._watch.seen_lately(self._now_s):
                self.start.learn_offset(tick, self.settings.limits)
        if tick.answered:
            tick.decide()
            return
        if self.applied is None and not self._take_over(tick, final):
            if final:
                self.machine.explain("starting: what is applied is not known yet")
                tick.decide()
            return
        if self.machine.mode is Mode.START:
            self._rule_start(tick, final)
        if self.machine.mode is Mode.AUTO and not tick.decided:
            self._rule_auto(tick, final)
        if not tick.decided and self.machine.mode in (Mode.MANUAL, Mode.HOLD, Mode.SAFE_STOP):
            self._rule_alone(tick)

    def _take_over(self, tick: Tick, final: bool) -> bool:
        """Find out what is applied at present, so that the first command is no bump; False: not known yet."""
        verdict = tick.verdicts.get(self.machine.target)
        if tick.drives is not None:
            found, origin = self.start.commanded(tick.drives), "the drives' feedback"
        elif not final or not self._informed():
            return False
        elif self.start.seen is not None:
            found, origin = self.start.seen, "the last command seen"
        elif verdict is not None and verdict.ok:
            found, origin = verdict.command, f"the proposal of {self.machine.target}"
        elif self.machine.mode is Mode.MANUAL and self._requests.manual is not None:
            found, origin = self._requests.manual, "the operator's values"
        else:
            return False
        self._begin_from(tick, found, origin)
        return True

    def _begin_from(self, tick: Tick, found: Command, origin: str) -> None:
        self.applied = tick.before = self.settings.limits.clip(found, None)
        text = f"taking over at {self.applied.force_kn:.3f} kN, {self.applied.speed_rpm:.3f} rpm from {origin}"
        self.machine.log(Level.INFO, "start", text)

    def _informed(self) -> bool:
        return self.start.informed(self._now_s, self.settings.takeover_wait_s)

    def _rule_start(self, tick: Tick, final: bool) -> None:
        """Begin with the controller that was active before, else with the configured one."""
        machine, before = self.machine, self.start
        name = self._starting_with
        informed = self._informed() or (final and self.registry.all_told())
        if not final and (name not in tick.verdicts or not informed):
            return
        if informed:
            self._believe_who_was_active(tick)
        verdict, record = tick.verdicts.get(name), self.registry.get(name)
        obstacle = "no proposal yet" if verdict is None else verdict.reason
        if not obstacle and record is not None:
            obstacle = record.blind_to(self._safety.invalid_sensors)
        if informed and not obstacle:
            reason = f"{name} was active before" if before.was_active else f"{name} is configured to start with"
            machine.want(name)
            before.was_active = ""
            machine.fire(Trigger.READY, reason, "start", name)
            return
        assert self.applied is not None
        if not informed:
            # A command now would make every controller say that it is not selected; and what acts may still change.
            tick.decide()
            self.applied = None
            return
        if not tick.blameless:
            if before.was_active and machine.ticks_in_mode > self.settings.warm_ticks:
                before.was_active = ""
                machine.fire(Trigger.ABANDONED, f"{name} was active before and has no usable proposal", "start")
                return
            # Who was active in mid-weld gets some ticks: after a gap one sensor may be back later than the others.
            substitute = "" if before.was_active else self._patient_substitute()
            if substitute:
                machine.fire(Trigger.READY, f"{name} has no usable proposal, {substitute} has", "start", substitute)
                return
        machine.explain(f"starting: waiting for {name}: {obstacle}")
        self._commit(tick, self.applied, "hold", machine.reason)

    @property
    def _starting_with(self) -> str:
        """Who was active before, else who is configured."""
        return self.start.was_active or self.machine.target

    def _believe_who_was_active(self, tick: Tick) -> None:
        """After a restart: tell what was commanded from what pushes the drives besides.

        Who was active proposes at most one move away from the command in force. The plant by itself only lowers the
        force and keeps the speed; so where the drives report another speed or more force, something else pushes.
        """
        before, verdict = self.start, tick.verdicts.get(self.start.was_active)
        if not before.asking or verdict is None or not verdict.jump or self.applied is None:
            return
        limits, proposed, force_kn = self.settings.limits, verdict.command, self.applied.force_kn
        if force_kn - proposed.force_kn > limits.force_step_kn:
            force_kn = proposed.force_kn
        self._begin_from(tick, Command(force_kn, proposed.speed_rpm), f"the drives and {before.was_active}")
        proposal = ProposalInput(tick.stamp_ns, before.was_active, proposed)
        tick.verdicts[before.was_active] = check(before.was_active, proposal, self.applied, limits)

    def _patient_substitute(self) -> str:
        """Fallback that has proposed well for so long that the configured controller need not be waited for."""
        patience = max(self.settings.readmit_ticks, self.settings.warm_ticks)
        for name in self.settings.fallbacks:
            record = self.registry.get(name)
            if record is not None and record.consecutive_good > patience and not self.registry.obstacle(name):
                return name
        return ""

    def _rule_auto(self, tick: Tick, final: bool) -> None:
        """Apply the active controller's proposal, or the first fallback's in the same tick."""
        if not tick.failed:
            record = self.registry.get(self.machine.active)
            verdict = tick.verdicts.get(self.machine.active)
            if record is None:
                self._fail(tick, "it is unknown", latch=False)
            elif record.conflicts >= self.settings.duplicate_ticks:
                self._fail(tick, "two controllers of this name propose", latch=True)
            elif blind := record.blind_to(self._safety.invalid_sensors):
                self._fail(tick, blind, latch=False)
            elif verdict is not None and verdict.ok:
                self._follow(tick, verdict.command)
                return
            elif verdict is not None and verdict.jump and self.machine.tick - self._watch.foreign_tick <= 1:
                # Controllers follow the command topic: the foreign command has misled them, for one tick.
                assert self.applied is not None
                self._commit(tick, self.applied, "hold", f"a foreign command has misled {self.machine.active}")
                return
            elif verdict is not None:
                self._fail(tick, verdict.reason, latch=True)
            elif not final:
                return
            elif excuse := tick.blameless or self._cut_short(tick):
                assert self.applied is not None
                self._commit(tick, self.applied, "hold", excuse, excuse)
                return
            else:
                self._fail(tick, "no proposal at the deadline", latch=True)
        self._fall_back(tick, final)

    def _cut_short(self, tick: Tick) -> str:
        """Why a measurement that has come in part may not have reached the controllers; never two ticks in a row."""
        if not tick.surprised or self.machine.tick - self._excused_tick <= 1:
            return ""
        self._excused_tick = self.machine.tick
        return f"the measurement has come without {', '.join(tick.surprised)}"

    def _rule_alone(self, tick: Tick) -> None:
        """Manual, hold and safe stop need no controller."""
        assert self.applied is not None
        wanted, mode = self.applied, self.machine.mode
        if mode is Mode.MANUAL and self._requests.manual is not None:
            wanted = self._requests.manual
        elif mode is Mode.SAFE_STOP:
            step_kn = self.settings.safe_rate_kn_per_s * self.settings.tick_period_s
            ramp_kn = max(self.settings.safe_force_kn, self.applied.force_kn - step_kn)
            wanted = Command(min(ramp_kn, self.applied.force_kn), self.applied.speed_rpm)
        self._commit(tick, wanted, str(mode), self.machine.reason)

    def _fail(self, tick: Tick, reason: str, latch: bool) -> None:
        tick.failed = True
        name = self.machine.active
        self._failure = f"{name} failed: {reason}"
        record = self.registry.get(name)
        if record is not None and latch:
            record.inhibit(reason)
        self.machine.log(Level.ERROR, "failover", self._failure)
        self._requests.failed(name, self._failure)

    def _fall_back(self, tick: Tick, final: bool) -> None:
        machine = self.machine
        if machine.storming():
            reason = f"too many swaps in {self.settings.storm_window_s:g} s; {self._failure}"
            machine.fire(Trigger.STORM, reason, "failover")
            return
        for name in self.settings.fallbacks:
            if name == machine.active or self.registry.obstacle(name):
                continue
            verdict = tick.verdicts.get(name)
            if verdict is None and self._lockstep and final and not (tick.extended or tick.stalled):
                # The plant waits: a slow fallback is given the time that the active controller had.
                tick.extended = True
                tick.deadline_s = self._now_s + self.settings.lockstep_deadline_s
                return
            if verdict is None and not final:
                return
            if verdict is not None and verdict.ok:
                machine.swap(name, self._failure, "failover", automatic=True)
                self._follow(tick, verdict.command)
                return
        machine.fire(Trigger.NO_CONTROLLER, f"{self._failure}; no fallback is ready", "failover")

    def _follow(self, tick: Tick, proposal: Command) -> None:
        """Apply a proposal; just after a swap within the transition limits."""
        assert self.applied is not None
        command, reason = proposal, ""
        if self.machine.slewing:
            force = _towards(self.applied.force_kn, proposal.force_kn, self.settings.force_transition_kn)
            speed = _towards(self.applied.speed_rpm, proposal.speed_rpm, self.settings.speed_transition_rpm)
            command = Command(force, speed)
            arrived = same(command, proposal)
            self.machine.slew(arrived)
            reason = "" if arrived else "slewing after a swap"
        self._commit(tick, command, self.machine.active, reason)

    def _commit(self, tick: Tick, wanted: Command, source: str, reason: str, excuse: str = "") -> None:
        """Make the tick's one command, in limits and in rate whoever wants it."""
        latency_s = max(0.0, self._now_s - tick.started_s)
        command = self.settings.limits.clip(wanted, self.applied)
        self._decision = Decision(tick.stamp_ns, command, source, reason, latency_s)
        tick.decide(excuse)


def _more_than(move: float, difference: float) -> float:
    return difference if abs(difference) > move else 0.0


def _towards(start: float, goal: float, step: float) -> float:
    return min(max(goal, start - step), start + step)
