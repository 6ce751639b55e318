"""Allowed ranges of set-points and of commands by hand, for all input from people or files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fsw_control import weld


@dataclass(frozen=True, slots=True)
class Range:
    """Closed interval with its unit; in ``Annotated[float, RANGE]`` of a model it is checked and in the JSON Schema."""

    low: float
    high: float
    unit: str

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g} {self.unit}".rstrip()

    def complaint(self, value: float) -> str | None:
        """Why ``value`` is not allowed, or None when it is."""
        if self.low <= value <= self.high:
            return None
        # a file may hold an int that no float can
        shown = f"{value:g}" if isinstance(value, float) or abs(value) < 1e300 else "a huge number"
        return f"{shown} is outside {self}"

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import PydanticCustomError, core_schema  # only models need it

        def check(value: Any) -> Any:
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise PydanticCustomError("problem", "{text}", {"text": f"is {value!r:.60}, not a number ({self})"})
            if complaint := self.complaint(value):
                raise PydanticCustomError("problem", "{text}", {"text": f"= {complaint}"})
            return value

        return core_schema.no_info_before_validator_function(check, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        found: dict[str, Any] = handler(schema) | {"minimum": self.low, "maximum": self.high}
        return found | ({"unit": self.unit} if self.unit else {})


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
