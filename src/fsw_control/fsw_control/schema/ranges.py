"""Ranges of numbers with their units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Range:
    """Closed interval with its unit; ``Annotated[float, RANGE]`` checks it in a model."""

    low: float
    high: float
    unit: str

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g} {self.unit}".rstrip()

    def complaint(self, value: float) -> str | None:
        """Why ``value`` is not allowed; None if it is."""
        if self.low <= value <= self.high:
            return None
        # a file may hold an int that exceeds every float
        shown = f"{value:g}" if isinstance(value, float) or abs(value) < 1e300 else "a huge number"
        return f"{shown} is outside {self}"

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import PydanticCustomError, core_schema  # only models need it

        def check(value: Any) -> Any:
            if isinstance(value, bool) or not isinstance(value, int | float):
                text = f"is {value!r:.60}, not a number ({self})"
                raise PydanticCustomError("not_a_number", "{text}", {"text": text})
            if complaint := self.complaint(value):
                raise PydanticCustomError("outside", "{text}", {"text": f"= {complaint}"})
            return value

        return core_schema.no_info_before_validator_function(check, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        document: dict[str, Any] = handler(schema) | {"minimum": self.low, "maximum": self.high}
        return document | ({"unit": self.unit} if self.unit else {})
