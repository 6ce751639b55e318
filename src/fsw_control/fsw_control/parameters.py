"""Parameters as data: one YAML per node, from which they are declared, validated and documented.

The file maps each parameter name to a description of it::

    deadline:
      type: double            # double, int, bool, string, string_array, double_array
      default_value: 0.03     # or $NAME, a constant of fsw_control.weld
      description: "Wait for the tick's other sensors"
      unit: "s"               # optional
      range: [0.001, 1.0]     # optional, numbers and arrays of numbers
      options: [a, b]         # optional, strings and arrays of strings
      read_only: false        # optional
      negative: "default"     # optional: what a negative value stands for

A name with ``$`` is a template for each sensor of ``fsw_control.sensors``: in it and in its entry
``$noise`` stands for what :meth:`~fsw_control.sensors.Sensor.template` gives; where a row has None
there, the sensor lacks the parameter. An entry without ``type`` is a group of templates.
``$include: package/file`` inserts another file.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cache
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from fsw_control import weld
from fsw_control.sensors import SENSORS
from fsw_schema.errors import InputError
from fsw_schema.files import read_regular
from fsw_schema.yaml_text import content_of

#: end of the name of a parameter with the hash of what the file holds that another one names
CONTENT_SHA256 = "_sha256"
TYPES = ("double", "int", "bool", "string", "string_array", "double_array")
#: where parameters are described: package and file, or a path; None: there are none
Source = tuple[str, str] | str | Path | None
_KEYS = {
    "type",
    "default_value",
    "description",
    "unit",
    "range",
    "options",
    "read_only",
    "negative",
}
INCLUDE = "$include"
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*(\.[A-Za-z0-9_]+)*")


@dataclass(frozen=True, slots=True)
class ParameterSpec:
    """One parameter: its name on the node (dots group, e.g. ``depth.gain``) and its entry of the file.

    ``range`` bounds a number, or each entry of an array; bounds included. ``options`` empty: any
    string is accepted. ``read_only``: can be set at start only.
    """

    name: str
    type: str
    default: Any
    description: str
    unit: str = ""
    range: tuple[float, float] | None = None
    options: tuple[str, ...] = ()
    read_only: bool = False
    negative: str = ""

    @property
    def text(self) -> str:
        """Its description, with what a negative value stands for."""
        return (
            f"{self.description}; negative: {self.negative}" if self.negative else self.description
        )

    def check(self, value: Any) -> Any:
        """Return ``value`` in the parameter's type.

        Raises
        ------
        InputError
            When the type, the range or the options do not fit, or a number is not finite.
        """
        kind = self.type.removesuffix("_array")
        if kind == self.type:
            return self._check_entry(value, kind)
        if isinstance(value, str | bytes) or not isinstance(value, Iterable):
            raise InputError(f"{self.name}: {value!r} is not a list ({self.type})")
        return [self._check_entry(entry, kind) for entry in value]

    def _check_entry(self, value: Any, kind: str) -> Any:
        def require(met: bool, text: str) -> None:
            if not met:
                raise InputError(f"{self.name}: {value!r} is {text}")

        if kind == "bool":
            require(isinstance(value, bool), "not true or false")
            return value
        if kind == "string":
            require(isinstance(value, str), "not a string")
            require(
                not self.options or value in self.options, f"not one of {', '.join(self.options)}"
            )
            return value
        require(isinstance(value, int | float) and not isinstance(value, bool), "not a number")
        if self.range is not None and value == value:
            low, high = self.range
            require(low <= value <= high, f"outside {low:g} to {high:g} {self.unit}".rstrip())
        require(
            abs(value) <= sys.float_info.max, "not finite"
        )  # nor an int that no float can hold
        require(kind != "int" or value == int(value), "not a whole number")
        return int(value) if kind == "int" else float(value)


def _spec(name: Any, entry: Any, where: str) -> ParameterSpec:
    def require(met: object, text: str) -> None:
        if not met:
            raise InputError(f"{where}: {text}")

    named = isinstance(name, str) and _NAME.fullmatch(name)
    require(
        named, f"{name!r} is not a parameter name (letters, digits, '_', groups separated by '.')"
    )
    require(
        isinstance(entry, Mapping),
        f"{name} must be a mapping with type, default_value and description",
    )
    unknown = sorted(str(key) for key in entry if key not in _KEYS)
    require(
        not unknown,
        f"{name} has unknown keys {', '.join(unknown)}; known: {', '.join(sorted(_KEYS))}",
    )
    missing = [key for key in ("type", "default_value", "description") if key not in entry]
    require(not missing, f"{name} lacks {', '.join(missing)}")
    kind, bounds, options = entry["type"], entry.get("range"), entry.get("options", [])
    require(kind in TYPES, f"{name} has type {kind!r}; known: {', '.join(TYPES)}")
    if bounds is not None:
        pair = isinstance(bounds, list) and len(bounds) == 2
        numeric = kind in ("double", "int", "double_array")
        require(pair and numeric, f"range of {name} must be [min, max] and needs a numeric type")
        finite = all(isinstance(bound, int | float) and math.isfinite(bound) for bound in bounds)
        require(
            finite and bounds[0] <= bounds[1],
            f"range of {name} must be two finite numbers, min before max",
        )
        bounds = (float(bounds[0]), float(bounds[1]))
    strings = isinstance(options, list) and all(isinstance(option, str) for option in options)
    require(strings, f"options of {name} must be a list of strings")
    require(
        not options or kind in ("string", "string_array"),
        f"options of {name} need type string or string_array",
    )
    read_only = entry.get("read_only", False)
    require(isinstance(read_only, bool), f"read_only of {name} must be true or false")
    default = entry["default_value"]
    if isinstance(default, str) and default.startswith("$"):
        default = getattr(weld, default[1:], default)
    unit, description, negative = (
        str(entry.get(key, "")) for key in ("unit", "description", "negative")
    )
    spec = ParameterSpec(
        name, kind, default, description, unit, bounds, tuple(options), read_only, negative
    )
    try:
        return replace(spec, default=spec.check(default))
    except InputError as error:
        raise InputError(f"{where}: default_value of {error}") from None


def parse(text: str, where: str = "parameters") -> dict[str, ParameterSpec]:
    """Read parameter descriptions from YAML text, in its order; ``where`` names the source in errors.

    Raises
    ------
    InputError
        When the YAML is broken or describes a parameter wrongly.
    """
    content = content_of(text, where)
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise InputError(f"{where}: must map parameter names to descriptions")
    specs: dict[str, ParameterSpec] = {}
    for name, entry in content.items():
        if name == INCLUDE:
            package, _, file = str(entry).partition("/")
            specs |= load(package, file)
        else:
            specs |= {
                str(own): _spec(own, inner, where) for own, inner in _each_sensor(name, entry)
            }
    return specs


def _each_sensor(name: Any, entry: Any) -> Iterator[tuple[Any, Any]]:
    """An entry of a file; a template once for each sensor."""
    if "$" not in str(name) or not isinstance(entry, Mapping):
        yield name, entry
        return
    group = (
        {name: entry}
        if "type" in entry
        else {f"{name}.{key}": inner for key, inner in entry.items()}
    )
    for fields in (row.template() for row in SENSORS.values()):
        for inner_name, inner in group.items():
            filled = {key: _filled(value, fields) for key, value in inner.items()}
            if filled.get("default_value", "") is not None:
                yield _filled(inner_name, fields), filled


def _filled(value: Any, fields: Mapping[str, Any]) -> Any:
    """A text of a template with a sensor's values."""
    if not isinstance(value, str):
        return value
    return (
        fields[value[1:]]
        if value[:1] == "$" and value[1:] in fields
        else Template(value).safe_substitute(fields)
    )


