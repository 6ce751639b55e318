"""Reads scenarios from YAML and checks every entry."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import yaml

from fsw_control.parameters import ParameterError
from fsw_control.weld import TICK_S
from fsw_plant import PlantConfig
from fsw_plant.config import flatten
from fsw_plant.event_schema import Place
from fsw_plant.schedule import event_head, read_event
from fsw_scenario import ranges
from fsw_scenario.ranges import Range
from fsw_scenario.scenario import (
    OPEN_LOOP,
    CommandEvent,
    Event,
    ReferenceEvent,
    Scenario,
    ScenarioError,
    Sine,
    SwitchEvent,
)
from fsw_scenario.weld_programme_file import place_events, read_phases

_SHIPPED = Path(__file__).parent / "scenarios"
#: figures of the paper that a scenario can show
_FIGURES = range(4, 10)
#: keys of a scenario file
KEYS = ("name", "description", "duration_s", "controller", "plant", "events", "figures", "announced", "phases")
#: a step of a path such as ``events[2].disturbance.amplitude_mm``: a key or the number of a list's entry
_STEP = re.compile(r"\.?([^.\[\]]+)|\[(\d+)\]")


def shipped() -> list[str]:
    """Names of the scenarios that come with the package."""
    return sorted(path.stem for path in _SHIPPED.glob("*.yaml"))


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
    ScenarioError
        If there is no such scenario or something in it is wrong.
    """
    return parse(text_of(source), str(source), overrides)


def text_of(source: str | Path) -> str:
    """Text of a scenario's file, which is not checked; see :func:`load`."""
    file = Path(source)
    if str(source) in shipped() and not file.is_file():
        file = _SHIPPED / f"{source}.yaml"
    try:
        return file.read_text(encoding="utf-8")
    except OSError as error:
        raise ScenarioError(
            f"cannot read scenario {source}: {error.strerror}; give a YAML file or one of {', '.join(shipped())}"
        ) from None
    except UnicodeDecodeError:
        raise ScenarioError(f"cannot read scenario {source}: not a text file in UTF-8") from None


def parse(text: str, where: str = "scenario", overrides: Sequence[str] = ()) -> Scenario:
    """Read a scenario from YAML text; see :func:`load`."""
    content = content_of(text, where)
    for override in overrides:
        _override(content, override)
    if overrides:
        text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
    return read(content, where, text)


def content_of(text: str, where: str = "scenario") -> dict[str, Any]:
    """What YAML text holds, if that is a mapping; nothing in it is checked. Errors as :func:`load`."""
    content = Place(where, failure=ScenarioError).yaml(text)
    if not isinstance(content, dict):
        raise ScenarioError(f"{where}: a scenario is a mapping with {', '.join(KEYS)}; see the shipped ones")
    return content


def read(content: dict[str, Any], where: str = "scenario", text: str | None = None) -> Scenario:
    """Read a scenario from the content of a file; ``text`` is the file's, JSON (which is YAML) by default.

    Errors as :func:`load`.
    """
    at = Place(where, failure=ScenarioError)
    plant = _plant(content.get("plant") or {}, at.inside("plant"))
    phases, set_points = read_phases(at, content, plant) if "phases" in content else ((), ())
    if phases:
        # The plant reads the same text: times it knows, phases and angles it does not.
        place_events(at, content, phases)
        content.setdefault("duration_s", round(sum(phase.duration_s for phase in phases), 1))
        text = None if text is None else yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
    at.keys(content, KEYS, required=("name", "duration_s"))
    duration_s = at.number(content, "duration_s", ranges.DURATION_S)
    if phases and abs(duration_s - (whole_s := sum(phase.duration_s for phase in phases))) > TICK_S:
        raise at.inside("duration_s").error(f"= {duration_s:g}, but the phases take {whole_s:.1f} s; leave it out")
    controller = at.word(content, "controller", "decentral")
    latest = Range(0.0, duration_s, "s, the scenario's duration")
    events = tuple(
        _event(entry, at.inside(f"events[{i}]"), latest, controller == OPEN_LOOP)
        for i, entry in enumerate(at.list(content, "events"))
    )
    late = [f"events[{i}]" for i in range(1, len(events)) if events[i].at_s < events[i - 1].at_s]
    if late:
        raise at.inside(late[0]).error("is earlier than the event before it; list events in order of time")
    if phases and any(isinstance(event, ReferenceEvent | CommandEvent) for event in events):
        raise at.inside("events").error("has set-points or commands; with phases, give set_points in the phases")
    events = tuple(sorted((*set_points, *events), key=attrgetter("at_s")))
    figures = tuple(at.list(content, "figures"))
    for figure in figures:
        if isinstance(figure, bool) or not isinstance(figure, int) or figure not in _FIGURES:
            raise at.inside("figures").error(f"{figure!r} is none of the paper's figures 4 to 9")
    announced = content.get("announced", False)
    if not isinstance(announced, bool):
        raise at.inside("announced").error(f"is {announced!r}: must be true or false")
    return Scenario(
        name=at.word(content, "name"),
        description=str(content.get("description", "")),
        duration_s=duration_s,
        controller=controller,
        plant=plant,
        events=events,
        figures=figures,
        announced=announced,
        phases=phases,
        text=json.dumps(content) if text is None else text,
    )


