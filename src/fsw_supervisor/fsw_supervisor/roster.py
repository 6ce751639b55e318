"""Who could control: one record per controller, alive or not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from fsw_supervisor.checks import ProposalInput
from fsw_supervisor.timing import LatencyStatistics


@dataclass(slots=True)
class ControllerRecord:
    """What the arbiter knows of one controller.

    Attributes
    ----------
    name : str
        As in its topic ``<name>/proposal``.
    present : bool
        Whether it is in the graph.
    latched_out : str
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
    latched_out: str = ""
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

    def obstacle(self, warm_ticks: int, invalid_sensors: tuple[str, ...], duplicate_ticks: int) -> str:
        """Why the controller may not be selected now, in words; empty when it may."""
        if self.latched_out:
            return f"{self.name} is latched out: {self.latched_out}"
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


class Roster:
    """All controllers ever seen, by name; bounded, so that a babbling graph cannot fill the memory."""

    def __init__(self, capacity: int = 32) -> None:
        self._records: dict[str, ControllerRecord] = {}
        self._capacity = capacity

    def __iter__(self) -> Iterator[ControllerRecord]:
        """Records in the order of their names."""
        return iter([self._records[name] for name in sorted(self._records)])

    def get(self, name: str) -> ControllerRecord | None:
        """Record of ``name``, or None when it was never seen."""
        return self._records.get(name)

    def admit(self, name: str) -> ControllerRecord | None:
        """Record of ``name``, made if need be; None when the roster is full."""
        record = self._records.get(name)
        if record is None and len(self._records) < self._capacity:
            record = self._records[name] = ControllerRecord(name)
        return record
