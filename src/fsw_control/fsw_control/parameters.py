"""Parameters of nodes: one model per node, from which they are declared, checked and documented.

A model is a subclass of :class:`NodeParameters`; a model inside it is a group::

    class Loop(Model):
        gain: Annotated[float, Range(0.0, 10.0, "kN/mm")] = 1.0
        \"\"\"Proportional gain.\"\"\"

    class MyParameters(NodeParameters):
        loop: Loop = Loop()
        names: Annotated[Many[str], AT_START] = ()
        \"\"\"Names; can be set at start only.\"\"\"

Its parameters are ``loop.gain`` and ``names``. A validator of a group or of the whole model checks
parameters that depend on one another. The rest of the software handles parameters as a flat
mapping of these names.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from typing import Annotated, Any, Literal, Self, get_args, get_origin

from fsw_control.schema import models
from fsw_control.schema.errors import InputError
from fsw_control.schema.models import Model, descriptions
from fsw_control.schema.ranges import Range

#: end of the name of a parameter with the hash of what the file holds that another one names
CONTENT_SHA256 = "_sha256"


class _AtStart:
    """Marks a parameter, or a group of them, that cannot be changed at runtime."""


AT_START = _AtStart()
_TYPES = {bool: "bool", int: "int", float: "double"}


class NodeParameters(Model):
    """Base of the parameters of a node; all have defaults."""

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> Self:
        """Parameters from their flat mapping, as :func:`validate`; missing ones have defaults."""
        require_known(defaults(cls), values)
        nested: dict[str, Any] = {}
        for name, value in values.items():
            if value is None:  # a model would take its default
                raise InputError(f"parameters: {name} has no value")
            *groups, own = name.split(".")
            inside = nested
            for group in groups:
                inside = inside.setdefault(group, {})
            inside[own] = value
        return models.validate(cls, nested, "parameters")

    def flat(self) -> dict[str, Any]:
        """All values by name."""
        return dict(_flat(self, ""))


#: the model of a controller's or node's parameters; None: it has none
ParameterModel = type[NodeParameters] | None


@dataclass(frozen=True, slots=True)
class ParameterSpec:
    """Name of a parameter on its node (dots group, e.g. ``depth.gain``), and what is allowed.

    ``range`` bounds a number, or each entry of an array; bounds included. ``options`` empty: any
    string is accepted. ``read_only``: can be set at start only.
    """

    name: str
    type: str  #: double, int, bool, string, string_array or double_array
    default: Any
    description: str
    unit: str = ""
    range: tuple[float, float] | None = None
    options: tuple[str, ...] = ()
    read_only: bool = False


@cache
def describe(model: ParameterModel) -> dict[str, ParameterSpec]:
    """Descriptions of all parameters of a model by name; the result is shared."""
    return {} if model is None else {spec.name: spec for spec in _specs(model(), "", False)}


def _specs(group: Model, prefix: str, read_only: bool) -> Iterator[ParameterSpec]:
    texts = descriptions(type(group))
    for name, field in type(group).model_fields.items():
        value, at_start = getattr(group, name), read_only or AT_START in field.metadata
        if isinstance(value, Model):
            yield from _specs(value, f"{prefix}{name}.", at_start)
            continue
        kind, metadata, suffix = field.annotation, field.metadata, ""
        if get_origin(kind) is tuple:
            kind, suffix = get_args(kind)[0], "_array"
            if get_origin(kind) is Annotated:
                kind, *metadata = get_args(kind)
        bounds = next((entry for entry in metadata if isinstance(entry, Range)), None)
        yield ParameterSpec(
            name=prefix + name,
            type=_TYPES.get(kind, "string") + suffix,  # type: ignore[arg-type]
            default=list(value) if suffix else value,
            description=" ".join(texts[name].split()).removesuffix("."),
            unit=bounds.unit if bounds else "",
            range=(bounds.low, bounds.high) if bounds else None,
            options=get_args(kind) if get_origin(kind) is Literal else (),
            read_only=at_start,
        )


def defaults(model: ParameterModel) -> dict[str, Any]:
    """Default value of every parameter; unlike :func:`describe` it reads no source file."""
    return {} if model is None else model().flat()


def validate(model: ParameterModel, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``values`` checked, each and together, and completed with the defaults.

    Raises
    ------
    InputError
        When a name is unknown, a value does not fit, or values contradict each other; the message
        names parameter, value and what is allowed.
    """
    if model is None:
        require_known((), values)
        return {}
    return model.from_values(values).flat()


def _flat(group: Model, prefix: str) -> Iterator[tuple[str, Any]]:
    for name in type(group).model_fields:
        value = getattr(group, name)
        if isinstance(value, Model):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, list(value) if isinstance(value, tuple) else value


def require_known(known: Collection[str], names: Iterable[str]) -> None:
    """Raise an InputError that suggests similar names where some are unknown."""
    if unknown := sorted(set(names) - set(known)):
        near = dict.fromkeys(match for name in unknown for match in get_close_matches(name, known))
        hint = f"did you mean {', '.join(near)}?" if near else f"known: {', '.join(known)}"
        raise InputError(f"unknown parameters {', '.join(unknown)}; {hint}")


def problem(make: Callable[[Mapping[str, Any]], object], values: Mapping[str, Any]) -> str | None:
    """Why ``make`` refuses ``values`` with a ValueError, None if it takes them."""
    try:
        make(values)
    except ValueError as error:
        return str(error)
    return None
