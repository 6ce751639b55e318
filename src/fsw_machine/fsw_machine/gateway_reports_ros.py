"""Diagnostics of the gateway, one entry per part."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fsw_control.reports_ros import ERROR, OK, WARN, Report
from fsw_control.units import NANOSECONDS
from fsw_machine.gateway import Gateway


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
        return Report("connection", OK, "connected", values)
    values["next attempt in [s]"] = f"{retry_s:.1f}"
    return Report("connection", ERROR, lost or "connecting", values)


def machine(gateway: Gateway, stalled_s: float, skipped: int, restarts: int) -> Report:
    """Whether the machine runs and permits commands, and its invalid values."""
    faults = [f"{name}: {one.fault}" for name, one in gateway.samples.items() if one.fault]
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
            name: one.fault or f"{one.value:.6g}" for name, one in gateway.samples.items()
        } | values
    if not gateway.connected:
        return Report("machine", ERROR, "not connected", values)
    if stalled_s:
        return Report(
            "machine", ERROR, f"the cycle counter has not changed for {stalled_s:.1f} s", values
        )
    if not gateway.samples:
        return Report("machine", WARN, "not read yet", values)
    if faults:
        return Report("machine", WARN, f"invalid: {', '.join(faults)}", values)
    if not gateway.permissive:
        return Report(
            "machine",
            WARN,
            "permits no commands: nothing is written, drives are not reported",
            values,
        )
    if not gateway.joined:
        return Report(
            "machine",
            WARN,
            "measurements are paused, so that control starts anew from the drives' values",
            values,
        )
    return Report("machine", OK, "runs and obeys", values)


def clock(gateway: Gateway, parameters: Mapping[str, Any]) -> Report:
    """Difference between the server's clock and the local one, and its handling."""
    kind, stamps = parameters["clock.stamps"], gateway.stamps
    values: dict[str, object] = {
        "stamps": kind,
        "steps of the server's clock": stamps.steps,
        "stamp less source timestamp [s]": f"{stamps.shift_ns / NANOSECONDS:.6f}",
    }
    if gateway.read is None:
        return Report("clock", OK, "not known yet", values)
    skew_s = (gateway.read.source_ns - gateway.read.read_ns) / NANOSECONDS
    values["server's clock less local one [s]"] = f"{skew_s:.6f}"
    side = "ahead of" if skew_s > 0.0 else "behind"
    text = f"server's clock is {abs(skew_s):.3f} s {side} the local one"
    level = OK
    if abs(skew_s) > parameters["clock.error_s"] and kind == "source":
        level = ERROR
    elif abs(skew_s) > parameters["clock.warn_s"]:
        level = WARN
    if stamps.steps:
        level, text = (
            max(level, WARN),
            f"{text}; it was set {stamps.steps} times, stamps continue without the step",
        )
    return Report("clock", level, text, values)


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
        return Report(
            "writes", ERROR, f"{new_failures} not taken; last: {gateway.last_failure}", values
        )
    return Report("writes", OK, "taken" if gateway.written else "nothing written yet", values)
