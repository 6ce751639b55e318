"""Allowed ranges of set-points and of commands by hand, for all input from people or files."""

from __future__ import annotations

from fsw_control import weld
from fsw_schema.ranges import Range

#: set-points, chosen about the paper's operating point
REFERENCE_DEPTH_MM = Range(1.5, 4.0, "mm")
REFERENCE_TEMPERATURE_C = Range(750.0, 950.0, "degC")
#: how fast a ramp of the set-points may be, chosen
WELD_RATE_DEPTH_MM_PER_S, WELD_RATE_TEMPERATURE_C_PER_S = 0.02, 1.0
#: commands by hand, as far as the drives go
COMMAND_FORCE_KN = Range(weld.FORCE_MIN_KN, weld.FORCE_MAX_KN, "kN")
COMMAND_SPEED_RPM = Range(weld.SPEED_MIN_RPM, weld.SPEED_MAX_RPM, "rpm")


def set_point_problem(depth_mm: float, temperature_c: float) -> str:
    """Why set-points are not allowed; empty when they are."""
    named = (("depth", depth_mm, REFERENCE_DEPTH_MM), ("temperature", temperature_c, REFERENCE_TEMPERATURE_C))
    # rounded as by the conversion to the wire
    return "; ".join(f"{name}: {words}" for name, one, allowed in named if (words := allowed.complaint(round(one, 9))))
