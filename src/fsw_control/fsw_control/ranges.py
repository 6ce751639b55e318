"""Allowed ranges of set-points and of commands by hand, for everyone who takes them from a person or a file."""

from dataclasses import dataclass

from fsw_control import weld


@dataclass(frozen=True, slots=True)
class Range:
    """Closed interval with its unit."""

    low: float
    high: float
    unit: str

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g} {self.unit}".rstrip()

    def complaint(self, value: float) -> str | None:
        """Why ``value`` is not allowed, or None when it is."""
        return None if self.low <= value <= self.high else f"{value:g} is outside {self}"


#: set-points, chosen about the paper's operating point
REFERENCE_DEPTH_MM = Range(1.5, 4.0, "mm")
REFERENCE_TEMPERATURE_C = Range(750.0, 950.0, "degC")
#: how fast a ramp of the set-points may be, chosen
WELD_RATE_DEPTH_MM_PER_S, WELD_RATE_TEMPERATURE_C_PER_S = 0.02, 1.0
#: commands by hand, as far as the drives go
COMMAND_FORCE_KN = Range(weld.FORCE_MIN_KN, weld.FORCE_MAX_KN, "kN")
COMMAND_SPEED_RPM = Range(weld.SPEED_MIN_RPM, weld.SPEED_MAX_RPM, "rpm")
