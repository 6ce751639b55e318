"""Judges the process at every tick: sensors and interlocks."""

from __future__ import annotations

from fsw_control.contract import Command
from fsw_control.units import kw_from_w, rad_s_from_rpm
from fsw_control.validity import SensorGuard
from fsw_supervisor.events import Level
from fsw_supervisor.interlocks import Interlocks, Severity
from fsw_supervisor.machine import Machine
from fsw_supervisor.modes import Trigger
from fsw_supervisor.tick import NANOSECONDS, Tick

_LEVELS = {Severity.OK: Level.INFO, Severity.WARN: Level.WARN, Severity.TRIP: Level.ERROR}


def judge(
    tick: Tick,
    acting: Command | None,
    guard: SensorGuard,
    interlocks: Interlocks,
    machine: Machine,
    invalid_before: tuple[str, ...],
) -> tuple[str, ...]:
    """Judge the sensors of a tick and fire the interlocks that trip.

    Parameters
    ----------
    tick : Tick
        Its samples.
    acting : Command or None
        Force and speed that act, as far as known.
    guard, interlocks : SensorGuard, Interlocks
        The judges.
    machine : Machine
        For the log and the transition.
    invalid_before : tuple of str
        Sensors that were invalid in the tick before.

    Returns
    -------
    tuple of str
        Sensors that may not be used now.
    """
    measurement = guard.measure(tick.stamp_ns / NANOSECONDS, tick.samples)
    invalid = measurement.invalid_sensors()
    for name in invalid:
        if name not in invalid_before:
            machine.log(Level.WARN, "sensors", f"sensor {name} is invalid: {guard.reasons[name]}")
    for name in invalid_before:
        if name not in invalid:
            machine.log(Level.INFO, "sensors", f"sensor {name} is valid again")
    values = {
        "depth_mm": measurement.depth_mm,
        "torque_nm": measurement.torque_nm,
        "temperature_c": measurement.temperature_c,
    }
    if acting is not None:
        values["force_kn"] = acting.force_kn
        values["power_kw"] = kw_from_w(measurement.torque_nm * rad_s_from_rpm(acting.speed_rpm))
    for change in interlocks.update(values):
        machine.log(_LEVELS[change.level], "interlock", change.text())
        if change.level is Severity.TRIP:
            machine.fire(Trigger.INTERLOCK_TRIP, change.text(), "interlock")
    return invalid
