"""The rules by which one tick is decided, mode by mode."""

from __future__ import annotations

from fsw_control.contract import SENSORS, Command
from fsw_control.validity import SensorGuard
from fsw_supervisor.checks import ProposalInput, check, same
from fsw_supervisor.desk import Desk
from fsw_supervisor.events import Level
from fsw_supervisor.interlocks import Interlocks
from fsw_supervisor.machine import Machine
from fsw_supervisor.modes import Mode, Trigger
from fsw_supervisor.process import judge
from fsw_supervisor.proposals import Proposals
from fsw_supervisor.settings import ArbiterSettings
from fsw_supervisor.takeover import Takeover
from fsw_supervisor.tick import NANOSECONDS, Decision, Tick
from fsw_supervisor.writers import CommandWatch

#: for so long the drives' last sample stands in for one that has not come, as a sensor's does
_DRIVES_HOLD_NS = 3 * NANOSECONDS // 10


class Rules:
    """Decides the present tick as soon as it can be decided; what begins and ends ticks is the arbiter's.

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
    proposals : Proposals
        The controllers and what is known of them.
    desk : Desk
        Where the operator asks: ``desk.ask_switch``, ``desk.ask_mode``.
    applied : Command or None
        Command in force; None until it is known.
    last : Decision or None
        The last decision.
    on_duty : bool
        Off duty it rehearses: decides every tick, sends nothing and takes over what the one on duty commands.
    writers : CommandWatch
        Tells own commands from foreign ones.
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
        self.guard = guard if guard is not None else SensorGuard()
        self.interlocks = interlocks if interlocks is not None else Interlocks()
        self.machine = Machine(settings)
        self.proposals = Proposals(self.machine, lockstep)
        self.desk = Desk(self.machine, self.proposals, self.interlocks, lockstep)
        self.applied: Command | None = None
        self.last: Decision | None = None
        self.commands = 0
        self.lost_ticks = 0
        self.stalls = 0
        self.on_duty = True
        self.writers = CommandWatch()
        self._tick: Tick | None = None
        self._now_s = 0.0
        self._takeover = Takeover()
        self._failure = ""
        self._outbox: list[Decision] = []
        self._rehearsed: Decision | None = None
        self._drives: tuple[int, Command] | None = None
        self._offset = Command(0.0, 0.0)
        self._excused_tick = -10

    @property
    def settings(self) -> ArbiterSettings:
        """The settings; may be replaced at any time."""
        return self.machine.settings

    @settings.setter
    def settings(self, settings: ArbiterSettings) -> None:
        self.machine.settings = settings

    @property
    def _grace_s(self) -> float:
        return max(self.settings.sensor_grace_s, 0.1) if self.lockstep else self.settings.sensor_grace_s

    def _advance(self) -> None:
        tick = self._tick
        if tick is None or tick.decided:
            return
        final = self._now_s >= tick.deadline_s
        if final or self._inputs_complete(tick):
            self._decide(tick, final)

    def _inputs_complete(self, tick: Tick) -> bool:
        """Whether all is here that the decision shall not depend on the timing of."""
        missing = () if tick.evaluated else tuple(name for name in SENSORS if name not in tick.samples)
        if missing:
            proposed = self.machine.active in tick.verdicts
            in_grace = self._now_s < tick.started_s + self._grace_s
            lost = all(self.guard.reasons[name] == "missing" for name in missing)
            # What is known to be lost is not waited for once the proposal is there; it may still come back. Before
            # that nothing can be decided, and a sample that is only late on a busy machine is not missing.
            if (in_grace and not (lost and proposed)) or (self.machine.mode is Mode.AUTO and not proposed):
                return False
            if self.machine.mode is Mode.START and self._starting_with not in tick.verdicts:
                return False
        if self.lockstep and self._now_s < tick.started_s + self.settings.lockstep_shadow_wait_s:
            for record in self.proposals.roster:
                keeps_up = record.silent_ticks == 0 and record.last_stamp_ns >= 0
                if record.name != self.machine.active and keeps_up and record.name not in tick.verdicts:
                    return False
        return True

    def _decide(self, tick: Tick, final: bool) -> None:
        if not tick.evaluated:
            self._evaluate(tick)
        if tick.answered:
            tick.decide()
            return
        if self.applied is None and not self._take_over(tick, final):
            if final:
                self.machine.explain("starting: what is applied is not known yet")
                self._lose(tick)
            return
        if self.machine.mode is Mode.START:
            self._rule_start(tick, final)
        if self.machine.mode is Mode.AUTO and not tick.decided:
            self._rule_auto(tick, final)
        if not tick.decided and self.machine.mode in (Mode.MANUAL, Mode.HOLD, Mode.SAFE_STOP):
            self._rule_alone(tick)

    def _evaluate(self, tick: Tick) -> None:
        """Judge the sensors and the process, once per tick."""
        tick.evaluated = True
        reasons = self.guard.reasons
        tick.surprised = tuple(name for name in SENSORS if name not in tick.samples and not reasons[name])
        before, proposals = self.proposals.invalid_sensors, self.proposals
        acting = self._acting(tick)
        proposals.invalid_sensors = judge(tick, acting, self.guard, self.interlocks, self.machine, before)
        if tick.drives is not None and tick.before is not None and not self.writers.seen_lately(self._now_s):
            drives, command, limits = tick.drives, tick.before, self.settings.limits
            self._offset = Command(
                _more_than(limits.force_step_kn, drives.force_kn - command.force_kn),
                _more_than(limits.speed_step_rpm, drives.speed_rpm - command.speed_rpm),
            )

    def _acting(self, tick: Tick) -> Command | None:
        """Force and speed that act: as the drives say, or said a moment ago; without them as commanded."""
        if tick.drives is not None or self._drives is None:
            return tick.drives or self.applied
        stamp_ns, feedback = self._drives
        return feedback if 0 <= tick.stamp_ns - stamp_ns <= _DRIVES_HOLD_NS else self.applied

    def commanded(self, drives: Command) -> Command:
        """The command that the drives obey when they report ``drives``.

        A load cell sees everything that pushes, so the drives report something else than they were told. How much is
        known from the time in which the command was; up to one move it may as well be a command on its way.
        """
        return Command(drives.force_kn - self._offset.force_kn, drives.speed_rpm - self._offset.speed_rpm)

    def _take_over(self, tick: Tick, final: bool) -> bool:
        """Find out what is applied at present, so that the first command is no bump; False: not known yet."""
        verdict = tick.verdicts.get(self.machine.target)
        if tick.drives is not None:
            found, origin = self.commanded(tick.drives), "the drives' feedback"
        elif not final or not self._informed():
            return False
        elif self._takeover.seen is not None:
            found, origin = self._takeover.seen, "the last command seen"
        elif verdict is not None and verdict.ok:
            found, origin = verdict.command, f"the proposal of {self.machine.target}"
        elif self.machine.mode is Mode.MANUAL and self.desk.manual is not None:
            found, origin = self.desk.manual, "the operator's values"
        else:
            return False
        self._begin_from(tick, found, origin)
        return True

    def _begin_from(self, tick: Tick, found: Command, origin: str) -> None:
        self.applied = tick.before = self.settings.limits.clip(found, None)
        text = f"taking over at {self.applied.force_kn:.3f} kN, {self.applied.speed_rpm:.3f} rpm from {origin}"
        self.machine.log(Level.INFO, "start", text)

    def _informed(self) -> bool:
        return self._takeover.informed(self._now_s, self.settings.takeover_wait_s)

    def _rule_start(self, tick: Tick, final: bool) -> None:
        """Begin with the controller that was active before, else with the configured one."""
        machine, before = self.machine, self._takeover
        name = self._starting_with
        informed = self._informed() or (final and before.all_told(self.proposals.roster))
        if not final and (name not in tick.verdicts or not informed):
            return
        if informed:
            self._believe_who_was_active(tick)
        verdict, record = tick.verdicts.get(name), self.proposals.roster.get(name)
        obstacle = "no proposal yet" if verdict is None else verdict.reason
        if not obstacle and record is not None:
            obstacle = record.blind_to(self.proposals.invalid_sensors)
        if informed and not obstacle:
            reason = f"{name} was active before" if before.was_active else f"{name} is configured to start with"
            machine.target, before.was_active = name, ""
            machine.fire(Trigger.READY, reason, "start", name)
            return
        assert self.applied is not None
        if not informed:
            # A command now would make every controller say that it is not selected; and what acts may still change.
            self._lose(tick)
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
        return self._takeover.was_active or self.machine.target

    def _believe_who_was_active(self, tick: Tick) -> None:
        """After a restart: tell what was commanded from what pushes the drives besides.

        Who was active proposes at most one move away from the command in force. The plant by itself only lowers the
        force and keeps the speed; so where the drives report another speed or more force, something else pushes.
        """
        before, verdict = self._takeover, tick.verdicts.get(self._takeover.was_active)
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
            record = self.proposals.roster.get(name)
            if record is not None and record.consecutive_good > patience and not self.proposals.obstacle(name):
                return name
        return ""

    def _rule_auto(self, tick: Tick, final: bool) -> None:
        """Apply the active controller's proposal, or the first fallback's in the same tick."""
        if not tick.failed:
            record = self.proposals.roster.get(self.machine.active)
            verdict = tick.verdicts.get(self.machine.active)
            if record is None:
                self._fail(tick, "it is unknown", latch=False)
            elif record.conflicts >= self.settings.duplicate_ticks:
                self._fail(tick, "two controllers of this name propose", latch=True)
            elif blind := record.blind_to(self.proposals.invalid_sensors):
                self._fail(tick, blind, latch=False)
            elif verdict is not None and verdict.ok:
                self._follow(tick, verdict.command)
                return
            elif verdict is not None and verdict.jump and self.machine.tick - self.writers.foreign_tick <= 1:
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
        if mode is Mode.MANUAL and self.desk.manual is not None:
            wanted = self.desk.manual
        elif mode is Mode.SAFE_STOP:
            step_kn = self.settings.safe_rate_kn_per_s * self.settings.tick_period_s
            ramp_kn = max(self.settings.safe_force_kn, self.applied.force_kn - step_kn)
            wanted = Command(min(ramp_kn, self.applied.force_kn), self.applied.speed_rpm)
        self._commit(tick, wanted, str(mode), self.machine.reason)

    def _fail(self, tick: Tick, reason: str, latch: bool) -> None:
        tick.failed = True
        name = self.machine.active
        self._failure = f"{name} failed: {reason}"
        record = self.proposals.roster.get(name)
        if record is not None and latch:
            record.latched_out = reason
            record.bad(reason)
        self.machine.log(Level.ERROR, "failover", self._failure)
        self.desk.failed(name, self._failure)

    def _fall_back(self, tick: Tick, final: bool) -> None:
        machine = self.machine
        if machine.storming():
            reason = f"too many swaps in {self.settings.storm_window_s:g} s; {self._failure}"
            machine.fire(Trigger.STORM, reason, "failover")
            return
        for name in self.settings.fallbacks:
            if name == machine.active or self.proposals.obstacle(name):
                continue
            verdict = tick.verdicts.get(name)
            if verdict is None and self.lockstep and final and not (tick.extended or tick.stalled):
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
            self.machine.slewing = 0 if arrived else self.machine.slewing - 1
            reason = "" if arrived else "slewing after a swap"
        self._commit(tick, command, self.machine.active, reason)

    def _commit(self, tick: Tick, wanted: Command, source: str, reason: str, excuse: str = "") -> None:
        """Send the tick's one command, in limits and in rate whoever wants it."""
        latency_s = max(0.0, self._now_s - tick.started_s)
        command = self.settings.limits.clip(wanted, self.applied)
        decision = Decision(tick.stamp_ns, command, source, reason, latency_s)
        tick.decide(excuse)
        if self.on_duty:
            self._send(decision)
        else:
            self._rehearsed = decision

    def _send(self, decision: Decision) -> None:
        self.applied, self.last = decision.command, decision
        self._takeover.asking = False
        self.commands += 1
        self._outbox.append(decision)
        self.writers.sent(decision)
        self.desk.applied(decision.source, decision.stamp_ns / NANOSECONDS)

    def _lose(self, tick: Tick) -> None:
        """Let a tick go without a command: nothing is known yet, or it is too old to matter."""
        tick.decide()
        self.lost_ticks += 1

    def _take(self) -> list[Decision]:
        decisions, self._outbox = self._outbox, []
        return decisions


def _more_than(move: float, difference: float) -> float:
    return difference if abs(difference) > move else 0.0


def _towards(start: float, goal: float, step: float) -> float:
    return min(max(goal, start - step), start + step)
