"""Result of a read: values with status and source timestamp, checked by counter and stamps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import NamedTuple

from fsw_control.units import NANOSECONDS
from fsw_machine.machine_file import Measured, ReadNode

#: polling begins this long before the expected change [s]
LEAD_S = 0.004
#: polling periods near the expected change, and when it is overdue [s]
NEAR_S = 0.002
OVERDUE_S = 0.01
#: number of periods after which the change is overdue
_OVERDUE_PERIODS = 1.5
#: share of the phase error that is corrected per change (a first-order phase-locked loop)
_GAIN = 0.2


class CycleTracker:
    """Tracks the counter, and the phase of its changes on the local steady clock.

    A server reports changes of a value only to subscribers, and itself chooses the sampling and
    publishing intervals. So the counter is polled, but only about when it is due.
    """

    def __init__(self, period_s: float) -> None:
        #: cycles that were never seen, and times that the counter went back
        self.skipped = self.restarts = 0
        #: number of values of the counter's type, after which it wraps around. A step by half of
        #: them or more counts as going back
        self.values = 1 << 64
        self._period_s = period_s
        self._counter: int | None = None
        self._due_s = -inf
        self._has_waited = False

    def see(self, counter: int, read_s: float) -> int | None:
        """Take a value of the counter, read at ``read_s`` on a steady clock.

        Returns
        -------
        int or None
            None if it has not changed; else the cycles since the previous value, 0 for the first
            value and if it has gone back.
        """
        before, self._counter = self._counter, counter
        if counter == before:
            self._has_waited = True
            return None
        steps = 0 if before is None else (counter - before) % self.values
        if 2 * steps >= self.values:
            steps = 0
        if before is not None and not steps:
            self.restarts += 1
        self.skipped += max(0, steps - 1)
        self._correct(steps, read_s)
        self._has_waited = False
        return steps

    def next_poll_s(self, read_s: float) -> float:
        """When to poll next, after a read at ``read_s``."""
        if read_s > self._due_s + (_OVERDUE_PERIODS - 1.0) * self._period_s:
            return read_s + OVERDUE_S
        return max(self._due_s - LEAD_S, read_s + NEAR_S)

    def _correct(self, steps: int, read_s: float) -> None:
        """Note when the next change is due."""
        if steps != 1 or abs(read_s - self._due_s) > self._period_s / 2.0:
            self._due_s = read_s + self._period_s
        elif self._has_waited:
            self._due_s += self._period_s + _GAIN * (read_s - self._due_s)
        else:
            # It had changed before the first poll, at an unknown time: poll earlier next time.
            self._due_s = min(self._due_s, read_s) + self._period_s - LEAD_S


#: largest lead of a value over the cycle counter: half a cycle [ns]; beyond it, the value is from
#: another cycle or clock
_NEWER_NS = 50_000_000
#: the two upper bits of a status code; 0: good, 1: uncertain, 2: bad
_SEVERITY_BITS = 30

#: deviation of the source timestamps from counter and local clock that counts as a clock step of
#: the server [ns]
STEP_NS = 500_000_000


class Stamps:
    """Stamps that increase with the machine's cycles, independent of steps of its clock.

    A stamp is the counter's source timestamp plus a shift. The shift is 0 at first, or with
    ``received`` makes the first stamp the local time. If the source timestamps deviate by half a
    second both from the counted cycles and from the local time, or do not increase, the server's
    clock was set: the shift absorbs the step, and the stamps continue without it. Smaller
    deviations come from a busy machine or network.
    """

    def __init__(self, period_ns: int, received: bool = False) -> None:
        self.steps = 0  #: clock steps of the server
        self.shift_ns = 0  #: stamp less source timestamp
        self._period_ns, self._received = period_ns, received
        self._last_ns: int | None = None

    def next(self, source_ns: int, steps: int, local_ns: int, elapsed_ns: int) -> int:
        """Return the stamp of a tick from the counter's source timestamp.

        ``steps`` and ``elapsed_ns`` are the cycles (0: unknown) and the local steady time since
        the previous tick; ``local_ns`` is the local wall clock.
        """
        if self._last_ns is None:
            self.shift_ns = local_ns - source_ns if self._received else 0
        else:
            moved_ns = source_ns + self.shift_ns - self._last_ns
            counted_ns = steps * self._period_ns
            passed_ns = max(elapsed_ns, self._period_ns)
            off_ns = min(abs(moved_ns - (counted_ns or passed_ns)), abs(moved_ns - passed_ns))
            if off_ns > STEP_NS or moved_ns <= 0:
                self.steps += 1
                self.shift_ns += (counted_ns or passed_ns) - moved_ns
        self._last_ns = source_ns + self.shift_ns
        return self._last_ns


@dataclass(frozen=True, slots=True)
class RawValue:
    """A value as the server sent it."""

    value: object  #: of any type; None: no value
    status: int = 0  #: OPC UA status code
    status_name: str = "Good"  #: for messages
    source_ns: int | None = None  #: source timestamp, on the server's clock

    @property
    def good(self) -> bool:
        """Whether the status is good, i.e. neither uncertain nor bad."""
        return self.status >> _SEVERITY_BITS == 0


class Sample(NamedTuple):
    """A number in its internal unit, or NaN and the reason why it is not usable."""

    value: float
    fault: str = ""


@dataclass(frozen=True, slots=True)
class CycleRead:
    """The read that showed a new value of the cycle counter."""

    counter: int
    values: Mapping[str, RawValue]  #: by the names of ``Nodes.read``
    source_ns: int  #: source timestamp of the counter
    #: time of the answer, on the local steady clock and the local wall clock
    read_s: float
    read_ns: int
    steps: int  #: cycles since the previous counter value; 0 for the first, and if it went back


def fault_of(raw: RawValue, spec: ReadNode, cycle_ns: int) -> str:
    """Why a value is not usable in the cycle of ``cycle_ns``; empty if it is."""
    if not raw.good:
        return f"status {raw.status_name}"
    if raw.source_ns is None:
        return "without a source timestamp"
    age_ns = cycle_ns - raw.source_ns
    if age_ns > round(spec.stale_after_s * NANOSECONDS):
        return f"{age_ns / NANOSECONDS:.2f} s older than the cycle counter"
    if -age_ns > _NEWER_NS:
        return f"{-age_ns / NANOSECONDS:.2f} s newer than the cycle counter"
    return ""


def number_fault(value: object) -> str:
    """Why a value is not a finite number; empty if it is."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return f"{_type_name(value)}, not a number"
    return "" if isfinite(value) else "not finite"


def sample(raw: RawValue, spec: Measured[str], cycle_ns: int) -> Sample:
    """Convert a value to its internal unit."""
    fault = fault_of(raw, spec, cycle_ns) or number_fault(raw.value)
    return Sample(nan, fault) if fault else Sample(spec.inside(float(raw.value)))  # type: ignore


def bit(raw: RawValue, spec: ReadNode, cycle_ns: int) -> Sample:
    """A bit as 1.0 or 0.0; NaN if it is not usable."""
    fault = fault_of(raw, spec, cycle_ns)
    if not fault and not isinstance(raw.value, bool):
        fault = f"{_type_name(raw.value)}, not a Boolean"
    return Sample(nan, fault) if fault else Sample(float(raw.value is True))


def _type_name(value: object) -> str:
    return "empty" if value is None else f"a {type(value).__name__}"