@cache
def load(package: str, file: str) -> dict[str, ParameterSpec]:
    """Read the parameter descriptions that ``package`` ships as ``file``, once; the result is shared.

    Raises
    ------
    InputError
        When there is no such package or file, or its content is wrong.
    """
    try:
        folder = resources.files(package)
    except ModuleNotFoundError as error:
        raise InputError(f"cannot read {file} of package {package}: {error}") from None
    return load_path(str(folder.joinpath(file)))


def load_path(path: str | Path) -> dict[str, ParameterSpec]:
    """Read the parameter descriptions in the file ``path``; errors as :func:`load`."""
    try:
        text = read_regular(path).decode()
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    return parse(text, str(path))


def load_source(source: Source) -> dict[str, ParameterSpec]:
    """Read parameter descriptions from wherever they are; errors as :func:`load`."""
    if source is None:
        return {}
    return load(*source) if isinstance(source, tuple) else load_path(source)


def defaults(specs: Mapping[str, ParameterSpec]) -> dict[str, Any]:
    """Return every parameter's default value."""
    return {name: spec.default for name, spec in specs.items()}


def require_known(specs: Collection[str], names: Iterable[str]) -> None:
    """Raise an InputError that suggests similar names where some are unknown."""
    unknown = sorted(set(names) - set(specs))
    if unknown:
        near = dict.fromkeys(match for name in unknown for match in get_close_matches(name, specs))
        raise InputError(f"unknown parameters {', '.join(unknown)}; {_suggestion(near, specs)}")


def validate(specs: Mapping[str, ParameterSpec], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``values`` checked and completed with the defaults.

    Raises
    ------
    InputError
        When a name is unknown or a value does not fit.
    """
    require_known(specs, values)
    return defaults(specs) | {name: specs[name].check(value) for name, value in values.items()}


def _suggestion(near: Iterable[str], known: Iterable[str]) -> str:
    """Suggestions for an unknown name; all known names if none is similar."""
    return f"did you mean {', '.join(near)}?" if near else f"known: {', '.join(known)}"


def problem(make: Callable[[Mapping[str, Any]], object], values: Mapping[str, Any]) -> str | None:
    """Why ``make`` refuses ``values`` with a ValueError, None if it takes them."""
    try:
        make(values)
    except ValueError as error:
        return str(error)
    return None
