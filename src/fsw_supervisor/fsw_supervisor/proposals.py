"""Judges proposals and keeps the books on who answers in time."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from fsw_control.contract import Command
from fsw_supervisor.checks import ProposalInput, Verdict, check, same
from fsw_supervisor.events import Level
from fsw_supervisor.machine import Machine
from fsw_supervisor.roster import ControllerRecord, Roster
from fsw_supervisor.tick import Tick

#: ticks that a proposal may lag behind in lockstep before its controller counts as silent
LOCKSTEP_LAG = 20
#: proposals of one controller kept for measurements that have not come yet; more than a burst after a stall
_KEPT_EARLY = 8


@dataclass(frozen=True, slots=True)
class _Past:
    before: Command | None
    stalled: bool


class Proposals:
    """The controllers and their proposals, tick by tick.

    Parameters
    ----------
    machine : Machine
        For the settings and the log.
    lockstep : bool
        Whether the wall clock means nothing: then a shadow controller may lag behind without blame.

    Attributes
    ----------
    roster : Roster
        All controllers.
    invalid_sensors : tuple of str
        Sensors that may not be used at present.
    """

    def __init__(self, machine: Machine, lockstep: bool) -> None:
        self.roster = Roster()
        self.invalid_sensors: tuple[str, ...] = ()
        self._machine = machine
        self._lockstep = lockstep
        self._past: dict[int, _Past] = {}
        self._order: deque[int] = deque()

    def obstacle(self, name: str) -> str:
        """Why controller ``name`` may not be selected now, in words; empty when it may."""
        record = self.roster.get(name)
        if record is None:
            return f"controller {name} is unknown"
        settings = self._machine.settings
        return record.obstacle(settings.warm_ticks, self.invalid_sensors, settings.duplicate_ticks)

    def first_ready(self) -> str:
        """First controller that may be selected: the target, then the fallback list; empty if none."""
        names = (self._machine.target, *self._machine.settings.fallbacks)
        return next((name for name in names if not self.obstacle(name)), "")

    def join(self, name: str) -> ControllerRecord | None:
        """Record of ``name``, which is in the graph; None when there are too many controllers."""
        known = self.roster.get(name)
        if known is not None and known.present:
            return known
        record = self.roster.admit(name)
        if record is not None:
            record.present = True
            self._machine.log(Level.INFO, name, f"controller {name} has joined")
        return record

    def leave(self, name: str) -> None:
        """Note that ``name`` is no longer in the graph."""
        record = self.roster.get(name)
        if record is not None and record.present:
            record.present = False
            self._machine.log(Level.WARN, name, f"controller {name} has left the graph")

    def readmit_all(self, who: str) -> list[str]:
        """Let all latched-out controllers take part again; returns their names."""
        names = [record.name for record in self.roster if record.latched_out]
        for record in self.roster:
            record.latched_out = ""
        if names:
            self._machine.log(Level.INFO, who, f"readmitted by {who}: {', '.join(names)}")
        return names

    def forget_time(self) -> None:
        """The clock went back: stamps seen before mean nothing any more."""
        self._past.clear()
        self._order.clear()
        for record in self.roster:
            record.last_stamp_ns = -1
            record.early.clear()

    def take(self, record: ControllerRecord, proposal: ProposalInput, tick: Tick | None, now_s: float) -> None:
        """Take a proposal: to the present tick, to one that is over, or to one that has not begun here yet."""
        if tick is None or proposal.stamp_ns > tick.stamp_ns:
            record.early.setdefault(proposal.stamp_ns, proposal)
            if len(record.early) > _KEPT_EARLY:
                del record.early[min(record.early)]
        elif proposal.stamp_ns == tick.stamp_ns:
            self._judge(record, proposal, tick, now_s)
        else:
            self._judge_old(record, proposal, tick)

    def take_early(self, tick: Tick, now_s: float) -> None:
        """Take the proposals that came before their measurement."""
        for record in self.roster:
            early = record.early.pop(tick.stamp_ns, None)
            record.early = {stamp: item for stamp, item in record.early.items() if stamp > tick.stamp_ns}
            if early is not None:
                self._judge(record, early, tick, now_s)

    def close(self, tick: Tick) -> None:
        """Close the books of a tick: who answered and who did not."""
        self._past[tick.stamp_ns] = _Past(tick.before, bool(tick.blameless))
        self._order.append(tick.stamp_ns)
        if len(self._order) > LOCKSTEP_LAG:
            self._past.pop(self._order.popleft(), None)
        for record in self.roster:
            record.doubled = record.doubled + 1 if record.name in tick.doubled else 0
            record.conflicts = record.conflicts + 1 if record.name in tick.conflicts else 0
            if record.doubled == self._machine.settings.duplicate_ticks:
                text = f"{record.name} proposes more than once per tick: are there two controllers of this name?"
                self._machine.log(Level.ERROR, record.name, text)
            if record.name not in tick.verdicts:
                self._note_silence(record, tick)

    def _note_silence(self, record: ControllerRecord, tick: Tick) -> None:
        record.silent_ticks += 1
        if tick.blameless or (self._lockstep and record.silent_ticks < LOCKSTEP_LAG):
            return
        if record.present:
            record.missed += 1
        if record.consecutive_good:
            self._machine.log(Level.WARN, record.name, f"controller {record.name} has not proposed in time")
            record.bad("no proposal at the deadline")
        elif not record.problem:
            record.bad("no proposal at the deadline")

    def _judge(self, record: ControllerRecord, proposal: ProposalInput, tick: Tick, now_s: float) -> None:
        if record.last_stamp_ns == tick.stamp_ns:
            record.duplicates += 1
            tick.doubled.add(record.name)
            earlier = tick.verdicts.get(record.name)
            if earlier is not None and not same(earlier.command, proposal.command):
                tick.conflicts.add(record.name)
            return
        record.last_stamp_ns = tick.stamp_ns
        if tick.decided and tick.blameless:
            return
        latency_s = max(0.0, now_s - tick.started_s)
        record.latency.add(latency_s)
        if now_s > tick.deadline_s and not self._lockstep:
            record.late += 1
            record.bad(f"late: {latency_s * 1e3:.0f} ms after the measurement")
            return
        verdict = check(record.name, proposal, tick.before, self._machine.settings.limits)
        tick.verdicts[record.name] = verdict
        self._enter(record, verdict)

    def _judge_old(self, record: ControllerRecord, proposal: ProposalInput, tick: Tick) -> None:
        if proposal.stamp_ns <= record.last_stamp_ns:
            record.duplicates += 1
            record.rejected += 1
            return
        record.last_stamp_ns = proposal.stamp_ns
        past = self._past.get(proposal.stamp_ns)
        if self._lockstep and past is not None:
            self._enter(record, check(record.name, proposal, past.before, self._machine.settings.limits))
            return
        record.late += 1
        if past is None or not past.stalled:
            age_ms = (tick.stamp_ns - proposal.stamp_ns) * 1e-6
            record.bad(f"late: answers a measurement {age_ms:.0f} ms older than the last")

    def _enter(self, record: ControllerRecord, verdict: Verdict) -> None:
        machine = self._machine
        if not verdict.ok:
            if verdict.content:
                record.rejected += 1
            if record.consecutive_good or not record.problem:
                machine.log(Level.WARN, record.name, f"proposal of {record.name} refused: {verdict.reason}")
            record.bad(verdict.reason)
            return
        record.good()
        if record.consecutive_good == machine.settings.warm_ticks:
            machine.log(Level.INFO, record.name, f"controller {record.name} is warm")
        if record.latched_out and 0 < machine.settings.readmit_ticks <= record.consecutive_good:
            record.latched_out = ""
            machine.log(Level.INFO, record.name, f"controller {record.name} is readmitted after good shadow ticks")
