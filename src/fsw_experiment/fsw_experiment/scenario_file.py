"""Reads scenarios from YAML and checks every word of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import yaml

from fsw_control.parameters import ParameterError
from fsw_experiment import ranges
from fsw_experiment.ranges import Range
from fsw_experiment.scenario import (
    OPEN_LOOP,
    TICK_S,
    CommandEvent,
    DisturbanceEvent,
    Event,
    FaultEvent,
    ReferenceEvent,
    Scenario,
    ScenarioError,
    Sine,
    SwitchEvent,
)

EVENT_KINDS = ("reference", "disturbance", "fault", "switch", "command")
_SCENARIO_KEYS = ("name", "description", "duration_s", "controller", "plant", "events", "figures")


class _Loader(yaml.SafeLoader):
    """Safe loader that refuses a key given twice."""


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    seen: set[Any] = set()
    for key_node, _ in node.value:
        key = loader.construct_object(key_node, deep=True)
        if not isinstance(key, str | int | float | bool | None):
            raise yaml.constructor.ConstructorError(None, None, f"key {key!r} is not a name", key_node.start_mark)
        if key in seen:
            raise yaml.constructor.ConstructorError(None, None, f"key '{key}' is given twice", key_node.start_mark)
        seen.add(key)
    return yaml.SafeLoader.construct_mapping(loader, node, deep=True)


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


def shipped() -> list[str]:
    """Names of the scenarios that come with the package."""
    folder = resources.files("fsw_experiment").joinpath("scenarios")
    return sorted(entry.name.removesuffix(".yaml") for entry in folder.iterdir() if entry.name.endswith(".yaml"))


def load(source: str | Path, overrides: Sequence[str] = ()) -> Scenario:
    """Read a scenario.

    Parameters
    ----------
    source : str or Path
        Path of a YAML file, or the name of a shipped scenario.
    overrides : sequence of str
        ``key=value`` with dotted keys, e.g. ``plant.noise=false`` or ``controller=nmpc``; values are YAML.

    Raises
    ------
    ScenarioError
        If there is no such scenario or something in it is wrong.
    """
    path = Path(source)
    if str(source) in shipped() and not path.is_file():
        text = resources.files("fsw_experiment").joinpath("scenarios", f"{source}.yaml").read_text(encoding="utf-8")
        return parse(text, str(source), overrides)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ScenarioError(
            f"cannot read scenario {source}: {error.strerror}; give a YAML file or one of {', '.join(shipped())}"
        ) from None
    except UnicodeDecodeError:
        raise ScenarioError(f"cannot read scenario {source}: not a text file in UTF-8") from None
    return parse(text, str(source), overrides)


def parse(text: str, where: str = "scenario", overrides: Sequence[str] = ()) -> Scenario:
    """Read a scenario from YAML text; see :func:`load`."""
    content = _yaml(text, where)
    if not isinstance(content, dict):
        raise ScenarioError(f"{where}: a scenario is a mapping with {', '.join(_SCENARIO_KEYS)}; see the shipped ones")
    for override in overrides:
        _override(content, override)
    if overrides:
        text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
    at = _Place(where)
    at.keys(content, _SCENARIO_KEYS, required=("name", "duration_s"))
    duration_s = at.number(content, "duration_s", ranges.DURATION_S)
    controller = at.word(content, "controller", "decentral")
    events = tuple(
        _event(entry, at.inside(f"events[{i}]"), duration_s, controller == OPEN_LOOP)
        for i, entry in enumerate(at.list(content, "events"))
    )
    late = [f"events[{i}]" for i in range(1, len(events)) if events[i].at_s < events[i - 1].at_s]
    if late:
        raise at.inside(late[0]).error("is earlier than the event before it; list events in order of time")
    figures = tuple(at.list(content, "figures"))
    for figure in figures:
        if isinstance(figure, bool) or not isinstance(figure, int) or not 4 <= figure <= 9:
            raise at.inside("figures").error(f"{figure!r} is none of the paper's figures 4 to 9")
    return Scenario(
        name=at.word(content, "name"),
        description=str(content.get("description", "")),
        duration_s=duration_s,
        controller=controller,
        plant=_checked_plant(content.get("plant") or {}, at.inside("plant")),
        events=events,
        figures=figures,
        text=text,
    )


def _yaml(text: str, where: str) -> Any:
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise ScenarioError(f"{where}{line}: not valid YAML: {error.problem or 'broken'}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ScenarioError(f"{where}: not valid YAML: {' '.join(str(error).split())}") from None


def _override(content: dict[str, Any], override: str) -> None:
    key, equals, value = override.partition("=")
    if not equals or not key:
        raise ScenarioError(f"override {override!r}: give key=value, e.g. plant.noise=false")
    *parents, last = key.split(".")
    inside: Any = content
    for parent in parents:
        inside = inside.setdefault(parent, {})
        if not isinstance(inside, dict):
            raise ScenarioError(f"override {override!r}: {parent} is not a mapping")
    inside[last] = _yaml(value, f"override {override!r}")


class _Place:
    """Where in which file; makes the error messages."""

    def __init__(self, where: str, path: str = "") -> None:
        self.where, self.path = where, path

    def inside(self, name: str) -> _Place:
        return _Place(self.where, f"{self.path}.{name}" if self.path else name)

    def error(self, problem: str) -> ScenarioError:
        return ScenarioError(f"{self.where}: {self.path or 'scenario'} {problem}")

    def keys(self, entry: Mapping[Any, Any], known: Sequence[str], required: Sequence[str] = ()) -> None:
        unknown = [str(key) for key in entry if key not in known]
        if unknown:
            raise self.error(f"has unknown key {', '.join(unknown)}; known: {', '.join(known)}")
        missing = [key for key in required if key not in entry]
        if missing:
            raise self.error(f"lacks {', '.join(missing)}")

    def mapping(self, entry: Any) -> dict[str, Any]:
        if not isinstance(entry, dict):
            raise self.error(f"is {entry!r}, not a mapping")
        return entry

    def list(self, entry: Mapping[str, Any], key: str) -> list[Any]:
        value = entry.get(key)
        if value is None:
            return []
        if not isinstance(value, list):
            raise self.inside(key).error(f"is {value!r}, not a list")
        return value

    def number(self, entry: Mapping[str, Any], key: str, allowed: Range, default: float | None = None) -> float:
        value = entry.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.inside(key).error(f"is {value!r}, not a number ({allowed})")
        complaint = allowed.complaint(float(value))
        if complaint:
            raise self.inside(key).error(f"= {complaint}")
        return float(value)

    def optional(self, entry: Mapping[str, Any], key: str, allowed: Range) -> float | None:
        return self.number(entry, key, allowed) if key in entry else None

    def word(self, entry: Mapping[str, Any], key: str, default: str | None = None) -> str:
        value = entry.get(key, default)
        if not isinstance(value, str) or not value.replace("_", "a").isalnum() or not value.isascii():
            raise self.inside(key).error(f"is {value!r}, not a name (letters, digits, _)")
        return value

    def choice(self, entry: Mapping[str, Any], key: str, allowed: Sequence[str], default: str | None = None) -> str:
        value = entry.get(key, default)
        if value not in allowed:
            raise self.inside(key).error(f"is {value!r}; one of {', '.join(allowed)}")
        return str(value)


def _plant(entry: Any, at: _Place) -> dict[str, Any]:
    """Flatten the plant's nested setup to dotted parameter names."""
    flat: dict[str, Any] = {}
    for key, value in at.mapping(entry).items():
        if isinstance(value, dict):
            flat.update({f"{key}.{name}": inner for name, inner in _plant(value, at.inside(str(key))).items()})
        else:
            flat[str(key)] = value
    return flat