def _override(content: dict[str, Any], override: str) -> None:
    key, equals, value = override.partition("=")
    if not equals or not key:
        raise ScenarioError(f"override {override!r}: give key=value, e.g. plant.noise=false")
    put(content, key, Place(f"override {override!r}", failure=ScenarioError).yaml(value), f"override {override!r}")


def put(content: dict[str, Any], path: str, value: Any, where: str = "override") -> None:
    """Set a value in the content of a scenario file; the path is as in the overrides of :func:`load`.

    Raises
    ------
    ScenarioError
        If the path leads nowhere.
    """
    found = list(_STEP.finditer(path))
    if "".join(step[0] for step in found) != path or path.startswith("."):
        raise ScenarioError(f"{where}: {path} is no path such as plant.seed or events[2].at_s")
    steps: list[Any] = [step[1] or int(step[2]) for step in found]
    inside: Any = content
    for i, step in enumerate(steps):
        if isinstance(step, int):
            if not isinstance(inside, list) or step >= len(inside):
                have = f"{len(inside)} entries, counted from 0" if isinstance(inside, list) else "no list"
                raise ScenarioError(f"{where}: there is no [{step}] in {path}: {steps[i - 1]} has {have}")
        elif not isinstance(inside, dict):
            raise ScenarioError(
                f"{where}: {steps[i - 1]} has no named values; give {steps[i - 1]} as a whole, in YAML, "
                "or change the scenario file"
            )
        if i == len(steps) - 1:
            inside[step] = value
        else:
            inside = inside[step] if isinstance(step, int) else inside.setdefault(step, {})


def _plant(entry: Any, at: Place) -> dict[str, Any]:
    """The plant's parameters by dotted name, checked."""
    flat = flatten(at.mapping(entry))
    try:
        PlantConfig.from_values(flat)
    except ParameterError as error:
        raise at.error(f"is wrong: {error}") from None
    return flat


def _event(entry: Any, at: Place, latest: Range, open_loop: bool) -> Event:
    event = read_event(entry, at, latest)
    if event is not None:
        return event
    at_s, kind = event_head(entry, at, latest)
    if kind == "switch":
        if open_loop:
            raise at.error(f"switches the controller, but the scenario's controller is {OPEN_LOOP}")
        return SwitchEvent(at_s, at.word(entry, "switch"))
    if kind == "command" and not open_loop:
        raise at.error(f"has a command, which needs controller: {OPEN_LOOP}")
    place = at.inside(kind)
    read = _command if kind == "command" else _reference
    return read(place.mapping(entry[kind]), place, at_s)


def _reference(entry: dict[str, Any], at: Place, at_s: float) -> Event:
    at.keys(entry, ("depth_mm", "temperature_c", "over_s", "sine"))
    if not set(entry) & {"depth_mm", "temperature_c", "sine"}:
        raise at.error("needs depth_mm, temperature_c or sine")
    depth_mm = at.optional(entry, "depth_mm", ranges.REFERENCE_DEPTH_MM)
    temperature_c = at.optional(entry, "temperature_c", ranges.REFERENCE_TEMPERATURE_C)
    over_s = at.number(entry, "over_s", Range(0.0, ranges.DURATION_S.high, "s"), 0.0)
    sine = _sine(entry["sine"], at.inside("sine")) if "sine" in entry else None
    return ReferenceEvent(at_s, depth_mm, temperature_c, over_s, sine)


def _sine(entry: Any, at: Place) -> Sine:
    at.keys(at.mapping(entry), ("depth_mm", "temperature_c", "period_s"), required=("period_s",))
    depth_mm = at.number(entry, "depth_mm", ranges.SINE_DEPTH_MM, 0.0)
    temperature_c = at.number(entry, "temperature_c", ranges.SINE_TEMPERATURE_C, 0.0)
    return Sine(depth_mm, temperature_c, at.number(entry, "period_s", Range(2 * TICK_S, ranges.DURATION_S.high, "s")))


def _command(entry: dict[str, Any], at: Place, at_s: float) -> Event:
    at.keys(entry, ("force_kn", "speed_rpm"))
    if not entry:
        raise at.error("needs force_kn or speed_rpm")
    force_kn = at.optional(entry, "force_kn", ranges.COMMAND_FORCE_KN)
    return CommandEvent(at_s, force_kn, at.optional(entry, "speed_rpm", ranges.COMMAND_SPEED_RPM))
