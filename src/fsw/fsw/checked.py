"""Arguments of the public functions, checked against their annotations: a wrong one is named in one line."""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, wraps
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from fsw_control.schema.models import InputError

P = ParamSpec("P")
R = TypeVar("R")
#: by what is annotated: what a value may be, and what that is called
_KINDS: dict[Any, tuple[Any, str]] = {
    str: (str, "text"),
    Path: (Path, "a path"),
    int: (Integral, "a whole number"),
    float: (Real, "a number"),
    bool: ((bool, np.bool_), "True or False"),
    Mapping: (Mapping, "a mapping of names to values"),
    Sequence: (Sequence, "a list"),
    tuple: (Sequence, "a list"),
    Callable: (Callable, "a function"),
}


def _kinds_of(annotation: Any) -> list[Any]:
    """The kinds of value in an annotation; none where a class does not tell (a protocol, anything)."""
    if (origin := get_origin(annotation)) in (Union, types.UnionType):
        parts = [_kinds_of(one) for one in get_args(annotation)]
        return [kind for part in parts for kind in part] if all(parts) else []
    kind = str if origin is Literal else origin or annotation
    tells = isinstance(kind, type) and kind is not Any and not getattr(kind, "_is_protocol", False)
    return [kind] if tells else []


def _is_one(value: Any, kind: Any) -> bool:
    # True is a whole number to Python, and text a sequence
    refused: Any = {int: bool, float: bool, Sequence: (str, bytes), tuple: (str, bytes)}.get(
        kind, ()
    )
    return isinstance(value, _KINDS.get(kind, (kind,))[0]) and not isinstance(value, refused)


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """A function that refuses arguments of other types than are annotated; what is in a list is not looked at.

    Raises
    ------
    fsw_control.schema.models.InputError
        By the function, before it does anything.
    """
    signature = inspect.signature(function)
    # of a constructor that of its class
    called = (function.__qualname__.removesuffix(".__init__") or function.__name__).rpartition(
        "."
    )[2]

    @cache
    def kinds() -> dict[str, list[Any]]:
        """By parameter; at the first call, as classes that are defined further down can be annotated, too."""
        arguments = {
            name: text for name, text in function.__annotations__.items() if name != "return"
        }
        place = types.SimpleNamespace(__annotations__=arguments)
        return {
            name: _kinds_of(one)
            for name, one in get_type_hints(place, function.__globals__).items()
        }

    def each(given: Mapping[str, Any]) -> Iterator[tuple[str, Any, list[Any]]]:
        for name, value in given.items():
            allowed, kind = kinds().get(name, []), signature.parameters[name].kind
            if kind is inspect.Parameter.VAR_KEYWORD:
                yield from ((keyword, one, allowed) for keyword, one in value.items())
            else:
                values = value if kind is inspect.Parameter.VAR_POSITIONAL else (value,)
                yield from ((name, one, allowed) for one in values)

    @wraps(function)
    def call(*args: P.args, **keywords: P.kwargs) -> R:
        try:
            given = signature.bind(*args, **keywords).arguments
        except (
            TypeError
        ):  # an argument too many or too few: Python says so, with the function's name
            return function(*args, **keywords)
        for name, value, allowed in each(given):
            if allowed and not any(_is_one(value, kind) for kind in allowed):
                words = [
                    _KINDS.get(one, (one, one.__name__))[1]
                    for one in allowed
                    if one is not types.NoneType
                ]
                said = " ".join(repr(value).split())[:80]  # of a table, several lines
                raise InputError(f"{called}: {name} is {' or '.join(words)}, not {said}")
        return function(*args, **keywords)

    return call
