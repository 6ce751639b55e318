"""A scenario: what happens in a weld experiment, as validated data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from fsw_control import weld
from fsw_control.contract import Reference
from fsw_control.ranges import COMMAND_FORCE_KN, COMMAND_SPEED_RPM, REFERENCE_DEPTH_MM, REFERENCE_TEMPERATURE_C, Range
from fsw_control.schema import InputError, Model, Name, needs_one
from fsw_control.weld import TICK_S
from fsw_plant.event_schema import DURATION_S, TIME_S
from fsw_plant.schedule import EventEntry
from fsw_scenario.weld_programme import Phase

#: Name of the controller in scenarios that drive the manipulated variables themselves.
OPEN_LOOP = "none"
#: the error of a wrong scenario
ScenarioError = InputError
#: on the path of a whole weld
ANGLE_DEG = Range(0.0, 720.0, "deg")
_EPSILON_S = 1e-9


def tick_of(at_s: float) -> int:
    """First tick whose stamp is at or after ``at_s``."""
    tick = round(at_s / TICK_S)
    return tick if tick * TICK_S >= at_s - _EPSILON_S else tick + 1


def start_reference(plant: Mapping[str, Any]) -> Reference:
    """Set-points in force before the first reference event: those that a plant with such parameters starts from."""
    return Reference(
        float(plant.get("start.depth_mm", weld.DEPTH_MM)), float(plant.get("start.temperature_c", weld.TEMPERATURE_C))
    )


class Sine(Model):
    """About the set-points, from the end of the ramp until the next `reference`."""

    depth_mm: Annotated[float, Range(-1.0, 1.0, "mm")] = 0.0
    """amplitude"""
    temperature_c: Annotated[float, Range(-50.0, 50.0, "degC")] = 0.0
    """amplitude"""
    period_s: Annotated[float, Range(2 * TICK_S, DURATION_S.high, "s")]


class SetPointEntry(Model):
    """New set-points; one left out stays."""

    depth_mm: Annotated[float, REFERENCE_DEPTH_MM] | None = None
    temperature_c: Annotated[float, REFERENCE_TEMPERATURE_C] | None = None
    over_s: Annotated[float, TIME_S] = 0.0
    """length of a ramp to them; 0: a step"""

    @model_validator(mode="after")
    def _check_any(self) -> Self:
        return needs_one(self, "depth_mm", "temperature_c")


class ReferenceEntry(SetPointEntry):
    """New set-points; one left out stays."""

    sine: Sine | None = None

    @model_validator(mode="after")
    def _check_any(self) -> Self:
        return needs_one(self, "depth_mm", "temperature_c", "sine")


class CommandEntry(Model):
    """New manipulated variables, only in open loop; one left out stays."""

    force_kn: Annotated[float, COMMAND_FORCE_KN] | None = None
    speed_rpm: Annotated[float, COMMAND_SPEED_RPM] | None = None

    @model_validator(mode="after")
    def _check_any(self) -> Self:
        return needs_one(self, "force_kn", "speed_rpm")


def _without_default(json_schema: dict[str, Any]) -> None:
    del json_schema["default"]


class Event(EventEntry):
    """Has its time and exactly one of `disturbance`, `fault`, `reference`, `switch`, `command`."""

    at_s: Annotated[float, TIME_S] = Field(0.0, json_schema_extra=_without_default)
    """time; the event takes effect at the first tick that is not before"""
    at_deg: Annotated[float, ANGLE_DEG] | None = None
    """instead of `at_s`, with `phases`: where on the path"""
    reference: ReferenceEntry | None = None
    switch: Name | None = None
    """the controller to apply; not in open loop"""
    command: CommandEntry | None = None

    @model_validator(mode="after")
    def _check_time(self) -> Self:
        given = self.model_fields_set & {"at_s", "at_deg"}
        if len(given) != 1:
            raise ValueError("has at_s and at_deg; give one of them" if given else "lacks at_s")
        return self


@dataclass(frozen=True, slots=True)
class Scenario:
    """A weld experiment.

    Attributes
    ----------
    name, description : str
    duration_s : float
        Length of the experiment: ticks 1 (stamp 0.1 s) to ``n_ticks``.
    controller : str
        Selected at the start; ``OPEN_LOOP`` when the events drive the manipulated variables.
    plant : dict of str to value
        The plant's parameters that differ from their defaults, by dotted name.
    events : tuple of Event
        In order of time, with ``at_s``; those of ``phases`` are among them.
    figures : tuple of int
        The paper's figures that it shows.
    announced : bool
        Whether controllers know the set-points beforehand.
    phases : tuple of Phase
        Of a whole weld.
    text : str
        The YAML it was read from, with all overrides applied.
    """

    name: str
    duration_s: float
    description: str = ""
    controller: str = "decentral"
    plant: dict[str, Any] = field(default_factory=dict)
    events: tuple[Event, ...] = ()
    figures: tuple[int, ...] = ()
    announced: bool = False
    phases: tuple[Phase, ...] = ()
    text: str = ""

    @property
    def n_ticks(self) -> int:
        """Number of ticks."""
        return round(self.duration_s / TICK_S)

    @property
    def open_loop(self) -> bool:
        """Whether the events drive the manipulated variables instead of a controller."""
        return self.controller == OPEN_LOOP

    @property
    def controllers(self) -> tuple[str, ...]:
        """Names of the controllers that are selected at some time, the first first."""
        names = [] if self.open_loop else [self.controller]
        return tuple(dict.fromkeys(names + [event.switch for event in self.events if event.switch is not None]))
