"""The arbiter: one command per tick, whatever happens.

Pure: no middleware, every time is handed in (steady seconds), every input is a method, and what has to be sent
comes back as a list of decisions. The modes and their transitions are the table in ``modes.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

from fsw_control.contract import SENSORS, Command
from fsw_control.message_synchronizer import StampFilter
from fsw_supervisor.checks import ProposalInput
from fsw_supervisor.events import Level
from fsw_supervisor.modes import OPERATOR_TRIGGERS, Mode, Trigger
from fsw_supervisor.rules import Rules
from fsw_supervisor.settings import ArbiterSettings
from fsw_supervisor.tick import Decision, Tick

#: name under which the drives' feedback of force and speed takes part in the making of ticks
DRIVES = "drives"
#: without measurements for so long, what is applied must be found out anew [s]
_GAP_S = 1.0


class Arbiter(Rules):
    """Decides at every tick whose values are applied.

    Parameters
    ----------
    settings : ArbiterSettings
        Everything that can be set.
    options
        As for :class:`Rules`, whose attributes it has.
    """

    def __init__(self, settings: ArbiterSettings, **options: Any) -> None:
        super().__init__(settings, **options)
        self._stamps = StampFilter(2.5 * settings.tick_period_s if not self.lockstep else _GAP_S)
        self._silent = False

    # ---------------------------------------------------------------- inputs

    def on_sample(self, sensor: str, stamp_ns: int, value: float, now_s: float) -> list[Decision]:
        """Take a sample of one of ``SENSORS`` (mm, N m, degC)."""
        self._see(sensor, stamp_ns, value, now_s)
        self._advance()
        return self._take()

    def on_drives(self, stamp_ns: int, feedback: Command, now_s: float) -> list[Decision]:
        """Take the drives' feedback of the force and speed that act."""
        repeated = self._drives is not None and self._drives[0] == stamp_ns
        if isfinite(feedback.force_kn) and isfinite(feedback.speed_rpm):
            self._drives = (stamp_ns, feedback)
        self._see(DRIVES, stamp_ns, feedback.force_kn, now_s)
        self._advance()
        again = repeated and self.lockstep and self.on_duty
        if again and self.last is not None and self.last.stamp_ns == stamp_ns:
            # The plant sends its tick again because the answer did not reach it.
            self._outbox.append(self.last)
            self.writers.sent(self.last)
        return self._take()

    def on_proposal(self, name: str, proposal: ProposalInput, now_s: float) -> list[Decision]:
        """Take a proposal that came on the topic of controller ``name``."""
        self._pass_time(now_s)
        record = self.proposals.join(name)
        if record is not None:
            self.proposals.take(record, proposal, self._tick, now_s)
        self._advance()
        return self._take()

    def on_status(self, name: str, tolerated_sensors: tuple[str, ...], selected: bool, now_s: float) -> list[Decision]:
        """Take what a controller declares of itself."""
        self._pass_time(now_s)
        record = self.proposals.roster.get(name)
        if record is not None:
            record.tolerated_sensors = tuple(sensor for sensor in tolerated_sensors if sensor in SENSORS)
            record.status_seen = True
            self._takeover.hear_status(name, selected)
        self._advance()
        return self._take()

    def on_time(self, now_s: float) -> list[Decision]:
        """Let time pass; to be called at ``wakeup_s`` at the latest."""
        self._pass_time(now_s)
        self._advance()
        self.desk.expire(now_s)
        if not self._silent and self._tick is not None and not self.lockstep:
            self._silent = now_s - self._tick.started_s > _GAP_S
            if self._silent:
                self.machine.log(Level.ERROR, "sensors", f"no measurement for {_GAP_S:g} s")
        return self._take()

    def on_command(self, stamp_ns: int, source: str, command: Command) -> bool:
        """Take a message seen on the command topic; returns whether it was sent here, else it is a foreign writer's."""
        if self.writers.is_own(stamp_ns, source, command):
            return True
        self._takeover.hear_command(command)
        if self.writers.note_foreign(self._now_s, self.machine.tick):
            text = f"a foreign writer commands {command.force_kn:g} kN, {command.speed_rpm:g} rpm as {source[:40]!r}"
            self.machine.log(Level.ERROR, "command topic", text)
        return False

    # ---------------------------------------------------------------- on and off duty

    def follow(self, stamp_ns: int, source: str, command: Command) -> None:
        """Off duty: take over what the one on duty has commanded."""
        self.applied = self.settings.limits.clip(command, None)
        self.last = Decision(stamp_ns, self.applied, source)
        self._takeover.asking = False
        if self._tick is not None and stamp_ns == self._tick.stamp_ns:
            self._tick.answered, self._rehearsed = True, None
        elif self._tick is not None:
            self._tick.before = self.applied
        self.machine.mirror(source)

    def follow_wish(self, controller: str, mode: str, latched_out: Mapping[str, str]) -> None:
        """Off duty: take over what the operator has asked the one on duty for, and who is latched out there and why."""
        machine = self.machine
        machine.target = controller or machine.target
        machine.target_mode = next((item for item in OPERATOR_TRIGGERS if item == mode), machine.target_mode)
        for record in self.proposals.roster:
            record.latched_out = latched_out.get(record.name, "")

    def take_duty(self, reason: str) -> list[Decision]:
        """Send from now on, beginning with the tick that has just been rehearsed; ``reason`` is empty at a start."""
        self.on_duty = True
        if reason:
            self.machine.note_takeover(reason)
        self.desk.manual = self.applied
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
        self.applied = None
        if self._tick is not None:
            self._tick.before = None
        self.desk.dismiss(f"refused: {reason}")
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
            times.append(tick.started_s + self._grace_s)
        if self.lockstep:
            times.append(tick.started_s + self.settings.lockstep_shadow_wait_s)
        listening_s = self._takeover.ends_s(self.settings.takeover_wait_s)
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
        return self.writers.seen_lately(self._now_s)

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
            if self._drives is not None and self._drives[0] == stamp_ns:
                tick.drives = self._drives[1]
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
                self._lose(past)
            elif not past.decided:
                past.stalled = True
                self._decide(past, final=True)
            self.proposals.close(past)
        self.machine.advance(stamp_ns)
        if back:
            self.machine.log(Level.WARN, "clock", "time went back: counting on from there")
            self.guard.reset()
            self.proposals.forget_time()
        self._takeover.begin(now_s)
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
        self.proposals.take_early(self._tick, now_s)

    def _interrupt(self, reason: str) -> None:
        """The plant or this process was away: whatever acts now must be found out anew."""
        self._takeover.interrupt(self.applied, self.machine.active)
        self.applied = None
        assert self._tick is not None
        self._tick.before = None
        self.machine.log(Level.WARN, "sensors", reason)
        self.machine.fire(Trigger.INTERRUPTED, reason, "start")

    def _change_between_ticks(self) -> None:
        """The active controller may change here without having failed."""
        machine, settings = self.machine, self.settings
        self.desk.serve(self._now_s)
        if machine.mode is Mode.HOLD and machine.target_mode is Mode.AUTO:
            name = "" if machine.storming() else self.proposals.first_ready()
            if name:
                machine.fire(Trigger.CONTROLLER_BACK, f"{name} is ready again", "failover", name)
            elif machine.ticks_in_mode >= settings.ticks(settings.hold_timeout_s):
                text = f"held for {settings.hold_timeout_s:g} s: {machine.reason}"
                machine.fire(Trigger.HOLD_TIMEOUT, text, "failover")
        elif machine.mode is Mode.AUTO and settings.return_to_target and machine.active != machine.target:
            name = machine.target
            if not self.desk.waiting and not self.proposals.obstacle(name) and not machine.storming():
                machine.swap(name, f"{name} is ready again", "failover", automatic=True)
