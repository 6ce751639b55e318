"""Figures of merit of a running weld, from sensor readings."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from fsw_control.contract import Reference


@dataclass(slots=True)
class RunningKpi:
    """Integral [mm s, degC s] and maximum [mm, degC] of the absolute errors to the set-points."""

    depth_iae: float = 0.0
    temperature_iae: float = 0.0
    depth_max_error: float = 0.0
    temperature_max_error: float = 0.0

    def add(
        self, lasted_s: float, wanted: Reference, depth_mm: float, temperature_c: float
    ) -> None:
        """Take the readings at the end of an interval; values that are not finite are skipped."""
        for name, error in (
            ("depth", abs(depth_mm - wanted.depth_mm)),
            ("temperature", abs(temperature_c - wanted.temperature_c)),
        ):
            if isfinite(error):
                setattr(self, f"{name}_iae", getattr(self, f"{name}_iae") + lasted_s * error)
                setattr(self, f"{name}_max_error", max(getattr(self, f"{name}_max_error"), error))
