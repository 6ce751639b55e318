"""Result of a read: values with status and source timestamp, checked against the counter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite, nan
from typing import NamedTuple

from fsw_control.units import NANOSECONDS
from fsw_machine.machine_file import Measured, ReadNode

#: largest lead of a value over the cycle counter: half a cycle [ns]; beyond it, the value is from
#: another cycle or clock
_NEWER_NS = 50_000_000
#: the two upper bits of a status code; 0: good, 1: uncertain, 2: bad
_SEVERITY_BITS = 30


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
