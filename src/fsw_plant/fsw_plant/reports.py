"""What the plant reports of itself, as data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

from fsw_plant.emulator import PlantEmulator
from fsw_plant.watchdog import WatchdogState


class Level(IntEnum):
    """Levels of ``diagnostic_msgs/DiagnosticStatus``."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True, slots=True)
class Report:
    """One line of diagnostics."""

    part: str
    level: Level
    text: str
    values: Mapping[str, object]


def clock(mode: str, running: bool, jumps: int, complaints: int) -> Report:
    """How time passes.

    Parameters
    ----------
    mode : str
        In words.
    running : bool
        Whether the first tick has come.
    jumps : int
        Jumps of the stamps in real time.
    complaints : int
        How often the present tick was sent again in lockstep.
    """
    values = {"mode": mode, "jumps of the stamps": jumps, "tick sent again": complaints}
    if not running:
        return Report("clock", Level.WARN, "first tick waits for subscribers", values)
    if complaints:
        return Report("clock", Level.ERROR, "no command answers the last tick", values)
    return Report("clock", Level.OK, mode, values)


def process(plant: PlantEmulator) -> Report:
    """Whether the process runs."""
    truth = plant.truth()
    values = {
        "tick": truth.tick,
        "depth [mm]": f"{truth.depth_mm:.4f}",
        "temperature [degC]": f"{truth.temperature_c:.2f}",
        "axial force [kN]": f"{truth.force_kn:.3f}",
        "spindle speed [rpm]": f"{truth.speed_rpm:.2f}",
    }
    if plant.stopped:
        return Report("process", Level.ERROR, f"{plant.stopped}; call fsw/plant/reset", values)
    return Report("process", Level.OK, "welding", values)


def watchdog(plant: PlantEmulator) -> Report:
    """What the watchdog does."""
    dog = plant.watchdog
    values = {"state": dog.state.name, "age of the last valid command [s]": f"{dog.age_s:.1f}"}
    if dog.state is WatchdogState.OK:
        return Report("watchdog", Level.OK, "commands come", values)
    away = f"no valid command for {dog.age_s:.1f} s"
    if dog.state is WatchdogState.SAFE:
        safe = f"force goes to {dog.config.safe_force_kn:g} kN, spindle keeps turning"
        return Report("watchdog", Level.ERROR, f"{away}: {safe}", values)
    text = f"{away}: last command held" if dog.armed else "no command yet: start held"
    return Report("watchdog", Level.WARN, text, values)


def commands(plant: PlantEmulator, new_refusals: int, publishers: list[str]) -> Report:
    """What was refused.

    Parameters
    ----------
    plant : PlantEmulator
        The plant.
    new_refusals : int
        Refused since the last report.
    publishers : list of str
        Nodes that publish commands.
    """
    gate = plant.gate
    values: dict[str, object] = {"refused": gate.total(), "last refusal": gate.last_refusal}
    values.update({f"refused: {reason}": count for reason, count in gate.refused.items()})
    values["publishers"] = ", ".join(publishers)
    if len(publishers) > 1:
        return Report("commands", Level.ERROR, f"{len(publishers)} publishers: {', '.join(publishers)}", values)
    if new_refusals:
        return Report("commands", Level.WARN, f"{new_refusals} refused; last: {gate.last_refusal}", values)
    return Report("commands", Level.OK, "obeyed", values)


def sensors(plant: PlantEmulator) -> Report:
    """Active faults and disturbances, which were set on purpose."""
    faults, disturbances = plant.faults.names(), plant.disturbances.names(plant.time_s)
    values = {"faults": ", ".join(faults), "disturbances": ", ".join(disturbances)}
    active = [*faults, *disturbances]
    if active:
        return Report("sensors", Level.WARN, f"emulated: {', '.join(active)}", values)
    return Report("sensors", Level.OK, "no faults, no disturbances", values)
