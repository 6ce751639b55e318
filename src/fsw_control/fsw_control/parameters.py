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
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import yaml

from fsw_control import weld

TYPES = ("double", "int", "bool", "string", "string_array", "double_array")
_KEYS = {"type", "default_value", "description", "unit", "range", "options", "read_only"}
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*(\.[A-Za-z0-9_]+)*\Z")


class ParameterError(ValueError):
    """A parameter file or a parameter value is wrong; the message says where, what and what to do."""


@dataclass(frozen=True, slots=True)
class ParameterSpec:
    """One parameter.

    Attributes
    ----------
    name : str
        Name on the node; dots group, e.g. ``depth.gain``.
    type : str
        One of ``TYPES``.
    default : Any
        Value when nobody sets one.
    description : str
        For people.
    unit : str
        Of the value, empty when it has none.
    range : tuple of float or None
        Inclusive bounds of numbers (of each entry of an array).
    options : tuple of str
        Allowed strings; empty when all are.
    read_only : bool
        Whether it can be set at start only.
    """

    name: str
    type: str
    default: Any
    description: str
    unit: str = ""
    range: tuple[float, float] | None = None
    options: tuple[str, ...] = ()
    read_only: bool = False

    def check(self, value: Any) -> Any:
        """Return ``value`` in the parameter's type.

        Raises
        ------
        ParameterError
            When the type, the range or the options do not fit, or a number is not finite.
        """
        if self.type.endswith("_array"):
            if isinstance(value, str | bytes) or not isinstance(value, Iterable):
                raise ParameterError(f"{self.name}: {value!r} is not a list ({self.type})")
            return [self._check_entry(entry, self.type.removesuffix("_array")) for entry in value]
        return self._check_entry(value, self.type)

    def _check_entry(self, value: Any, kind: str) -> Any:
        if kind == "bool":
            if not isinstance(value, bool):
                raise ParameterError(f"{self.name}: {value!r} is not true or false")
            return value
        if kind == "string":
            if not isinstance(value, str):
                raise ParameterError(f"{self.name}: {value!r} is not a string")
            if self.options and value not in self.options:
                raise ParameterError(f"{self.name}: {value!r} is none of {', '.join(self.options)}")
            return value
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ParameterError(f"{self.name}: {value!r} is not a number")
        if not math.isfinite(value):
            raise ParameterError(f"{self.name}: {value!r} is not finite")
        if kind == "int" and value != int(value):
            raise ParameterError(f"{self.name}: {value!r} is not a whole number")
        if self.range is not None and not self.range[0] <= value <= self.range[1]:
            unit = f" {self.unit}" if self.unit else ""
            raise ParameterError(f"{self.name}: {value!r} is outside {self.range[0]:g} to {self.range[1]:g}{unit}")
        return int(value) if kind == "int" else float(value)

    def describe(self) -> str:
        """Return the description with the unit and the options, as shown by ``ros2 param describe``."""
        unit = f" [{self.unit}]" if self.unit else ""
        options = f" (one of {', '.join(self.options)})" if self.options else ""
        return f"{self.description}{unit}{options}"


