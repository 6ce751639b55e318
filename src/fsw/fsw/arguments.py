"""Validation of the arguments of public functions, like that of files and requests."""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial, wraps
from typing import Annotated, Any, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, InstanceOf, PlainValidator, create_model
from pydantic_core import PydanticCustomError

from fsw_control.schema.models import validated_by

P = ParamSpec("P")
R = TypeVar("R")
_STRICT = ConfigDict(strict=True, arbitrary_types_allowed=True)


def validated(function: Callable[P, R]) -> Callable[P, R]:
    """Validate the arguments against the function's annotations before each call.

    The arguments are passed on as they are. The function's classes are checked by instance; a
    mapping of values does not make one.

    Raises
    ------
    fsw_control.schema.models.InputError
        By the function, with the invalid arguments as its ``problems``.
    """
    signature = inspect.signature(function)
    *_, last, own = ["", *function.__qualname__.split(".")]
    where = last if own == "__init__" else own

    @cache
    def model() -> type[BaseModel]:  # later, as classes defined further down are annotated, too
        texts = {name: text for name, text in function.__annotations__.items() if name != "return"}
        place = types.SimpleNamespace(__annotations__=texts)
        fields: dict[str, Any] = {}
        for name, hint in get_type_hints(place, function.__globals__).items():
            kind, checked = signature.parameters[name].kind, _by_instance(hint)
            if kind is inspect.Parameter.VAR_POSITIONAL:
                checked = types.GenericAlias(tuple, (checked, ...))
            elif kind is inspect.Parameter.VAR_KEYWORD:
                checked = types.GenericAlias(dict, (str, checked))
            # by alias, because a field must not have the name of a method such as `validate`
            fields[f"{name}_"] = (checked, Field(None, alias=name))
        return create_model(where, __config__=_STRICT, **fields)

    @wraps(function)
    def call(*args: P.args, **keywords: P.kwargs) -> R:
        try:
            bound = signature.bind(*args, **keywords).arguments
        except TypeError:  # an argument too many or too few: Python names the function
            return function(*args, **keywords)
        bound.pop("self", None)
        plain = {
            name: value.item() if isinstance(value, np.generic) else value
            for name, value in bound.items()
        }
        validated_by(model().model_validate, plain, where)
        return function(*args, **keywords)

    return call


def _with_all_members(protocol: type, value: object) -> object:
    """The value, if it has what a protocol asks for; the error lists what it lacks."""
    if isinstance(value, protocol) and not isinstance(value, type):
        return value
    members = [name for name in dir(protocol) if not name.startswith("_")]
    lacking = [name for name in members if not hasattr(value, name)]
    context = {"class": protocol.__name__, "lacks": ""}
    if len(lacking) < len(members):
        context["lacks"] = ", ".join(lacking) or "an object of this class"
    raise PydanticCustomError("is_instance_of", "", context)


def _by_instance(hint: Any) -> Any:
    """The annotation with our classes, also inside a union, as checks by instance."""
    origin = get_origin(hint)
    if origin in (Union, types.UnionType):
        return Union[tuple(map(_by_instance, get_args(hint)))]  # noqa: UP007  # made of a tuple
    if origin in (Mapping, Sequence):
        return types.GenericAlias(origin, tuple(map(_by_instance, get_args(hint))))
    if getattr(hint, "_is_protocol", False) and hint.__module__.startswith("fsw"):
        return Annotated[Any, PlainValidator(partial(_with_all_members, hint))]
    instance_of: Any = InstanceOf
    return instance_of[hint] if getattr(hint, "__module__", "").startswith("fsw") else hint