def _checked_plant(entry: Any, at: _Place) -> dict[str, Any]:
    flat = _plant(entry, at)
    if flat:
        from fsw_plant.config import PlantConfig  # heavy to import, and most scenarios change nothing in the plant

        try:
            PlantConfig.from_values(flat)
        except ParameterError as error:
            raise at.error(f"is wrong: {error}") from None
    return flat


def _event(entry: Any, at: _Place, duration_s: float, open_loop: bool) -> Event:
    entry = at.mapping(entry)
    at.keys(entry, ("at_s", *EVENT_KINDS), required=("at_s",))
    kinds = [kind for kind in EVENT_KINDS if kind in entry]
    if len(kinds) != 1:
        raise at.error(f"needs exactly one of {', '.join(EVENT_KINDS)}, has {', '.join(kinds) or 'none'}")
    at_s = at.number(entry, "at_s", Range(0.0, duration_s, "s, the scenario's duration"))
    kind = kinds[0]
    if kind == "switch":
        if open_loop:
            raise at.error(f"switches the controller, but the scenario's controller is {OPEN_LOOP}")
        return SwitchEvent(at_s, at.word(entry, "switch"))
    if kind == "command" and not open_loop:
        raise at.error(f"has a command, which needs controller: {OPEN_LOOP}")
    place = at.inside(kind)
    detail = place.mapping(entry[kind])
    readers = {"reference": _reference, "disturbance": _disturbance, "fault": _fault, "command": _command}
    return readers[kind](detail, place, at_s)


