"""Inputs and outputs of the exported controllers: names, which say the units, and meanings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fsw_decentral import controller as decentral
from fsw_nmpc import library as nmpc

#: units by the ends of names
_UNITS = {
    "mm": "mm",
    "c": "degC",
    "nm": "N m",
    "kn": "kN",
    "rpm": "rpm",
    "kw": "kW",
    "s": "s",
}


@dataclass(frozen=True, slots=True)
class Signal:
    """A signal of an exported controller."""

    name: str  #: in CSV files, FMUs and function blocks
    text: str  #: what it is
    kind: str = "real"  #: ``real``, ``int`` or ``bool``; the latter two are an int in C
    member: str = ""  #: where it is in the C struct

    @property
    def unit(self) -> str:
        """Unit; empty: none."""
        return "" if self.is_int else _UNITS.get(self.name.rpartition("_")[2], "")

    @property
    def in_c(self) -> str:
        """Member designator in the C struct."""
        return self.member or self.name

    @property
    def is_int(self) -> bool:
        """Whether it is an int in C."""
        return self.kind != "real"


def _listed(values: Any, separator: str = ", ") -> str:
    """The values of an enumeration of the C header."""
    return separator.join(f"{code.value} {code.name.lower().replace('_', ' ')}" for code in values)


_SENSORS = (
    Signal("depth_mm", "shoulder depth as measured"),
    Signal("torque_nm", "motor torque of the spindle as measured"),
    Signal("temperature_c", "thermocouple in the tool as measured"),
)
_INPUTS = (
    Signal("applied_force_kn", "force set-point in force until now; NaN: unchanged"),
    Signal("applied_speed_rpm", "speed set-point in force until now; NaN: unchanged"),
    Signal("reference_depth_mm", "depth set-point; NaN: unchanged"),
    Signal("reference_temperature_c", "temperature set-point; NaN: unchanged"),
    Signal("dt_s", "time since the last tick, normally 0.1"),
)
_ACTING = "as reported by the drive; NaN: unknown"
_COMMAND = (
    Signal("force_kn", "proposed force set-point, within a move of the applied one"),
    Signal("speed_rpm", "proposed speed set-point, within a move of the applied one"),
    Signal("healthy", "whether the proposal may be applied", "bool"),
)

NMPC_INPUTS = (
    *_SENSORS,
    Signal("depth_fresh", "whether depth_mm is a good sample of this tick", "bool"),
    Signal("torque_fresh", "whether torque_nm is a good sample of this tick", "bool"),
    Signal("temperature_fresh", "whether temperature_c is a good sample of this tick", "bool"),
    Signal("acting_force_kn", f"actual force, {_ACTING}", member="force_kn"),
    Signal("acting_speed_rpm", f"actual speed, {_ACTING}", member="speed_rpm"),
    *_INPUTS,
    Signal("n_changes", "number of announced set-points, 0 to 8; the example reads one", "int"),
    Signal("change_at_s", "time until the next set-point is in force", member="change[0].at_s"),
    Signal("change_depth_mm", "its depth", member="change[0].depth_mm"),
    Signal("change_temperature_c", "its temperature", member="change[0].temperature_c"),
)
NMPC_OUTPUTS = (
    *_COMMAND,
    Signal("reason", _listed(nmpc.Reason), "int"),
    Signal("blind", f"sensors missing for too long: {_listed(nmpc.Missing, ' + ')}", "int"),
    Signal("solve_status", _listed(nmpc.SolveStatus), "int"),
    Signal("iterations", "iterations of the solver", "int"),
    Signal("estimated_depth_mm", "predicted reading of the depth sensor", member="depth_mm"),
    Signal(
        "estimated_temperature_c", "predicted reading of the thermocouple", member="temperature_c"
    ),
    Signal("estimated_torque_nm", "motor torque", member="torque_nm"),
    *(
        Signal(name, f"estimate: {text}", member=f"disturbance[{i}]")
        for i, name, text in (
            (0, "force_disturbance_kn", "disturbance force"),
            (1, "heat_disturbance_kw", "disturbance heat"),
            (2, "torque_scale", "factor on the process torque"),
            (3, "depth_offset_mm", "offset of the depth sensor"),
            (4, "temperature_offset_c", "offset of the thermocouple"),
            (7, "depth_gain", "factor on the gain of the depth over the force"),
        )
    ),
)

DECENTRAL_INPUTS = (
    *_SENSORS,
    Signal("depth_valid", "whether depth_mm may be used", "bool"),
    Signal("torque_valid", "whether torque_nm may be used", "bool"),
    Signal("temperature_valid", "whether temperature_c may be used", "bool"),
    *_INPUTS,
)
DECENTRAL_OUTPUTS = (
    *_COMMAND,
    Signal("reason", _listed(decentral.Fault), "int"),
    Signal("active_limits", _listed(decentral.Limit, " + "), "int"),
    Signal("filtered_depth_mm", "filtered depth", member="depth_mm"),
    Signal("filtered_temperature_c", "filtered temperature", member="temperature_c"),
    Signal("process_torque_nm", "measured torque less friction, filtered", member="torque_nm"),
)
