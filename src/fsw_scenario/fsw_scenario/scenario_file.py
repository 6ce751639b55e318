"""Reads scenarios from YAML and checks every entry."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from functools import cached_property
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self

import yaml
from pydantic import field_validator, model_validator

from fsw_control import schema
from fsw_control.parameters import ParameterError
from fsw_control.ranges import Range
from fsw_control.schema import InputError, Many, Model, Name, problem, read_text, shipped_names, validate
from fsw_control.weld import TICK_S
from fsw_plant import PlantConfig
from fsw_plant.config import flatten
from fsw_plant.config import json_schema as plant_json_schema
from fsw_plant.event_schema import DURATION_S
from fsw_scenario.scenario import OPEN_LOOP, Event, ReferenceEntry, Scenario, start_reference
from fsw_scenario.weld_programme import PHASES, Phase, time_at
from fsw_scenario.weld_programme_file import PhaseEntry, phases_of, set_points_of

_SHIPPED = Path(__file__).parent / "scenarios"
#: a step of a path such as ``events[2].disturbance.amplitude_mm``: a key or the number of a list's entry
_STEP = re.compile(r"\.?([^.\[\]]+)|\[(\d+)\]")


class _Timed(NamedTuple):
    """What the phases of a scenario amount to: events without angles, and the set-points of the phases as events."""

    duration_s: float
    events: tuple[Event, ...]
    phases: tuple[Phase, ...] = ()
    set_points: tuple[Event, ...] = ()


class _PlantParameters:
    """What the JSON Schema says of ``plant``."""

    @staticmethod
    def __get_pydantic_json_schema__(_: Any, __: Any) -> dict[str, Any]:
        return plant_json_schema()


class ScenarioFile(Model):
    """A scenario file."""

    name: Name
    description: str = ""
    duration_s: Annotated[float, DURATION_S] | None = None
    """of the experiment; with `phases` it is left out"""
    controller: Name = "decentral"
    """the one that is applied at the start; `none`: open loop"""
    plant: Annotated[dict[str, Any], _PlantParameters] = {}
    """parameters of the plant that differ from their defaults, see `plant.yaml`"""
    phases: Many[PhaseEntry] = ()
    """of a whole weld, in place of `reference` events"""
    events: Many[Event] = ()
    """in order of time"""
    figures: Many[Literal[4, 5, 6, 7, 8, 9]] = ()
    """figures of the paper that the scenario shows"""
    announced: bool = False
    """whether controllers know the set-points beforehand, by `/fsw/reference_plan`"""

    @field_validator("plant")
    @classmethod
    def _check_plant(cls, values: dict[str, Any]) -> dict[str, Any]:
        try:
            PlantConfig.from_values(values)
        except ParameterError as error:
            raise ValueError(f"is wrong: {error}") from None
        return values

    @model_validator(mode="after")
    def _check(self) -> Self:
        timed = self.timed
        latest = Range(0.0, timed.duration_s, "s, the scenario's duration")
        before_s = 0.0
        for i, event in enumerate(timed.events):
            if complaint := latest.complaint(event.at_s):
                raise problem(f"= {complaint}", "events", i, "at_s")
            if event.at_s < before_s:
                raise problem("is earlier than the event before it; list events in order of time", "events", i)
            if event.switch is not None and self.controller == OPEN_LOOP:
                raise problem(f"switches the controller, but controller is {OPEN_LOOP}", "events", i)
            if event.command is not None and self.controller != OPEN_LOOP:
                raise problem(f"has a command, which needs controller: {OPEN_LOOP}", "events", i)
            if self.phases and (event.reference or event.command):
                text = "has set-points or a command; with phases, give set_points in the phases"
                raise problem(text, "events", i)
            before_s = event.at_s
        return self

    @cached_property
    def timed(self) -> _Timed:
        """What the phases amount to; the error of a validator when they are wrong."""
        if "phases" not in self.model_fields_set:
            if self.duration_s is None:
                raise ValueError("lacks duration_s")
            self._place_events(())
            return _Timed(self.duration_s, self.events)
        if not self.phases:
            raise problem(f"is empty; some of {', '.join(PHASES)}", "phases")
        phases = phases_of(self.phases)
        whole_s = sum(phase.duration_s for phase in phases)
        if self.duration_s is not None and abs(self.duration_s - whole_s) > TICK_S:
            raise problem(f"= {self.duration_s:g}, but the phases take {whole_s:.1f} s; leave it out", "duration_s")
        set_points = tuple(
            Event(at_s=at_s, reference=ReferenceEntry(**one.model_dump(exclude={"at_s"})))
            for at_s, one in set_points_of(self.phases, phases, start_reference(flatten(self.plant)))
        )
        return _Timed(self.duration_s or round(whole_s, 1), self._place_events(phases), phases, set_points)

    def _place_events(self, phases: Sequence[Phase]) -> tuple[Event, ...]:
        """The events, those with an angle at the time at which the tool first passes there."""
        events = list(self.events)
        for i, event in enumerate(events):
            if event.at_deg is None:
                continue
            if not phases:
                raise problem("needs phases; give at_s", "events", i, "at_deg")
            allowed = Range(phases[0].from_deg, phases[-1].to_deg, "deg, the end of the path")
            if complaint := allowed.complaint(event.at_deg):
                raise problem(f"= {complaint}", "events", i, "at_deg")
            at_s = round(time_at(phases, event.at_deg), 1)
            events[i] = event.model_copy(update={"at_s": at_s, "at_deg": None})
        return tuple(events)


def shipped() -> list[str]:
    """Names of the scenarios that come with the package."""
    return shipped_names(_SHIPPED)


def load(source: str | Path, overrides: Sequence[str] = ()) -> Scenario:
    """Read a scenario.

    Parameters
    ----------
    source : str or Path
        Path of a YAML file, or the name of a shipped scenario.
    overrides : sequence of str
        ``key=value`` with dotted keys, e.g. ``plant.noise=false`` or ``events[2].disturbance.amplitude_mm=0.2``;
        values are YAML.

    Raises
    ------
    fsw_control.schema.InputError
        If there is no such scenario or something in it is wrong.
    """
    return parse(text_of(source), str(source), overrides)


def text_of(source: str | Path) -> str:
    """Text of a scenario's file, which is not checked; see :func:`load`."""
    return read_text(source, "scenario", _SHIPPED)


