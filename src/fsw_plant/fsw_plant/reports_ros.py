"""Diagnostics of the plant, one entry per part."""

from __future__ import annotations

from fsw_control.reports_ros import ERROR, OK, WARN, Report, commands
from fsw_plant.emulator import PlantEmulator
from fsw_plant.watchdog import WatchdogState

__all__ = ["clock", "commands", "process", "sensors", "watchdog"]


def clock(mode: str, running: bool, jumps: int, resent: int) -> Report:
    """Timing: jumps of the stamps in real time, resent ticks in lockstep."""
    values = {"mode": mode, "jumps of the stamps": jumps, "tick repeated": resent}
    if not running:
        return Report("clock", WARN, "first tick waits for subscribers", values)
    if resent:
        return Report("clock", ERROR, "no command answers the last tick", values)
    return Report("clock", OK, mode, values)


def process(plant: PlantEmulator) -> Report:
    """Whether the process runs."""
    truth = plant.truth()
    values = {
        "tick": plant.tick,
        "depth [mm]": f"{truth.depth_mm:.4f}",
        "temperature [degC]": f"{truth.temperature_c:.2f}",
        "axial force [kN]": f"{truth.force_kn:.3f}",
        "spindle speed [rpm]": f"{truth.speed_rpm:.2f}",
    }
    if plant.stopped:
        return Report("process", ERROR, f"{plant.stopped}; call fsw/plant/reset", values)
    return Report("process", OK, "welding", values)


def watchdog(plant: PlantEmulator) -> Report:
    """State of the watchdog."""
    dog = plant.watchdog
    values = {"state": dog.state.name, "age of the last valid command [s]": f"{dog.age_s:.1f}"}
    if dog.state is WatchdogState.OK:
        return Report("watchdog", OK, "commands come", values)
    missing = f"no valid command for {dog.age_s:.1f} s"
    if dog.state is WatchdogState.SAFE:
        safe = f"force goes to {dog.config['watchdog.safe_force_kn']:g} kN, spindle keeps turning"
        return Report("watchdog", ERROR, f"{missing}: {safe}", values)
    text = f"{missing}: last command held" if dog.armed else "no command yet: start held"
    return Report("watchdog", WARN, text, values)


def sensors(plant: PlantEmulator) -> Report:
    """Active faults and disturbances."""
    faults = list(map(str, plant.faults.values()))
    disturbances = [
        str(item) for item in plant.disturbances.values() if not item.over(plant.time_s)
    ]
    values = {"faults": ", ".join(faults), "disturbances": ", ".join(disturbances)}
    if faults or disturbances:
        return Report("sensors", WARN, f"emulated: {', '.join(faults + disturbances)}", values)
    return Report("sensors", OK, "no faults, no disturbances", values)
