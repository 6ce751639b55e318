"""Who could control: one record per controller, alive or not, and the judgement of its candidate commands."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import ceil, sqrt
from statistics import fmean

from fsw_control.contract import SENSORS, Command
from fsw_supervisor.safety_monitor import SafetyMonitor
from fsw_supervisor.state_machine import Level, Machine
from fsw_supervisor.tick import ProposalInput, Tick, Verdict, check, same


class LatencyStatistics:
    """Statistics over the last proposals.

    Parameters
    ----------
    window : int
        Number of latencies kept.
    """

    def __init__(self, window: int = 300) -> None:
        self._values: deque[float] = deque(maxlen=window)

    def __len__(self) -> int:
        return len(self._values)

    def add(self, latency_s: float) -> None:
        """Add one latency [s]."""
        self._values.append(latency_s)

    @property
    def mean_s(self) -> float:
        """Mean latency [s], 0 before the first."""
        return fmean(self._values) if self._values else 0.0

    @property
    def max_s(self) -> float:
        """Largest latency [s] of the window."""
        return max(self._values, default=0.0)

    @property
    def jitter_s(self) -> float:
        """Standard deviation of the latency [s]."""
        mean_s = self.mean_s
        return sqrt(fmean((value - mean_s) ** 2 for value in self._values)) if self._values else 0.0

    def quantile_s(self, fraction: float) -> float:
        """Latency [s] that ``fraction`` (0 to 1) of the window stays at or below."""
        if not self._values:
            return 0.0
        ordered = sorted(self._values)
        return ordered[max(0, ceil(fraction * len(ordered)) - 1)]


@dataclass(slots=True)
class ControllerRecord:
    """What the arbiter knows of one controller.

    Attributes
    ----------
    name : str
        As in its topic ``<name>/proposal``.
    present : bool
        Whether it is in the graph.
    inhibited : str
        Why it failed while active; empty when it may be selected.
    problem : str
        Why its last tick was not good; empty when it was.
    consecutive_good : int
        Good proposals in a row.
    missed, late, rejected, duplicates : int
        Ticks without a proposal at the deadline; proposals after the deadline; proposals refused for their
        content or stamp; further proposals to a stamp already answered.
    silent_ticks : int
        Ticks in a row without a proposal.
    doubled, conflicts : int
        Ticks in a row with more than one proposal; with two different ones.
    tolerated_sensors : tuple of str
        Sensors that it declares to do without for a while.
    status_seen : bool
        Whether a status was received.
    last_stamp_ns : int
        Stamp of its newest proposal.
    early : dict of int to ProposalInput
        By stamp, proposals to measurements that have not reached the arbiter yet.
    """

    name: str
    present: bool = True
    inhibited: str = ""
    problem: str = ""
    consecutive_good: int = 0
    missed: int = 0
    late: int = 0
    rejected: int = 0
    duplicates: int = 0
    silent_ticks: int = 0
    doubled: int = 0
    conflicts: int = 0
    tolerated_sensors: tuple[str, ...] = ()
    status_seen: bool = False
    last_stamp_ns: int = -1
    early: dict[int, ProposalInput] = field(default_factory=dict)
    latency: LatencyStatistics = field(default_factory=LatencyStatistics)

    def good(self) -> None:
        """Note a good proposal."""
        self.consecutive_good += 1
        self.silent_ticks = 0
        self.problem = ""

    def bad(self, problem: str) -> None:
        """Note a tick that was not good."""
        self.consecutive_good = 0
        self.problem = problem

    def inhibit(self, reason: str) -> None:
        """Note that it failed while active: it may not be selected until it is readmitted."""
        self.inhibited = reason
        self.bad(reason)

    def obstacle(self, warm_ticks: int, invalid_sensors: tuple[str, ...], duplicate_ticks: int) -> str:
        """Why the controller may not be selected now, in words; empty when it may."""
        if self.inhibited:
            return f"{self.name} is inhibited: {self.inhibited}"
        if self.conflicts >= duplicate_ticks:
            return f"{self.name} is ambiguous: two controllers of this name propose"
        if self.problem:
            return f"{self.name} is not usable: {self.problem}"
        if not self.present and not self.consecutive_good:
            return f"{self.name} has left the graph"
        if self.consecutive_good < warm_ticks:
            return f"{self.name} is not warm yet: {self.consecutive_good} of {warm_ticks} good proposals in a row"
        return self.blind_to(invalid_sensors)

    def blind_to(self, invalid_sensors: tuple[str, ...]) -> str:
        """Which invalid sensor the controller does not cope with, in words; empty when it copes."""
        needed = [sensor for sensor in invalid_sensors if sensor not in self.tolerated_sensors]
        return f"{self.name} cannot do without the sensor {', '.join(needed)}" if needed else ""


#: ticks that a proposal may lag behind in lockstep before its controller counts as silent
LOCKSTEP_LAG = 20
#: proposals of one controller kept for measurements that have not come yet; more than a burst after a stall
_KEPT_EARLY = 8
#: controllers at most
_CAPACITY = 32


@dataclass(frozen=True, slots=True)
class _Past:
    before: Command | None
    stalled: bool


class ControllerRegistry:
    """All controllers ever seen, and their candidate commands, tick by tick.

    It is bounded, so that a babbling graph cannot fill the memory.

    Parameters
    ----------
    machine : Machine
        For the settings and the log.
    safety : SafetyMonitor
        Knows which sensors may be used.
    lockstep : bool
        Whether the wall clock means nothing: then a shadow controller may lag behind without blame.
    """

    def __init__(self, machine: Machine, safety: SafetyMonitor, lockstep: bool) -> None:
        self._machine = machine
        self._safety = safety
        self._lockstep = lockstep
        self._records: dict[str, ControllerRecord] = {}
        self._past: dict[int, _Past] = {}
        self._order: deque[int] = deque()

    def __iter__(self) -> Iterator[ControllerRecord]:
        """Records in the order of their names."""
        return iter([self._records[name] for name in sorted(self._records)])

    def get(self, name: str) -> ControllerRecord | None:
        """Record of ``name``, or None when it was never seen."""
        return self._records.get(name)

    def all_told(self) -> bool:
        """Whether every controller in the graph has told its status."""
        present = [record for record in self if record.present]
        return bool(present) and all(record.status_seen for record in present)

    def obstacle(self, name: str) -> str:
        """Why controller ``name`` may not be selected now, in words; empty when it may."""
        record = self.get(name)
        if record is None:
            return f"controller {name} is unknown"
        settings = self._machine.settings
        return record.obstacle(settings.warm_ticks, self._safety.invalid_sensors, settings.duplicate_ticks)

    def first_ready(self) -> str:
        """First controller that may be selected: the target, then the fallback list; empty if none."""
        names = (self._machine.target, *self._machine.settings.fallbacks)
        return next((name for name in names if not self.obstacle(name)), "")

    def join(self, name: str) -> ControllerRecord | None:
        """Record of ``name``, which is in the graph; None when there are too many controllers."""
        known = self.get(name)
        if known is not None and known.present:
            return known
        if known is None and len(self._records) >= _CAPACITY:
            return None
        record = self._records.setdefault(name, ControllerRecord(name))
        record.present = True
        self._machine.log(Level.INFO, name, f"controller {name} has joined")
        return record

    def hear_status(self, name: str, tolerated_sensors: tuple[str, ...]) -> bool:
        """Take what a controller declares of itself; returns whether it is known."""
        record = self.get(name)
        if record is not None:
            record.tolerated_sensors = tuple(sensor for sensor in tolerated_sensors if sensor in SENSORS)
            record.status_seen = True
        return record is not None

    def leave(self, name: str) -> None:
        """Note that ``name`` is no longer in the graph."""
        record = self.get(name)
        if record is not None and record.present:
            record.present = False
            self._machine.log(Level.WARN, name, f"controller {name} has left the graph")

    def follow_inhibitions(self, reasons: Mapping[str, str]) -> None:
        """Take over from another supervisor who is inhibited, and why."""
        for record in self:
            record.inhibited = reasons.get(record.name, "")

    def readmit_all(self, who: str) -> list[str]:
        """Let all inhibited controllers take part again; returns their names."""
        names = [record.name for record in self if record.inhibited]
        for record in self:
            record.inhibited = ""
        if names:
            self._machine.log(Level.INFO, who, f"readmitted by {who}: {', '.join(names)}")
        return names

    def forget_time(self) -> None:
        """The clock went back: stamps seen before mean nothing any more."""
        self._past.clear()
        self._order.clear()
        for record in self:
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
        for record in self:
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
        for record in self:
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
        if record.inhibited and 0 < machine.settings.readmit_ticks <= record.consecutive_good:
            record.inhibited = ""
            machine.log(Level.INFO, record.name, f"controller {record.name} is readmitted after good shadow ticks")