def parse(text: str, where: str = "scenario", overrides: Sequence[str] = ()) -> Scenario:
    """Read a scenario from YAML text; see :func:`load`."""
    content = content_of(text, where)
    for override in overrides:
        _override(content, override)
    if overrides:
        text = _dump(content)
    return read(content, where, text)


def content_of(text: str, where: str = "scenario") -> dict[str, Any]:
    """What YAML text holds, if that is a mapping; nothing in it is checked. Errors as :func:`load`."""
    content = schema.content_of(text, where)
    if not isinstance(content, dict):
        keys = ", ".join(ScenarioFile.model_fields)
        raise InputError(f"{where}: a scenario is a mapping with {keys}; see the shipped ones")
    return content


def read(content: dict[str, Any], where: str = "scenario", text: str | None = None) -> Scenario:
    """Read a scenario from the content of a file; ``text`` is the file's, JSON (which is YAML) by default.

    Errors as :func:`load`.
    """
    file = validate(ScenarioFile, content, where)
    timed = file.timed
    if timed.phases:
        # The plant reads the same text: it knows times, but neither phases nor angles.
        events = [
            {key: value for key, value in entry.items() if key != "at_deg"} | {"at_s": event.at_s}
            for entry, event in zip(content.get("events") or (), timed.events, strict=True)
        ]
        content = content | {"duration_s": timed.duration_s, "events": events}
        text = None if text is None else _dump(content)
    return Scenario(
        name=file.name,
        description=file.description,
        duration_s=timed.duration_s,
        controller=file.controller,
        plant=flatten(file.plant),
        events=tuple(sorted((*timed.set_points, *timed.events), key=attrgetter("at_s"))),
        figures=file.figures,
        announced=file.announced,
        phases=timed.phases,
        text=json.dumps(content) if text is None else text,
    )


def _dump(content: dict[str, Any]) -> str:
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True)


def _override(content: dict[str, Any], override: str) -> None:
    key, equals, value = override.partition("=")
    if not equals or not key:
        raise InputError(f"override {override!r}: give key=value, e.g. plant.noise=false")
    put(content, key, schema.content_of(value, f"override {override!r}"), f"override {override!r}")


def put(content: dict[str, Any], path: str, value: Any, where: str = "override") -> None:
    """Set a value in the content of a scenario file; the path is as in the overrides of :func:`load`.

    Raises
    ------
    fsw_control.schema.InputError
        If the path leads nowhere.
    """
    found = list(_STEP.finditer(path))
    if "".join(step[0] for step in found) != path or path.startswith("."):
        raise InputError(f"{where}: {path} is no path such as plant.seed or events[2].at_s")
    steps: list[Any] = [step[1] or int(step[2]) for step in found]
    inside: Any = content
    for i, step in enumerate(steps):
        if isinstance(step, int):
            if not isinstance(inside, list) or step >= len(inside):
                have = f"{len(inside)} entries, counted from 0" if isinstance(inside, list) else "no list"
                raise InputError(f"{where}: there is no [{step}] in {path}: {steps[i - 1]} has {have}")
        elif not isinstance(inside, dict):
            raise InputError(
                f"{where}: {steps[i - 1]} has no named values; give {steps[i - 1]} as a whole, in YAML, "
                "or change the scenario file"
            )
        if i == len(steps) - 1:
            inside[step] = value
        else:
            inside = inside[step] if isinstance(step, int) else inside.setdefault(step, {})
