"""Inputs and outputs of the exported controllers: name, unit and meaning of every signal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fsw_decentral import controller as decentral
from fsw_nmpc import library as nmpc


@dataclass(frozen=True, slots=True)
class Signal:
    """A signal of an exported controller."""

    name: str  #: in CSV files, FMUs and function blocks
    kind: str  #: ``real``, ``int`` or ``bool``; the latter two are an int in C
    unit: str  #: empty: none
    text: str  #: what it is
    member: str = ""  #: where it is in the C struct

    @property
    def in_c(self) -> str:
        """Member designator in the C struct."""
        return self.member or self.name

    @property
    def is_int(self) -> bool:
        """Whether it is an int in C."""
        return self.kind != "real"


_SENSORS = (
    Signal("depth_mm", "real", "mm", "shoulder depth as measured"),
    Signal("torque_nm", "real", "N m", "motor torque of the spindle as measured"),
    Signal("temperature_c", "real", "degC", "thermocouple in the tool as measured"),
)
_INPUTS = (
    Signal("applied_force_kn", "real", "kN", "force set-point in force until now; NaN: unchanged"),
    Signal(
        "applied_speed_rpm", "real", "rpm", "speed set-point in force until now; NaN: unchanged"
    ),
    Signal("reference_depth_mm", "real", "mm", "depth set-point; NaN: unchanged"),
    Signal("reference_temperature_c", "real", "degC", "temperature set-point; NaN: unchanged"),
    Signal("dt_s", "real", "s", "time since the last tick, normally 0.1"),
)


def _listed(values: Any, separator: str = ", ") -> str:
    """The values of an enumeration of the C header."""
    return separator.join(f"{code.value} {code.name.lower().replace('_', ' ')}" for code in values)


_COMMAND = (
    Signal("force_kn", "real", "kN", "proposed force set-point, within a move of the applied one"),
    Signal(
        "speed_rpm", "real", "rpm", "proposed speed set-point, within a move of the applied one"
    ),
    Signal("healthy", "bool", "", "whether the proposal may be applied"),
)

NMPC_INPUTS = (
    *_SENSORS,
    Signal("depth_fresh", "bool", "", "whether depth_mm is a good sample of this tick"),
    Signal("torque_fresh", "bool", "", "whether torque_nm is a good sample of this tick"),
    Signal("temperature_fresh", "bool", "", "whether temperature_c is a good sample of this tick"),
    Signal(
        "acting_force_kn",
        "real",
        "kN",
        "actual force, as reported by the drive; NaN: unknown",
        "force_kn",
    ),
    Signal(
        "acting_speed_rpm",
        "real",
        "rpm",
        "actual speed, as reported by the drive; NaN: unknown",
        "speed_rpm",
    ),
    *_INPUTS,
    Signal(
        "n_changes", "int", "", "number of announced set-points, 0 to 8; the example reads one"
    ),
    Signal(
        "change_at_s", "real", "s", "time until the next set-point is in force", "change[0].at_s"
    ),
    Signal("change_depth_mm", "real", "mm", "its depth", "change[0].depth_mm"),
    Signal("change_temperature_c", "real", "degC", "its temperature", "change[0].temperature_c"),
)
NMPC_OUTPUTS = (
    *_COMMAND,
    Signal("reason", "int", "", _listed(nmpc.Reason)),
    Signal("blind", "int", "", f"sensors missing for too long: {_listed(nmpc.Missing, ' + ')}"),
    Signal("solve_status", "int", "", _listed(nmpc.SolveStatus)),
    Signal("iterations", "int", "", "iterations of the solver"),
    Signal(
        "estimated_depth_mm", "real", "mm", "predicted reading of the depth sensor", "depth_mm"
    ),
    Signal(
        "estimated_temperature_c",
        "real",
        "degC",
        "predicted reading of the thermocouple",
        "temperature_c",
    ),
    Signal("estimated_torque_nm", "real", "N m", "motor torque", "torque_nm"),
    Signal("force_disturbance_kn", "real", "kN", "estimate: disturbance force", "disturbance[0]"),
    Signal("heat_disturbance_kw", "real", "kW", "estimate: disturbance heat", "disturbance[1]"),
    Signal("torque_scale", "real", "", "estimate: factor on the process torque", "disturbance[2]"),
    Signal(
        "depth_offset_mm", "real", "mm", "estimate: offset of the depth sensor", "disturbance[3]"
    ),
    Signal(
        "temperature_offset_c",
        "real",
        "degC",
        "estimate: offset of the thermocouple",
        "disturbance[4]",
    ),
    Signal(
        "depth_gain",
        "real",
        "",
        "estimate: factor on the gain of the depth over the force",
        "disturbance[7]",
    ),
)

DECENTRAL_INPUTS = (
    *_SENSORS,
    Signal("depth_valid", "bool", "", "whether depth_mm may be used"),
    Signal("torque_valid", "bool", "", "whether torque_nm may be used"),
    Signal("temperature_valid", "bool", "", "whether temperature_c may be used"),
    *_INPUTS,
)
DECENTRAL_OUTPUTS = (
    *_COMMAND,
    Signal("reason", "int", "", _listed(decentral.Fault)),
    Signal("active_limits", "int", "", _listed(decentral.Limit, " + ")),
    Signal("filtered_depth_mm", "real", "mm", "filtered depth", "depth_mm"),
    Signal("filtered_temperature_c", "real", "degC", "filtered temperature", "temperature_c"),
    Signal(
        "process_torque_nm", "real", "N m", "measured torque less friction, filtered", "torque_nm"
    ),
)
