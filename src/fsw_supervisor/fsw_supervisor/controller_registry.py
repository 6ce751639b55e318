"""The controllers in the graph: a record for each, and the check of its candidate commands."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from fsw_control.message_synchronizer import JUMP_NS
from fsw_control.reason import Lack, Readiness, Reason, ReasonCode
from fsw_control.sensors import SENSORS
from fsw_control.units import NANOSECONDS
from fsw_supervisor.facts import Code
from fsw_supervisor.safety_monitor import SafetyMonitor
from fsw_supervisor.state_machine import Level, Machine
from fsw_supervisor.tick import Candidate, ProposalInput, Tick, check, same

#: ticks that a proposal may lag in lockstep before its controller counts as silent
LOCKSTEP_LAG = 20
#: proposals kept for measurements that have not arrived yet; more than a burst after a stall
_KEPT_EARLY = 8
#: largest number of controllers
_CAPACITY = 32
#: latencies of one controller kept for statistics
_KEPT_LATENCIES = 300


@dataclass(slots=True)
class ControllerRecord:
    """State of a controller as seen by the arbiter."""

    name: str
    present: bool = False  #: in the graph
    #: why it failed while active; empty if it may be selected
    inhibited: Reason = Reason()  # noqa: RUF009  # immutable
    #: why its last tick was not good; empty if it was
    problem: Reason = Reason()  # noqa: RUF009  # immutable
    consecutive_good: int = 0  #: good proposals in a row
    missed: int = 0  #: ticks without a proposal at the deadline
    late: int = 0  #: proposals after the deadline
    rejected: int = 0  #: proposals rejected for their content or stamp
    duplicates: int = 0  #: repeated proposals for a stamp
    silent_ticks: int = 0  #: ticks in a row without a proposal
    doubled: int = 0  #: ticks in a row with more than one proposal
    conflicts: int = 0  #: ticks in a row with two different proposals
    tolerated_sensors: tuple[str, ...] = ()  #: that may be invalid for a while, as declared
    status_seen: bool = False
    last_stamp_ns: int = -1  #: of its newest proposal
    #: by stamp, proposals whose measurement has not arrived yet
    early: dict[int, ProposalInput] = field(default_factory=dict)
    latencies_s: deque[float] = field(default_factory=lambda: deque(maxlen=_KEPT_LATENCIES))

    def bad(self, problem: Reason) -> None:
        """Note a tick that was not good."""
        self.consecutive_good = 0
        self.problem = problem

    def inhibit(self, reason: Reason) -> None:
        """Note a failure while active: it cannot be selected until it is readmitted."""
        self.inhibited = reason
        self.bad(reason)


class ControllerRegistry:
    """All controllers ever seen, and their candidate commands, tick by tick.

    Its size is limited, so that flooding nodes cannot exhaust the memory. In lockstep, where the
    wall clock is irrelevant, a lagging shadow controller does not count as failed.
    """

    def __init__(self, machine: Machine, safety: SafetyMonitor, lockstep: bool) -> None:
        self._machine = machine
        self._safety = safety
        self._lockstep = lockstep
        self._records: dict[str, ControllerRecord] = {}  # in the order of their names
        self._past: dict[int, Tick] = {}

    def __iter__(self) -> Iterator[ControllerRecord]:
        """Records in the order of their names."""
        return iter(self._records.values())

    def get(self, name: str) -> ControllerRecord | None:
        """Record of ``name``; None if it was never seen."""
        return self._records.get(name)

    def any_reported(self) -> bool:
        """Whether a controller has published its status."""
        return any(record.status_seen for record in self)

    def all_reported(self) -> bool:
        """Whether every controller in the graph has published its status."""
        present = [record for record in self if record.present]
        return bool(present) and all(record.status_seen for record in present)

    def readiness(self, name: str) -> Readiness:
        """Whether controller ``name`` may be selected now, and if not, what it lacks."""
        record, settings = self.get(name), self._machine.settings
        if record is None:
            return Readiness(Lack.UNKNOWN)
        if record.inhibited:
            return Readiness(Lack.INHIBITED, record.inhibited)
        if record.conflicts >= settings.duplicate_ticks:
            return Readiness(Lack.AMBIGUOUS)
        if record.problem:
            return Readiness(Lack.UNUSABLE, record.problem)
        if not record.present and not record.consecutive_good:
            return Readiness(Lack.LEFT)
        if record.consecutive_good < settings.warm_ticks:
            good, required = record.consecutive_good, settings.warm_ticks
            return Readiness(Lack.WARMING, good=good, required=required)
        return self.sight(name)

    def is_ready(self, name: str) -> bool:
        """Whether controller ``name`` may be selected now."""
        return self.readiness(name).lack is Lack.NONE

    def sight(self, name: str) -> Readiness:
        """Whether controller ``name`` requires a sensor that is invalid."""
        tolerated = self._records[name].tolerated_sensors
        needed = [sensor for sensor in self._safety.invalid_sensors if sensor not in tolerated]
        return Readiness(Lack.BLIND, sensors=tuple(needed)) if needed else Readiness()

    def blind(self, name: str) -> Reason:
        """Reason with the invalid sensors that controller ``name`` requires; empty if none."""
        sensors = self.sight(name).sensors
        return Reason(ReasonCode.SENSOR_REQUIRED, sensors) if sensors else Reason()

    def all_ready(self) -> frozenset[str]:
        """Controllers that may be selected now."""
        return frozenset(name for name in self._records if self.is_ready(name))

    def first_ready(self) -> str:
        """First selectable controller: the target, then the fallbacks; empty if there is none."""
        names = (self._machine.target, *self._machine.settings.fallbacks)
        return next((name for name in names if self.is_ready(name)), "")

    # ---------------------------------------------------------------- membership

    def join(self, name: str) -> None:
        """Note that ``name`` is in the graph; ignored if there are too many controllers."""
        record = self.get(name)
        if record is None and len(self._records) < _CAPACITY:
            record = ControllerRecord(name)
            self._records = dict(sorted([*self._records.items(), (name, record)]))
        if record is not None and not record.present:
            record.present = True
            self._machine.log(Level.INFO, name, Code.JOINED, controller=name)

    def leave(self, name: str) -> None:
        """Note that ``name`` is no longer in the graph."""
        record = self.get(name)
        if record is not None and record.present:
            record.present = False
            self._machine.log(Level.WARN, name, Code.LEFT, controller=name)

    def on_status(self, name: str, tolerated_sensors: tuple[str, ...]) -> bool:
        """Take a controller's status; return whether the controller is known."""
        record = self.get(name)
        if record is not None:
            record.tolerated_sensors = tuple(name for name in tolerated_sensors if name in SENSORS)
            record.status_seen = True
        return record is not None

    def mirror_inhibitions(self, reasons: Mapping[str, Reason]) -> None:
        """Inhibit exactly the controllers that another supervisor has inhibited."""
        for record in self:
            record.inhibited = reasons.get(record.name, Reason())

    def readmit_all(self, who: str) -> None:
        """Readmit all inhibited controllers."""
        names = tuple(record.name for record in self if record.inhibited)
        self.mirror_inhibitions({})
        if names:
            self._machine.log(Level.INFO, who, Code.READMITTED, who=who, controllers=names)

    # ---------------------------------------------------------------- candidate commands

    def forget_time(self, stamp_ns: int) -> None:
        """Forget stamps other than ``stamp_ns``, to which the clock went back."""
        self._past.clear()
        for record in self:
            record.last_stamp_ns = -1
            early = record.early.get(stamp_ns)
            record.early = {} if early is None else {stamp_ns: early}

    def take(
        self, name: str, proposal: ProposalInput, tick: Tick | None, now_s: float
    ) -> Tick | None:
        """Take a proposal of ``name`` for the present tick, a past one or a future one.

        Returns the present tick.
        """
        self.join(name)
        record = self.get(name)
        if record is None:
            return tick
        # An answer to a much older stamp may result from a clock that went back; its measurement
        # then arrives later.
        stamp_ns = proposal.stamp_ns
        far_back = tick is not None and stamp_ns < tick.stamp_ns - JUMP_NS
        if tick is None or stamp_ns > tick.stamp_ns or (far_back and stamp_ns not in self._past):
            record.early.setdefault(stamp_ns, proposal)
            if len(record.early) > _KEPT_EARLY:
                del record.early[next(iter(record.early))]
        elif stamp_ns == tick.stamp_ns:
            return self._take_present(record, proposal, tick, now_s)
        else:
            self._take_old(record, proposal, tick)
        return tick

    def take_early(self, tick: Tick, now_s: float) -> Tick:
        """Take the proposals that arrived before their measurement; return its tick."""
        for record in self:
            early = record.early.pop(tick.stamp_ns, None)
            items = record.early.items()
            record.early = {stamp: item for stamp, item in items if stamp > tick.stamp_ns}
            if early is not None:
                tick = self._take_present(record, early, tick, now_s)
        return tick

    def check_again(self, tick: Tick) -> Tick:
        """Check the candidates that arrived before the command in force was known."""
        for name, candidate in tick.candidates.items():
            if not candidate.refusal:
                again = ProposalInput(tick.stamp_ns, name, candidate.command)
                checked = self._check(self._records[name], again, tick)
                if checked.refusal:
                    tick = tick.with_candidate(name, checked)
                    self._count(self._records[name], checked)
        return tick

    def close(self, tick: Tick) -> None:
        """At the end of a tick, count the controllers that have answered."""
        # kept for answers in lockstep that arrive after their tick
        self._past[tick.stamp_ns] = tick
        if len(self._past) > LOCKSTEP_LAG:
            del self._past[next(iter(self._past))]
        # Two counts: repetitions are reported, different answers make the name unusable. Both
        # count ticks in a row, so that one overlap, as when a process is replaced, does no harm.
        for record in self:
            record.doubled = record.doubled + 1 if record.name in tick.duplicates else 0
            record.conflicts = record.conflicts + 1 if tick.duplicates.get(record.name) else 0
            if record.doubled == self._machine.settings.duplicate_ticks:
                self._machine.log(Level.ERROR, record.name, Code.DOUBLED, controller=record.name)
            if record.name not in tick.candidates:
                self._note_silence(record, tick)

    def _note_silence(self, record: ControllerRecord, tick: Tick) -> None:
        record.silent_ticks += 1
        if tick.excuse or (self._lockstep and record.silent_ticks < LOCKSTEP_LAG):
            return
        if record.present:
            record.missed += 1
        if record.consecutive_good:
            self._machine.log(Level.WARN, record.name, Code.SILENT, controller=record.name)
        if record.consecutive_good or not record.problem:
            record.bad(Reason(ReasonCode.NO_PROPOSAL))

    def _take_present(
        self, record: ControllerRecord, proposal: ProposalInput, tick: Tick, now_s: float
    ) -> Tick:
        if record.last_stamp_ns == tick.stamp_ns:
            record.duplicates += 1
            earlier = tick.candidates.get(record.name)
            # Two different answers to one measurement mean two processes of one name. Which one
            # would be applied depends on chance, so the name becomes unusable after some ticks.
            differs = earlier is not None and not same(earlier.command, proposal.command)
            # in lockstep a controller answers a repeated tick again
            if differs or not self._lockstep:
                differs = differs or tick.duplicates.get(record.name, False)
                return tick._replace(duplicates={**tick.duplicates, record.name: differs})
            return tick
        record.last_stamp_ns = tick.stamp_ns
        if tick.settled and tick.excuse:
            return tick
        latency_s = max(0.0, now_s - tick.started_s)
        record.latencies_s.append(latency_s)
        if now_s > tick.deadline_s and not self._lockstep:
            record.late += 1
            record.bad(Reason(ReasonCode.LATE, limit_s=latency_s))
            return tick
        candidate = self._check(record, proposal, tick)
        self._count(record, candidate)
        return tick.with_candidate(record.name, candidate)

    def _take_old(self, record: ControllerRecord, proposal: ProposalInput, tick: Tick) -> None:
        if proposal.stamp_ns <= record.last_stamp_ns:
            record.duplicates += 1
            record.rejected += 1
            return
        record.last_stamp_ns = proposal.stamp_ns
        past = self._past.get(proposal.stamp_ns)
        # In lockstep a late answer is still checked against its own tick: speed is not judged.
        if self._lockstep and past is not None:
            self._count(record, self._check(record, proposal, past))
            return
        record.late += 1
        if past is None or not past.excuse:
            age_s = (tick.stamp_ns - proposal.stamp_ns) / NANOSECONDS
            record.bad(Reason(ReasonCode.OUTDATED, limit_s=age_s))

    def _check(self, record: ControllerRecord, proposal: ProposalInput, tick: Tick) -> Candidate:
        return check(record.name, proposal, tick.previous, self._machine.settings.drive_limits)

    def _count(self, record: ControllerRecord, candidate: Candidate) -> None:
        """Update a controller's counts with a candidate command."""
        machine = self._machine
        if candidate.refusal:
            record.rejected += candidate.malformed
            if record.consecutive_good or not record.problem:
                data = {"controller": record.name, "reason": candidate.refusal}
                values = candidate.command._asdict()
                machine.log(Level.WARN, record.name, Code.REFUSED, **data, **values)
            record.bad(candidate.refusal)
            return
        record.consecutive_good += 1
        record.silent_ticks = 0
        record.problem = Reason()
        if record.consecutive_good == machine.settings.warm_ticks and not record.inhibited:
            machine.log(Level.INFO, record.name, Code.READY, controller=record.name)
        if record.inhibited and 0 < machine.settings.readmit_ticks <= record.consecutive_good:
            record.inhibited = Reason()
            machine.log(Level.INFO, record.name, Code.RECOVERED, controller=record.name)
