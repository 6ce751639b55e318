"""Reads and validates scenarios in YAML."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from fsw_control.schema import models
from fsw_control.schema.models import InputError, read_text, shipped_names, validate
from fsw_scenario.scenario import Scenario

_SHIPPED = Path(__file__).parent / "scenarios"
#: a step of a path such as ``events[2].disturbance.amplitude_mm``: a key or a list index
_STEP = re.compile(r"\.?([^.\[\]]+)|\[(\d+)\]")


def shipped() -> list[str]:
    """Names of the shipped scenarios."""
    return shipped_names(_SHIPPED)


def load(source: str | Path | Mapping[str, Any], overrides: Sequence[str] = ()) -> Scenario:
    """Read a scenario.

    Parameters
    ----------
    source : str, Path or mapping
        Path of a YAML file, the name of a shipped scenario, or the content of such a file.
    overrides : sequence of str
        ``key=value`` with dotted keys, e.g. ``plant.noise=false`` or
        ``events[2].disturbance.amplitude_mm=0.2``; values are YAML.

    Raises
    ------
    fsw_control.schema.models.InputError
        If there is no such scenario or it is invalid.
    """
    if isinstance(source, Mapping):
        return parse(_dump(dict(source)), "scenario", overrides)
    return parse(text_of(source), str(source), overrides)


def text_of(source: str | Path) -> str:
    """Return the text of a scenario's file without validation; see :func:`load`."""
    return read_text(source, "scenario", _SHIPPED)


def parse(text: str, where: str = "scenario", overrides: Sequence[str] = ()) -> Scenario:
    """Read a scenario from YAML text; see :func:`load`."""
    content = models.content_of(text, where)
    for override in overrides:
        place = f"override {override!r}"
        key, equals, value = override.partition("=")
        if not equals or not key:
            raise InputError(f"{place}: give key=value, e.g. plant.noise=false")
        put(content, key, models.content_of(value, place), place)
    if overrides:
        text = _dump(content)
    return read(content, where, text)


def with_controller(scenario: Scenario, name: str) -> Scenario:
    """The scenario with another controller; it stays if it chooses several itself, or none."""
    if scenario.open_loop or len(scenario.controllers) > 1:
        return scenario
    return parse(scenario.text, scenario.name, [f"controller={name}"])


def content_of(text: str, where: str = "scenario") -> dict[str, Any]:
    """Return the mapping in a YAML text, without further validation. Errors as in :func:`load`."""
    content = models.content_of(text, where)
    if not isinstance(content, dict):
        keys = ", ".join(Scenario.model_fields)
        raise InputError(f"{where}: a scenario is a mapping with {keys}; see the shipped ones")
    return content


def read(content: dict[str, Any], where: str = "scenario", text: str | None = None) -> Scenario:
    """Read a scenario from the content of a file; ``text`` is its text, by default JSON (YAML).

    Errors as in :func:`load`.
    """
    scenario = validate(Scenario, content, where)
    if scenario.phases:
        # The plant reads the same text, but understands times only, neither phases nor angles.
        timed = [event.at_s for event in scenario.events if event.reference is None]
        events = [
            {key: value for key, value in entry.items() if key != "at_deg"} | {"at_s": at_s}
            for entry, at_s in zip(content.get("events") or (), timed, strict=True)
        ]
        content = content | {"duration_s": scenario.duration_s, "events": events}
        if scenario.on_canister:
            content["path"] = [point.model_dump() for point in scenario.path]
        text = None if text is None else _dump(content)
    scenario._text = json.dumps(content) if text is None else text
    return scenario


def _dump(content: dict[str, Any]) -> str:
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True)


def put(content: dict[str, Any], path: str, value: Any, where: str = "override") -> None:
    """Set a value in the content of a scenario file; the path is as in overrides of :func:`load`.

    Raises
    ------
    fsw_control.schema.models.InputError
        If the path does not exist.
    """
    steps: list[Any] = [key or int(number) for key, number in _STEP.findall(path)]
    if _STEP.sub("", path) or not steps or path.startswith("."):
        raise InputError(f"{where}: {path} is not a path such as plant.seed or events[2].at_s")
    inside: Any = content
    for i, step in enumerate(steps):
        by_number, is_list = isinstance(step, int), isinstance(inside, list)
        fits = is_list and step < len(inside) if by_number else isinstance(inside, dict)
        if not fits:
            have = f"{len(inside)} entries from 0" if is_list else "none"
            lacking = (
                f"no [{step}]: it has {have}" if by_number else "no named values; give it whole"
            )
            raise InputError(f"{where}: {steps[i - 1]} of {path} has {lacking}")
        if i == len(steps) - 1:
            inside[step] = value
        else:
            inside = inside[step] if isinstance(step, int) else inside.setdefault(step, {})
