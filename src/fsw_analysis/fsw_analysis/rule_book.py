"""Rules of a weld as data: limits, permitted set-points, and the tolerated time outside them.

A procedure has a rule book; a weld without one is judged by the defaults, ``rule_book.yaml``.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    Field,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from fsw_control.cause import Cause
from fsw_control.ranges import REFERENCE_DEPTH_MM, REFERENCE_TEMPERATURE_C
from fsw_control.schema.models import Many, Model, Name, content_of, problem, read_text, validate
from fsw_control.schema.ranges import Range

_DEFAULT = Path(__file__).with_name("rule_book.yaml")
#: which swaps are permitted, by whether those on request are
SWAPS = {True: "swaps on request only", False: "no swap"}
#: what a limit may be on; an error is the measured value minus the programme's set-point, power is
#: torque times speed at the spindle
Variable = Literal[
    "depth_mm",
    "temperature_c",
    "torque_nm",
    "force_kn",
    "speed_rpm",
    "power_kw",
    "traverse_mm_per_min",
    "depth_error_mm",
    "temperature_error_c",
]
Text = Annotated[str, Field(min_length=1), AfterValidator(lambda text: " ".join(text.split()))]


class Sourced(Model):
    """Sources of the figures."""

    source: Text
    """where the figures come from"""


class SetPoint(Sourced):
    """A set-point at the start of the weld, and the range that every set-point must be in."""

    value: float
    min: float
    max: float

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if not self.min <= self.value <= self.max:
            raise ValueError(
                f"is impossible: min {self.min:g}, value {self.value:g}, "
                f"max {self.max:g} must ascend"
            )
        return self


class SetPoints(Model):
    """Set-points and their permitted ranges."""

    depth_mm: SetPoint
    temperature_c: SetPoint

    @model_validator(mode="after")
    def _check_ranges(self) -> Self:
        for name, allowed in (
            ("depth_mm", REFERENCE_DEPTH_MM),
            ("temperature_c", REFERENCE_TEMPERATURE_C),
        ):
            for key in ("min", "max"):
                if complaint := allowed.complaint(getattr(getattr(self, name), key)):
                    raise problem(f"= {complaint}, which the controllers accept", name, key)
        return self


class Bounds(Model):
    """Bounds of a variable."""

    variable: str
    min: float | None = None
    max: float | None = None
    phases: Many[Name] = ()
    """in which it holds; left out: in all"""

    @property
    def words(self) -> str:
        """E.g. ``temperature_c 790 to 910 in joint_line``."""
        return f"{self.variable} {self.span}".rstrip()

    @property
    def span(self) -> str:
        """The words without the variable."""
        low, high = self.min, self.max
        if low is not None and high is not None:
            span = f"{low:g} to {high:g}"
        elif low is not None:
            span = f"at least {low:g}"
        else:
            span = "" if high is None else f"at most {high:g}"
        return f"{span} in {', '.join(self.phases)}".lstrip() if self.phases else span


class Limit(Sourced, Bounds):
    """Limits on a variable, in all phases or in some."""

    variable: Variable

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if self.min is None and self.max is None:
            raise ValueError("needs min or max")
        if self.min is not None and self.max is not None and self.min >= self.max:
            raise ValueError(f"is impossible: min {self.min:g} is not below max {self.max:g}")
        return self

    def holds(self, value: float) -> bool:
        """Whether a value is inside."""
        return (self.min is None or self.min <= value) and (self.max is None or value <= self.max)


Kind = Literal["essential", "quality", "set_point"]


class Check(Bounds):
    """Limits of every sample of a phase."""

    kind: Kind


class Acceptance(Sourced):
    """Thresholds between accept, review and reject."""

    tolerated_s: Annotated[float, Range(0.0, 10.0, "s")]
    """outside an essential limit for longer: reject, for less: review; outside a quality limit for
    longer: review"""
    tolerated_share: Annotated[float, Range(0.0, 1.0, "")] = 0.01
    """outside a quality limit for a larger share of the time that it holds: review, however short
    each time (chosen)"""
    tolerated_total_s: Annotated[float, Range(0.0, 3600.0, "s")] | None = None
    """outside a quality limit for longer, all times together: review; left out: not judged"""
    tolerated_mm: Annotated[float, Range(0.0, 1e5, "mm")] | None = None
    """outside a quality limit over more of the weld, all places together: review; left out: not
    judged"""
    tolerated_hold_s: Annotated[float, Range(0.0, 3600.0, "s")] = 10.0
    """programme held for longer, all times together: review; the tool then heats one place
    (chosen)"""
    tolerated_unusable_s: Annotated[float, Range(0.0, 3600.0, "s")] = 10.0
    """samples of a sensor missing, frozen, out of range or too fast for longer, all times
    together: reject (chosen)"""
    swaps_allowed: bool = False
    """whether a swap to another permitted controller on request leaves the weld acceptable"""

    @model_serializer(mode="wrap")
    def _without_later_keys(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out later keys with their defaults, so that the hash of older procedures stays."""
        content: dict[str, Any] = handler(self)
        for key in ("tolerated_total_s", "tolerated_unusable_s"):
            if content.get(key) == type(self).model_fields[key].default:
                content.pop(key, None)
        return content

    def permits_swap(self, cause: Cause) -> bool:
        """Whether a swap leaves the weld acceptable, by its cause."""
        return cause.at_start or (self.swaps_allowed and cause.on_request)

    @property
    def swap_words(self) -> str:
        """Which swaps are permitted."""
        return SWAPS[self.swaps_allowed]


class RuleBook(Model):
    """Rules for every weld, independent of the workpiece."""

    set_points: SetPoints
    essential: Annotated[Many[Limit], Field(min_length=1)]
    """essential variables: a weld with a sample outside is never accepted"""
    quality: Many[Limit] = ()
    """narrower limits: outside them the weld is for review"""
    acceptance: Acceptance

    @model_validator(mode="after")
    def _check_set_points_inside_limits(self) -> Self:
        """At its set-points a weld has no error, and is inside all essential limits."""
        points = dict(self.set_points)
        for key in ("essential", "quality"):
            for row, limit in enumerate(getattr(self, key)):
                if "_error_" in limit.variable and not limit.holds(0.0):
                    raise problem(
                        "is impossible: a weld at its set-points, error 0, is outside", key, row
                    )
        for row, limit in enumerate(self.essential):
            point = points.get(limit.variable)
            if point is not None and not (limit.holds(point.min) and limit.holds(point.max)):
                text = (
                    f"is impossible: set-points from {point.min:g} to {point.max:g} are "
                    "permitted outside it"
                )
                raise problem(text, "essential", row)
        return self

    def checks(self) -> Iterator[Check]:
        """All limits and the permitted set-points, in that order."""
        for kind, limit in self.limits():
            yield Check(kind=kind, **limit.model_dump(exclude={"source"}))
        for name, point in self.set_points:
            yield Check(
                kind="set_point", variable=f"set_point_{name}", min=point.min, max=point.max
            )

    def limits(self) -> Iterator[tuple[Literal["essential", "quality"], Limit]]:
        """All limits with their kind, the essential ones first."""
        for limit in self.essential:
            yield "essential", limit
        for limit in self.quality:
            yield "quality", limit


@cache
def default() -> RuleBook:
    """The rule book for welds without a procedure."""
    return validate(
        RuleBook, content_of(read_text(_DEFAULT, "rule book"), str(_DEFAULT)), str(_DEFAULT)
    )
