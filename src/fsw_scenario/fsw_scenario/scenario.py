"""A scenario, i.e. the events of a weld experiment, as validated data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import attrgetter
from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from fsw_control import weld
from fsw_control.contract import Reference
from fsw_control.ranges import COMMAND_FORCE_KN, COMMAND_SPEED_RPM
from fsw_control.schema.models import (
    InputError,
    Many,
    Model,
    Name,
    needs_one,
    problem,
    without_default,
)
from fsw_control.schema.ranges import Range
from fsw_control.weld import TICK_S
from fsw_plant import PlantConfig
from fsw_plant.config import flatten
from fsw_plant.config import json_schema as plant_json_schema
from fsw_plant.event_schema import DURATION_S, TIME_S
from fsw_plant.schedule import EventEntry
from fsw_plant.tool_path import Waypoint, check_order
from fsw_scenario.weld_programme import (
    ANGLE_DEG,
    Phase,
    SetPointEntry,
    joined,
    set_points,
    time_at,
    tool_path,
)

#: controller name of scenarios that command the inputs themselves
OPEN_LOOP = "none"
_EPSILON_S = 1e-9


def tick_of(at_s: float) -> int:
    """First tick whose stamp is at or after ``at_s``."""
    tick = round(at_s / TICK_S)
    return tick if tick * TICK_S >= at_s - _EPSILON_S else tick + 1


def start_reference(plant: Mapping[str, Any]) -> Reference:
    """Set-points before the first reference event: those of a plant's start."""
    return Reference(
        float(plant.get("start.depth_mm", weld.DEPTH_MM)),
        float(plant.get("start.temperature_c", weld.TEMPERATURE_C)),
    )


class Sine(Model):
    """Sine around the set-points, from the end of the ramp until the next `reference`."""

    depth_mm: Annotated[float, Range(-1.0, 1.0, "mm")] = 0.0
    """amplitude"""
    temperature_c: Annotated[float, Range(-50.0, 50.0, "degC")] = 0.0
    """amplitude"""
    period_s: Annotated[float, Range(2 * TICK_S, DURATION_S.high, "s")]


class ReferenceEntry(SetPointEntry):
    """New set-points; an omitted one keeps its value."""

    sine: Sine | None = None

    @model_validator(mode="after")
    def _check_any(self) -> Self:
        return needs_one(self, "depth_mm", "temperature_c", "sine")


class CommandEntry(Model):
    """New manipulated variables, only in open loop; an omitted one keeps its value."""

    force_kn: Annotated[float, COMMAND_FORCE_KN] | None = None
    speed_rpm: Annotated[float, COMMAND_SPEED_RPM] | None = None

    @model_validator(mode="after")
    def _check_any(self) -> Self:
        return needs_one(self, "force_kn", "speed_rpm")


class Event(EventEntry):
    """Time and exactly one of `disturbance`, `fault`, `reference`, `switch`, `command`."""

    at_s: Annotated[float, TIME_S] = Field(0.0, json_schema_extra=without_default)
    """time; the event takes effect at the first tick at or after it"""
    at_deg: Annotated[float, ANGLE_DEG] | None = None
    """instead of `at_s`, with `phases`: angle on the path"""
    reference: ReferenceEntry | None = None
    switch: Name | None = None
    """the controller to apply; not in open loop"""
    command: CommandEntry | None = None

    @model_validator(mode="after")
    def _check_time(self) -> Self:
        keys = self.model_fields_set & {"at_s", "at_deg"}
        if len(keys) != 1:
            raise ValueError("has at_s and at_deg; give one of them" if keys else "lacks at_s")
        return self


class _PlantParameters:
    """JSON Schema of ``plant``."""

    @staticmethod
    def __get_pydantic_json_schema__(_: Any, __: Any) -> dict[str, Any]:
        return plant_json_schema()


