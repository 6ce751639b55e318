"""Reports of the plant: its truth, and diagnostics with one entry per part."""

from __future__ import annotations

from fsw_control import units
from fsw_control.coded import Fact, Worded
from fsw_control.command_writers_ros import CommandWriters
from fsw_control.messages_ros import header
from fsw_control.reports_ros import ERROR, OK, WARN, Report, commands
from fsw_msgs.msg import PlantState
from fsw_plant.emulator import PlantEmulator, Truth, WatchdogState

#: by the end of a field's name in `Truth`; the field of the message lacks that end
_UNITS = {"mm": "mm", "c": "degC", "nm": "N m", "kw": "kW", "kn": "kN", "rpm": "rpm"}
#: of the message, where it has another name
_FIELDS = {"force": "axial_force", "speed": "spindle_speed"}


class Note(Worded):
    """Diagnostics of the plant's parts."""

    NO_SUBSCRIBERS = "first tick waits for subscribers"
    UNANSWERED = "no command answers the last tick"
    TICKING = "{mode}"
    STOPPED = "{why}; call fsw/plant/reset"
    WELDING = "welding"
    COMMANDED = "commands come"
    HELD = "no valid command for {age_s:.1f} s: last command held"
    SAFE = (
        "no valid command for {age_s:.1f} s: force goes to {force_kn:g} kN, spindle keeps turning"
    )
    NO_COMMAND_YET = "no command yet: start held"
    EMULATED = "emulated: {events}"
    UNDISTURBED = "no faults, no disturbances"


def truth_message(truth: Truth) -> PlantState:
    """The truth in SI."""
    message = PlantState(
        header=header(truth.stamp_ns),
        watchdog=int(truth.watchdog),
        refused_commands=truth.refused_commands,
        active_faults=list(truth.active_faults),
    )
    for name, value in truth._asdict().items():
        field, _, end = name.rpartition("_")
        if end in _UNITS:
            setattr(message, _FIELDS.get(field, field), units.to_si(value, _UNITS[end]))
    return message


def parts(plant: PlantEmulator, writers: CommandWriters, refused: int) -> list[Report]:
    """All parts but the clock; ``refused`` commands are new."""
    return [
        process(plant),
        watchdog(plant),
        commands(plant.gate, refused, writers.names, writers.unauthorised()),
        sensors(plant),
    ]


def clock(mode: str, running: bool, jumps: int, resent: int) -> Report:
    """Timing: jumps of the stamps in real time, resent ticks in lockstep."""
    values = {"mode": mode, "jumps of the stamps": jumps, "tick repeated": resent}
    if not running:
        return Report("clock", WARN, Fact.of(Note.NO_SUBSCRIBERS), values)
    if resent:
        return Report("clock", ERROR, Fact.of(Note.UNANSWERED), values)
    return Report("clock", OK, Fact.of(Note.TICKING, mode=mode), values)


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
        return Report("process", ERROR, Fact.of(Note.STOPPED, why=plant.stopped), values)
    return Report("process", OK, Fact.of(Note.WELDING), values)


def watchdog(plant: PlantEmulator) -> Report:
    """State of the watchdog."""
    dog = plant.watchdog
    values = {"state": dog.state.name, "age of the last valid command [s]": f"{dog.age_s:.1f}"}
    if dog.state is WatchdogState.OK:
        return Report("watchdog", OK, Fact.of(Note.COMMANDED), values)
    if dog.state is WatchdogState.SAFE:
        force_kn = dog.config["watchdog.safe_force_kn"]
        safe = Fact.of(Note.SAFE, age_s=dog.age_s, force_kn=force_kn)
        return Report("watchdog", ERROR, safe, values)
    held = Fact.of(Note.HELD, age_s=dog.age_s) if dog.armed else Fact.of(Note.NO_COMMAND_YET)
    return Report("watchdog", WARN, held, values)


def sensors(plant: PlantEmulator) -> Report:
    """Active faults and disturbances."""
    faults = list(map(str, plant.faults.values()))
    disturbances = [
        str(item) for item in plant.disturbances.values() if not item.over(plant.time_s)
    ]
    values = {"faults": ", ".join(faults), "disturbances": ", ".join(disturbances)}
    if faults or disturbances:
        events = Fact.of(Note.EMULATED, events=(*faults, *disturbances))
        return Report("sensors", WARN, events, values)
    return Report("sensors", OK, Fact.of(Note.UNDISTURBED), values)
