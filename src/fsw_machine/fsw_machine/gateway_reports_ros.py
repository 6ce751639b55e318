"""Diagnostics of the gateway, one entry per part."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fsw_control.coded import Fact, Worded
from fsw_control.reports_ros import ERROR, OK, WARN, Report
from fsw_control.units import NANOSECONDS
from fsw_machine.gateway import Gateway


class Note(Worded):
    """Diagnostics of the gateway's parts."""

    CONNECTED = "connected"
    CONNECTING = "connecting"
    LOST = "{error}"
    NOT_CONNECTED = "not connected"
    STALLED = "the cycle counter has not changed for {time_s:.1f} s"
    NOT_READ = "not read yet"
    INVALID = "invalid: {faults}"
    FAULT = "{name}: {fault}"
    NOT_PERMISSIVE = "permits no commands: nothing is written, drives are not reported"
    PAUSED = "measurements are paused, so that control restarts from the drives' values"
    OBEYS = "runs and obeys"
    CLOCK_UNKNOWN = "not known yet"
    CLOCK = "server's clock is {skew_s:+.3f} s against the local one"
    CLOCK_SET = (
        "server's clock is {skew_s:+.3f} s against the local one; "
        "it was set {steps} times, stamps continue without the step"
    )
    NOT_TAKEN = "{count} not taken; last: {last}"
    TAKEN = "taken"
    NOTHING_WRITTEN = "nothing written yet"


def connection(
    endpoint: str, connected: bool, lost: str, losses: int, attempts: int, retry_s: float
) -> Report:
    """Whether there is a session; ``lost`` is why not."""
    values = {
        "endpoint": endpoint,
        "losses": losses,
        "failed attempts since the last loss": attempts,
    }
    if connected:
        return Report("connection", OK, Fact.of(Note.CONNECTED), values)
    values["next attempt in [s]"] = f"{retry_s:.1f}"
    why = Fact.of(Note.LOST, error=lost) if lost else Fact.of(Note.CONNECTING)
    return Report("connection", ERROR, why, values)


def machine(gateway: Gateway, stalled_s: float, skipped: int, restarts: int) -> Report:
    """Whether the machine runs and permits commands, and its invalid values."""
    faults = [
        Fact.of(Note.FAULT, name=name, fault=sample.fault)
        for name, sample in gateway.samples.items()
        if sample.fault
    ]
    values: dict[str, object] = {
        "cycle counter": "" if gateway.read is None else gateway.read.counter,
        "cycles skipped": skipped,
        "counter went back": restarts,
        "permissive": gateway.permissive,
        "ticks": gateway.ticks,
        "ticks withheld for a pause": gateway.paused,
        "invalid values": gateway.invalid,
    }
    if gateway.connected:
        # "permissive" is the gateway's verdict, a bool that the operator page reads
        values = {
            name: sample.fault or f"{sample.value:.6g}" for name, sample in gateway.samples.items()
        } | values
    if not gateway.connected:
        return Report("machine", ERROR, Fact.of(Note.NOT_CONNECTED), values)
    if stalled_s:
        return Report("machine", ERROR, Fact.of(Note.STALLED, time_s=stalled_s), values)
    if not gateway.samples:
        return Report("machine", WARN, Fact.of(Note.NOT_READ), values)
    if faults:
        return Report("machine", WARN, Fact.of(Note.INVALID, faults=tuple(faults)), values)
    if not gateway.permissive:
        return Report("machine", WARN, Fact.of(Note.NOT_PERMISSIVE), values)
    if not gateway.joined:
        return Report("machine", WARN, Fact.of(Note.PAUSED), values)
    return Report("machine", OK, Fact.of(Note.OBEYS), values)


def clock(gateway: Gateway, parameters: Mapping[str, Any]) -> Report:
    """Difference between the server's clock and the local one, and its handling."""
    kind, stamps = parameters["clock.stamps"], gateway.stamps
    values: dict[str, object] = {
        "stamps": kind,
        "steps of the server's clock": stamps.steps,
        "stamp less source timestamp [s]": f"{stamps.shift_ns / NANOSECONDS:.6f}",
    }
    if gateway.read is None:
        return Report("clock", OK, Fact.of(Note.CLOCK_UNKNOWN), values)
    skew_s = (gateway.read.source_ns - gateway.read.read_ns) / NANOSECONDS
    values["server's clock less local one [s]"] = f"{skew_s:.6f}"
    fact, level = Fact.of(Note.CLOCK, skew_s=skew_s), OK
    if abs(skew_s) > parameters["clock.error_s"] and kind == "source":
        level = ERROR
    elif abs(skew_s) > parameters["clock.warn_s"]:
        level = WARN
    if stamps.steps:
        fact = Fact.of(Note.CLOCK_SET, skew_s=skew_s, steps=stamps.steps)
        level = max(level, WARN)
    return Report("clock", level, fact, values)


def writes(gateway: Gateway, new_failures: int, longest_s: float) -> Report:
    """Results of writes to the server; ``new_failures`` and ``longest_s`` since the last entry."""
    values = {
        "written": gateway.written,
        "not taken": gateway.failed,
        "cut to one move": gateway.cut,
        "last failure": gateway.last_failure,
        "longest round trip [ms]": f"{1e3 * longest_s:.1f}",
    }
    if new_failures:
        lost = Fact.of(Note.NOT_TAKEN, count=new_failures, last=gateway.last_failure)
        return Report("writes", ERROR, lost, values)
    code = Note.TAKEN if gateway.written else Note.NOTHING_WRITTEN
    return Report("writes", OK, Fact.of(code), values)