class Scenario(Model):
    """A weld experiment: ticks 1 (stamp 0.1 s) to ``n_ticks``.

    When read, it is completed: all events have ``at_s``, and include the set-points of phases;
    ``plant`` has dotted names.
    """

    name: Name
    description: str = ""
    duration_s: Annotated[float, DURATION_S] = Field(0.0, json_schema_extra=without_default)
    """of the experiment; with `phases` it is left out"""
    controller: Name = "decentral"
    """controller applied at the start; `none`: open loop"""
    plant: Annotated[dict[str, Any], _PlantParameters] = {}
    """parameters of the plant that differ from their defaults, see its reference page"""
    phases: Many[Phase] = ()
    """of a whole weld, instead of `reference` events"""
    path: Many[Waypoint] = ()
    """of the tool, for a plant with `process: canister`; with `phases` it follows from them"""
    events: Many[Event] = ()
    """in order of time"""
    figures: Many[Literal[4, 5, 6, 7, 8, 9]] = ()
    """figures of the paper that the scenario shows"""
    announced: bool = False
    """whether set-points are announced to the controllers in advance, on `/fsw/reference_plan`"""
    _text: str = ""

    @field_validator("plant")
    @classmethod
    def _check_plant(cls, values: dict[str, Any]) -> dict[str, Any]:
        try:
            PlantConfig.from_values(values)
        except InputError as error:
            raise ValueError(f"is wrong: {error}") from None
        return flatten(values)

    @property
    def on_canister(self) -> bool:
        """Whether the plant conducts heat in a canister."""
        return bool(self.plant.get("process") == "canister")

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if "phases" in self.model_fields_set:
            phases = joined(self.phases)
            whole_s = sum(phase.duration_s for phase in phases)
            duration_s = self.duration_s or round(whole_s, 1)
            if abs(duration_s - whole_s) > TICK_S:
                raise problem(
                    f"= {duration_s:g}, but the phases take {whole_s:.1f} s; leave it out",
                    "duration_s",
                )
        elif "duration_s" in self.model_fields_set:
            phases, duration_s = (), self.duration_s
            check_order(self.path)
        else:
            raise ValueError("lacks duration_s")
        if not self.on_canister and any(phase.until_c is not None for phase in phases):
            raise problem(
                "has until_c, which needs plant: {process: canister}; "
                "the paper's process starts warm",
                "phases",
            )
        own = [
            Event(at_s=at_s, reference=ReferenceEntry(**set_point.model_dump(exclude={"at_s"})))
            for at_s, set_point in set_points(phases, start_reference(self.plant))
        ]
        events = self._placed(phases)
        self._check(events, duration_s)
        events = sorted((*own, *events), key=attrgetter("at_s"))
        complete = {"duration_s": duration_s, "phases": phases, "events": tuple(events)}
        path = tool_path(phases) if phases else self.path
        if "path" in self.model_fields_set and path != self.path:
            raise problem("is not that of the phases; leave it out", "path")
        return self.model_copy(update=complete | {"path": path})

    def _placed(self, phases: Sequence[Phase]) -> list[Event]:
        """The events, those with an angle at the time when the tool first passes it."""
        events = list(self.events)
        for i, event in enumerate(events):
            if event.at_deg is not None:
                if not phases:
                    raise problem("needs phases; give at_s", "events", i, "at_deg")
                allowed = Range(phases[0].from_deg, phases[-1].to_deg, "deg, the end of the path")
                if complaint := allowed.complaint(event.at_deg):
                    raise problem(f"= {complaint}", "events", i, "at_deg")
                at_s = round(time_at(phases, event.at_deg), 1)
                events[i] = event.model_copy(update={"at_s": at_s, "at_deg": None})
        return events

    def _check(self, events: Sequence[Event], duration_s: float) -> None:
        latest, before_s = Range(0.0, duration_s, "s, the scenario's duration"), 0.0
        for i, event in enumerate(events):
            if complaint := latest.complaint(event.at_s):
                raise problem(f"= {complaint}", "events", i, "at_s")
            if event.at_s < before_s:
                raise problem(
                    "is earlier than the event before it; list events in order of time",
                    "events",
                    i,
                )
            if event.switch is not None and self.open_loop:
                raise problem(
                    f"switches the controller, but controller is {OPEN_LOOP}", "events", i
                )
            if event.command is not None and not self.open_loop:
                raise problem(f"has a command, which needs controller: {OPEN_LOOP}", "events", i)
            if self.phases and (event.reference or event.command):
                text = "has set-points or a command; with phases, give set_points in the phases"
                raise problem(text, "events", i)
            before_s = event.at_s

    @property
    def text(self) -> str:
        """The YAML it was read from, with all overrides applied."""
        return self._text

    @property
    def n_ticks(self) -> int:
        """Number of ticks."""
        return round(self.duration_s / TICK_S)

    @property
    def open_loop(self) -> bool:
        """Whether the events command the inputs instead of a controller."""
        return self.controller == OPEN_LOOP

    @property
    def controllers(self) -> tuple[str, ...]:
        """Names of the controllers that are ever selected, in order."""
        names = [] if self.open_loop else [self.controller]
        return tuple(
            dict.fromkeys(
                names + [event.switch for event in self.events if event.switch is not None]
            )
        )