def _spec(name: object, entry: object, where: str) -> ParameterSpec:
    if not isinstance(name, str) or not _NAME.match(name):
        raise ParameterError(f"{where}: {name!r} is no parameter name (letters, digits, '_', groups parted by '.')")
    if not isinstance(entry, Mapping):
        raise ParameterError(f"{where}: {name} must be a mapping with type, default_value and description")
    unknown = sorted(str(key) for key in entry if key not in _KEYS)
    if unknown:
        raise ParameterError(
            f"{where}: {name} has unknown keys {', '.join(unknown)}; known: {', '.join(sorted(_KEYS))}"
        )
    missing = [key for key in ("type", "default_value", "description") if key not in entry]
    if missing:
        raise ParameterError(f"{where}: {name} lacks {', '.join(missing)}")
    kind = entry["type"]
    if kind not in TYPES:
        raise ParameterError(f"{where}: {name} has type {kind!r}; known: {', '.join(TYPES)}")
    bounds = entry.get("range")
    if bounds is not None:
        numeric = kind in ("double", "int", "double_array")
        if not numeric or not isinstance(bounds, list) or len(bounds) != 2:
            raise ParameterError(f"{where}: range of {name} must be [min, max] and needs a numeric type")
        if (
            not all(isinstance(bound, int | float) and math.isfinite(bound) for bound in bounds)
            or bounds[0] > bounds[1]
        ):
            raise ParameterError(f"{where}: range of {name} must be two finite numbers, min before max")
        bounds = (float(bounds[0]), float(bounds[1]))
    options = entry.get("options", [])
    if options and kind not in ("string", "string_array"):
        raise ParameterError(f"{where}: options of {name} need type string or string_array")
    if not isinstance(options, list) or not all(isinstance(option, str) for option in options):
        raise ParameterError(f"{where}: options of {name} must be a list of strings")
    read_only = entry.get("read_only", False)
    if not isinstance(read_only, bool):
        raise ParameterError(f"{where}: read_only of {name} must be true or false")
    unit, description = str(entry.get("unit", "")), str(entry["description"])
    spec = ParameterSpec(name, kind, None, description, unit, bounds, tuple(options), read_only)
    default = entry["default_value"]
    if isinstance(default, str) and default.startswith("$"):
        default = getattr(weld, default[1:], default)
    try:
        default = spec.check(default)
    except ParameterError as error:
        raise ParameterError(f"{where}: default_value of {error}") from None
    return ParameterSpec(name, kind, default, description, unit, bounds, tuple(options), read_only)


def parse(text: str, where: str = "parameters") -> dict[str, ParameterSpec]:
    """Read parameter descriptions from YAML text.

    Parameters
    ----------
    text : str
        The YAML.
    where : str
        Name of the source, for error messages.

    Returns
    -------
    dict of str to ParameterSpec
        In the order of the file.

    Raises
    ------
    ParameterError
        When the YAML is broken or describes a parameter wrongly.
    """
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ParameterError(f"{where}: not valid YAML: {' '.join(str(error).split())}") from None
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise ParameterError(f"{where}: must map parameter names to descriptions")
    return {str(name): _spec(name, entry, where) for name, entry in content.items()}


def load(package: str, file: str) -> dict[str, ParameterSpec]:
    """Read the parameter descriptions that ``package`` ships as ``file``.

    Raises
    ------
    ParameterError
        When there is no such package or file, or its content is wrong.
    """
    return dict(_load(package, file))


@cache
def _load(package: str, file: str) -> dict[str, ParameterSpec]:
    try:
        text = resources.files(package).joinpath(file).read_text(encoding="utf-8")
    except (ModuleNotFoundError, OSError) as error:
        raise ParameterError(f"cannot read {file} of package {package}: {error}") from None
    return parse(text, f"{package}/{file}")


def load_path(path: str | Path) -> dict[str, ParameterSpec]:
    """Read the parameter descriptions in the file ``path``; errors as :func:`load`."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise ParameterError(f"cannot read {path}: {error.strerror}") from None
    return parse(text, str(path))


def defaults(specs: Mapping[str, ParameterSpec]) -> dict[str, Any]:
    """Return every parameter's default value."""
    return {name: spec.default for name, spec in specs.items()}


def validate(specs: Mapping[str, ParameterSpec], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``values`` checked and completed with the defaults.

    Raises
    ------
    ParameterError
        When a name is unknown or a value does not fit.
    """
    unknown = sorted(set(values) - set(specs))
    if unknown:
        raise ParameterError(f"unknown parameters {', '.join(unknown)}; known: {', '.join(specs)}")
    return defaults(specs) | {name: specs[name].check(value) for name, value in values.items()}


def markdown(specs: Mapping[str, ParameterSpec]) -> str:
    """Return a markdown table of the parameters, for the README."""
    rows = ["| parameter | type | default | range | unit | meaning |", "|---|---|---|---|---|---|"]
    for spec in specs.values():
        default = ", ".join(map(str, spec.default)) if isinstance(spec.default, list) else str(spec.default)
        allowed = ", ".join(spec.options) if spec.options else ""
        if spec.range is not None:
            allowed = f"{spec.range[0]:g} … {spec.range[1]:g}"
        text = spec.description + (" (at start only)" if spec.read_only else "")
        cells = (f"`{spec.name}`", spec.type, default, allowed, spec.unit, text)
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(rows) + "\n"
