"""The sequence of ticks: each begins with its first stamp and ends before the next begins."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, isnan, nan

from fsw_control.cause import Cause
from fsw_control.contract import Command
from fsw_control.message_synchronizer import StampFilter
from fsw_control.reason import Reason, ReasonCode
from fsw_control.sensors import OPTIONAL, REQUIRED
from fsw_control.units import NANOSECONDS
from fsw_supervisor.arbitration import Arbitration
from fsw_supervisor.facts import Code
from fsw_supervisor.state_machine import Level
from fsw_supervisor.tick import GAP_S, Decision, ProposalInput, Tick

#: in real time, time without a usable stamp after which a safe stop begins, as with the drives'
#: watchdog [s]
CLOCK_STOP_S = 3.0
#: a report this soon after a command may not reflect it yet [s] (chosen)
_FLIGHT_S = 0.01


class Ticks:
    """Begins and ends ticks, and collects the commands to send."""

    def __init__(self, arbitration: Arbitration) -> None:
        self.present: Tick | None = None  #: the present tick; None before the first one
        self.last: Decision | None = None  #: the last command sent, here or by the leader
        #: counts since the start: commands sent, ticks without one, delays of this process
        self.commands = self.lost = self.stalls = 0
        #: the actuator end reports that no command acts: it moves the drives itself
        self.moved_itself = False
        self.unheard = False  #: it reports that the last commands have not arrived
        self.commanded_s = -inf  #: when a command was last sent or heard
        self.leading = True  #: otherwise on standby: every tick is decided, nothing is sent
        self.now_s = 0.0  #: steady time of the last input
        self._stalled_s = -inf  # when this process resumed after a pause
        self._arbitration = arbitration
        self._machine, self._registry = arbitration.machine, arbitration.registry
        self._in_force, self._lockstep = arbitration.in_force, arbitration.lockstep
        self._stamps = StampFilter(self._lockstep)
        self.silence: Code | None = None  #: why no tick begins; None while ticks begin
        self._heard_s = -inf  # last arrival of a sample, whatever its stamp
        # stamp and value of the last sample of each
        self._optional: dict[str, tuple[int, float]] = {}
        self._deviation = (0, nan)  # stamp and value, of the last depth
        self._outbox: list[Decision] = []

    @property
    def measuring(self) -> bool:
        """Whether measurements arrive."""
        return self.present is not None and self.silence is None

    @property
    def wakeup_s(self) -> float | None:
        """Steady time at which :meth:`pass_time` must be called; None if not needed."""
        if self.present is None or self.present.settled:
            return None
        return self._arbitration.wakeup_s(self.present, self.now_s)

    def on_stamp(self, source: str, stamp_ns: int, value: float, now_s: float) -> None:
        """Let a stamp begin a tick, and enter its sample (of a sensor or the drives) in its tick.

        The controllers' ``MessageSynchronizer`` releases a tick once it is complete; here a tick
        begins with its first sample, because proposals arrive meanwhile and the deadline counts
        from there.
        """
        self.pass_time(now_s)
        if source in OPTIONAL:  # does not begin a tick
            self._optional[source] = (stamp_ns, value)
            if self.present is not None:
                self.present = self._with_optional(self.present)
            return
        self._heard_s = now_s
        newest_ns = self._stamps.newest_ns
        accepted = self._stamps.offer(source, stamp_ns, value, now_s)
        if accepted is None:
            return
        # Without a jump, a clock that went back a little soon catches up.
        if accepted.jumped or newest_ns is None or stamp_ns > newest_ns:
            self._begin(stamp_ns)
        tick = self.present
        if tick is not None and stamp_ns == tick.stamp_ns:
            drives = self._in_force.feedback(stamp_ns) or tick.drives
            is_first = tick.drives is None and drives is not None
            if is_first and self._starts_from_drives and not (tick.settled or tick.answered):
                self._in_force.forget()
            samples = {name: v for name, v in accepted.samples.items() if name in REQUIRED}
            self.enter(samples, drives)

    def enter(self, samples: Mapping[str, float], drives: Command | None = None) -> None:
        """Enter samples of required sensors and of the drives in the present tick."""
        tick = self.present
        if tick is None:
            return
        deviation_mm = tick.depth_deviation_mm
        # of a depth that comes twice, the first one counts
        if tick.stamp_ns == self._deviation[0] and isnan(deviation_mm):
            deviation_mm = self._deviation[1]
        self.present = tick._replace(
            samples={**samples, **tick.samples},  # the first one of each sensor counts
            drives=drives or tick.drives,
            depth_deviation_mm=deviation_mm,
        )

    def on_proposal(self, name: str, proposal: ProposalInput) -> None:
        """Take a proposal for the present tick, a past one or a future one."""
        self.present = self._registry.take(name, proposal, self.present, self.now_s)

    def on_depth_deviation(self, stamp_ns: int, deviation_mm: float) -> None:
        """Take the standard deviation of a depth, ahead of its sample."""
        self._deviation = (stamp_ns, deviation_mm)

    def _with_optional(self, tick: Tick) -> Tick:
        """Return a tick with samples of optional sensors, which may arrive before it begins."""
        samples = {n: v for n, (ns, v) in self._optional.items() if ns == tick.stamp_ns}
        return tick._replace(samples={**samples, **tick.samples}) if samples else tick

    def pass_time(self, now_s: float) -> None:
        """Note the time and any stall of this process, after which the queues get time to drain.

        In real time no controller counts as failed then. In lockstep the plant waits meanwhile, so
        a controller that has not answered by then has failed, stall or not.
        """
        if 0.0 < self.now_s < now_s - GAP_S:
            self._stalled_s = now_s
        self.now_s = now_s
        if self._in_gap() and not self._lockstep:
            self._machine.pass_time(round(now_s * NANOSECONDS))
        tick, settings = self.present, self._machine.settings
        if tick is None or tick.settled or tick.stalled or tick.drained:
            return
        if now_s > tick.deadline_s + settings.stall_tolerance_s:
            stalled = not (self._lockstep and self.leading)
            drain_s = settings.stall_tolerance_s if stalled else settings.lockstep_deadline_s
            deadline_s = now_s + drain_s / 2.0
            self.present = tick._replace(drained=True, stalled=stalled, deadline_s=deadline_s)
            self.stalls += 1
            stalled_s = now_s - tick.started_s
            self._machine.log(Level.WARN, "arbiter", Code.STALLED, time_s=stalled_s)

    def note_silence(self) -> None:
        """Report once that measurements have stopped, or their stamps, which is a safe stop."""
        if self._lockstep or self.present is None or not self._in_gap():
            return
        silence = Code.CLOCK_STANDS if self.now_s - self._heard_s <= GAP_S else Code.NO_MEASUREMENT
        if silence is not self.silence:
            self.silence = silence
            who = "clock" if silence is Code.CLOCK_STANDS else "sensors"
            self._machine.log(Level.ERROR, who, silence, limit_s=GAP_S)
        silent_s = self.now_s - self.present.started_s
        if silence is Code.CLOCK_STANDS and silent_s >= CLOCK_STOP_S:
            reason = Reason(ReasonCode.CLOCK_STOPPED, limit_s=CLOCK_STOP_S)
            self._machine.fire(Cause.CLOCK_STOPPED, reason, "clock")

    @property
    def _starts_from_drives(self) -> bool:
        """Whether ticks start from the drives' feedback, as the last command does not act."""
        return self.moved_itself or (self.unheard and self.now_s - self.commanded_s > _FLIGHT_S)

    def _missed(self, stamp_ns: int) -> bool:
        """Whether measurements were lost in a stall of this process, whose queues overflowed."""
        past, stalled_s = self.present, self.now_s - self._stalled_s
        jump_ns = 0 if past is None else stamp_ns - past.stamp_ns
        return stalled_s <= GAP_S and jump_ns > round(GAP_S * NANOSECONDS)

    def _in_gap(self) -> bool:
        """Whether the present tick is so old that the plant or this process was suspended."""
        return self.present is not None and self.now_s - self.present.started_s > GAP_S

    def _begin(self, stamp_ns: int) -> None:
        """End the tick before and begin a new one; changes of mode happen in between."""
        now_s, past, settings = self.now_s, self.present, self._machine.settings
        back = past is not None and stamp_ns < past.stamp_ns
        gap = back if self._lockstep else self._in_gap() or self._missed(stamp_ns)
        if past is not None:
            self._end(past, gap)
        self._machine.advance(stamp_ns, self._time_ns(stamp_ns, past))
        if back:
            self._machine.log(Level.WARN, "clock", Code.TIME_BACK)
            self._arbitration.safety.forget_time()
            self._registry.forget_time(stamp_ns)
        self.silence = None
        period_s = settings.lockstep_deadline_s if self._lockstep else settings.deadline_s
        if not self.leading:
            # The leader decides first.
            period_s = settings.takeover_s(self._lockstep)
        tick = Tick(stamp_ns, now_s, now_s + period_s, self._in_force.applied)
        self.present = self._with_optional(tick)
        if gap:
            self.interrupt(Reason(ReasonCode.GAP))
        # after a gap before the first command, listening restarts
        self._arbitration.start_up.begin(now_s)
        # requests, returns and time-outs act here, before the tick has any input but its stamp
        self._arbitration.change_between_ticks(now_s)
        # Determined before any proposal for this tick, so that their order does not matter.
        tick = self.present._replace(ready=self._registry.all_ready())
        self.present = self._registry.take_early(tick, now_s)

    def _time_ns(self, stamp_ns: int, past: Tick | None) -> int | None:
        """Time of a new tick on the clock of all time-outs; None: one tick period later."""
        if not self._lockstep:
            return round(self.now_s * NANOSECONDS)
        # In lockstep the wall clock is meaningless. If simulated time restarts, the time-outs
        # continue.
        is_later = past is not None and stamp_ns > past.stamp_ns
        return self._machine.time_ns + stamp_ns - past.stamp_ns if past and is_later else None

    def _end(self, tick: Tick, gap: bool) -> None:
        """Settle a tick that is over: with a command, or without one after a gap."""
        # Feedback on a past measurement does not describe the drives now.
        unknown = self._in_force.applied is None and not self._in_force.before_first
        if not tick.settled and (gap or unknown or self._starts_from_drives):
            self.present = tick = tick.settle()
            self.lost += 1
        elif not tick.settled:
            self.present = tick._replace(stalled=True)
            tick = self._advance(self.present, final=True)
        self._registry.close(tick)
        if not self._arbitration.watch.seen_lately(self.now_s):
            # Not earlier, so that the arrival order of the tick's messages does not matter.
            self._in_force.learn_offsets(tick, self._machine.settings.drive_limits)

    def interrupt(self, reason: Reason) -> None:
        """Determine the command in force again: the plant or this process was suspended."""
        self._arbitration.start_up.interrupt()
        if self.present is not None:
            self.present = self.present._replace(previous=None)
        self._machine.log(Level.WARN, "sensors", Code.GAP, reason=reason)
        self._machine.fire(Cause.INTERRUPTED, reason, "start")

    # ---------------------------------------------------------------- commands

    def decide(self) -> list[Decision]:
        """Decide the present tick if possible; return all commands to send."""
        if self.present is not None and not self.present.settled:
            self._advance(self.present)
        decisions, self._outbox = self._outbox, []
        return decisions

    def _advance(self, tick: Tick, final: bool = False) -> Tick:
        """Decide the present tick if possible; return it."""
        awaits_drives = tick.drives is None and not final and self.now_s < tick.deadline_s
        if awaits_drives and self._starts_from_drives:
            return tick
        self.present = tick = self._arbitration.decide(tick, self.now_s, final)
        if tick.outcome is not None and tick.outcome.decision is None and not tick.answered:
            self.lost += 1
        if self.leading:
            self.send()
        return self.present

    def send(self) -> None:
        """Put the present tick's command into the outbox, unless the tick is answered."""
        tick = self.present
        if tick is None or tick.answered or tick.outcome is None or tick.outcome.decision is None:
            return
        decision = tick.outcome.decision
        self.present = tick._replace(answered=True)
        self._in_force.on_sent(decision.command)
        self.last, self.commanded_s = decision, self.now_s
        self.commands += 1
        self._outbox.append(decision)
        self._arbitration.watch.sent(decision)
        self._arbitration.operator.on_applied(decision.source)

    def repeat(self, stamp_ns: int) -> None:
        """Answer a tick that the plant repeats in lockstep because no answer has reached it."""
        tick, last = self.present, self.last
        if self.leading and last is not None and last.stamp_ns == stamp_ns:
            self._outbox.append(last)
            self._arbitration.watch.sent(last)
        elif not self.leading and tick is not None and tick.stamp_ns == stamp_ns:
            # The leader died after its answer had arrived here, but not at the plant.
            self.present = tick._replace(answered=False)

    def follow(self, decision: Decision) -> None:
        """On standby: note the leader's answer to the present tick or to one before."""
        self.last, self.commanded_s, tick = decision, self.now_s, self.present
        # The standby decides the same ticks but sends nothing: one that the leader has answered is
        # closed, so that a takeover does not command twice for one measurement.
        if tick is not None and decision.stamp_ns == tick.stamp_ns:
            self.present = tick._replace(answered=True)
        elif tick is not None:
            self.present = tick._replace(previous=decision.command)

    def step_down(self) -> None:
        """Stop sending: another supervisor leads."""
        self.take_back([])
        self.leading = False
        if (tick := self.present) is not None:
            # In lockstep the plant may still wait for an answer to this tick: it is decided here,
            # too.
            answered = tick.answered or not self._lockstep
            self.present = tick._replace(answered=answered, previous=None)

    def take_back(self, unsent: list[Decision]) -> None:
        """Count decided commands as lost that must not be sent any more."""
        self._outbox.clear()
        self.commands -= len(unsent)
        self.lost += len(unsent)