def _reference(entry: dict[str, Any], at: _Place, at_s: float) -> Event:
    at.keys(entry, ("depth_mm", "temperature_c", "over_s", "sine"))
    if not set(entry) & {"depth_mm", "temperature_c", "sine"}:
        raise at.error("needs depth_mm, temperature_c or sine")
    return ReferenceEvent(
        at_s,
        at.optional(entry, "depth_mm", ranges.REFERENCE_DEPTH_MM),
        at.optional(entry, "temperature_c", ranges.REFERENCE_TEMPERATURE_C),
        at.number(entry, "over_s", Range(0.0, ranges.DURATION_S.high, "s"), 0.0),
        _sine(at.inside("sine").mapping(entry["sine"]), at.inside("sine")) if "sine" in entry else None,
    )


def _sine(entry: dict[str, Any], at: _Place) -> Sine:
    at.keys(entry, ("depth_mm", "temperature_c", "period_s"), required=("period_s",))
    return Sine(
        at.number(entry, "depth_mm", Range(-1.0, 1.0, "mm"), 0.0),
        at.number(entry, "temperature_c", Range(-50.0, 50.0, "degC"), 0.0),
        at.number(entry, "period_s", Range(2 * TICK_S, ranges.DURATION_S.high, "s")),
    )


def _disturbance(entry: dict[str, Any], at: _Place, at_s: float) -> Event:
    channel = at.choice(entry, "channel", tuple(ranges.DISTURBANCE_AMPLITUDE))
    shape = at.choice(entry, "shape", ranges.DISTURBANCE_SHAPES)
    amplitude_key, amplitude_range = ranges.DISTURBANCE_AMPLITUDE[channel]
    needed = {"ramp": ("duration_s",), "pulse": ("duration_s",), "sine": ("period_s",)}.get(shape, ())
    allowed = (*needed, "duration_s") if shape == "sine" else needed
    known = ("channel", "shape", amplitude_key, *allowed)
    at.keys(entry, known, required=() if shape == "none" else (amplitude_key, *needed))
    lasting = Range(TICK_S, ranges.DURATION_S.high, "s")
    return DisturbanceEvent(
        at_s,
        channel,
        shape,
        at.number(entry, amplitude_key, amplitude_range, 0.0),
        at.number(entry, "duration_s", lasting) if "duration_s" in entry else 0.0,
        at.number(entry, "period_s", lasting) if "period_s" in entry else 0.0,
    )


def _fault(entry: dict[str, Any], at: _Place, at_s: float) -> Event:
    sensor = at.choice(entry, "sensor", tuple(ranges.FAULT_MAGNITUDE))
    kind = at.choice(entry, "kind", ranges.FAULT_KINDS)
    unit, allowed = ranges.FAULT_MAGNITUDE[sensor]
    if kind == "delay":
        unit, allowed = "s", ranges.FAULT_DELAY_S
    key = f"magnitude_{unit}"
    has_magnitude = kind in ("spike", "bias", "drift", "delay")
    known = ("sensor", "kind", "duration_s", *((key,) if has_magnitude else ()))
    at.keys(entry, known, required=(key,) if has_magnitude else ())
    return FaultEvent(
        at_s,
        sensor,
        kind,
        at.number(entry, key, allowed) if has_magnitude else 0.0,
        at.number(entry, "duration_s", Range(0.0, ranges.DURATION_S.high, "s"), 0.0),
    )


def _command(entry: dict[str, Any], at: _Place, at_s: float) -> Event:
    at.keys(entry, ("force_kn", "speed_rpm"))
    if not entry:
        raise at.error("needs force_kn or speed_rpm")
    return CommandEvent(
        at_s,
        at.optional(entry, "force_kn", ranges.COMMAND_FORCE_KN),
        at.optional(entry, "speed_rpm", ranges.COMMAND_SPEED_RPM),
    )
