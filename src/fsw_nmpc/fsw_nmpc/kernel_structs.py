"""The structs of the C library for ctypes, read from ``kernel/fsw_controller.h`` itself."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable, Iterator
from math import prod
from pathlib import Path
from typing import Any, TypeVar

_HEADER = Path(__file__).parent / "kernel" / "fsw_controller.h"
_TEXT = re.sub(r"\s*/\*.*?\*/", "", _HEADER.read_text(encoding="utf-8"), flags=re.DOTALL)
_SIZES = dict(re.findall(r"#define (\w+)\s+(.+)", _TEXT))
_BODIES = {name: body for body, name in re.findall(r"typedef struct \{(.*?)\} (\w+);", _TEXT, re.DOTALL)}
_TYPES: dict[str, Any] = {"int": ctypes.c_int, "double": ctypes.c_double}
Struct = TypeVar("Struct", bound=ctypes.Structure)

_DECLARATION = re.compile(r"(?:const )?(\w+)\s+(.+)", re.DOTALL)
_DECLARATOR = re.compile(r"(\*?)(\w+)((?:\[.+?\])*)")


def size(text: str) -> int:
    """Value of a size in the header: a product of numbers and names."""
    factors = (word.strip() for word in text.strip("() ").split("*"))
    return prod(int(word) if word.isdigit() else size(_SIZES[word]) for word in factors)


def _fields(name: str) -> Iterator[tuple[str, Any]]:
    """Fields of a struct, up to the first of a type that is not part of the interface (the workspace)."""
    for declaration in _BODIES[name].split(";")[:-1]:
        found = _DECLARATION.fullmatch(declaration.strip())
        if found is None:
            raise ValueError(f"{_HEADER.name}: cannot read '{declaration.strip()}' of {name}")
        if found[1] not in _TYPES:
            return
        for star, field, dimensions in _DECLARATOR.findall(found[2]):
            kind = ctypes.POINTER(_TYPES[found[1]]) if star else _TYPES[found[1]]
            for length in reversed(re.findall(r"\[(.+?)\]", dimensions)):
                kind = kind * size(length)
            yield field, kind


def _of(name: str) -> Callable[[type[Struct]], type[Struct]]:
    def read(struct: type[Struct]) -> type[Struct]:
        struct._fields_ = list(_fields(name))
        _TYPES[name] = struct
        return struct

    return read


@_of("fsw_model")
class Model(ctypes.Structure):
    """The process model as constant tables."""


@_of("fsw_tuning")
class TuningStruct(ctypes.Structure):
    """Trajectories, cost, limits and estimator."""


@_of("fsw_change")
class Change(ctypes.Structure):
    """A future set-point."""


@_of("fsw_input")
class Input(ctypes.Structure):
    """What a tick is given."""


@_of("fsw_output")
class Output(ctypes.Structure):
    """What a tick gives back."""


@_of("fsw_start")
class Start(ctypes.Structure):
    """What a prediction starts from."""


@_of("fsw_problem")
class ProblemStruct(ctypes.Structure):
    """The problem of one tick."""


@_of("fsw_estimator")
class EstimatorStruct(ctypes.Structure):
    """Memory of the estimator."""


@_of("fsw_plan")
class PlanStruct(ctypes.Structure):
    """The last plan."""


@_of("fsw_controller")
class ControllerHead(ctypes.Structure):
    """Memory of the controller, without the solver's workspace."""


MAX_CHANGES, N_STATES = size("FSW_MAX_CHANGES"), size("FSW_STATES")
RETURN_SHARE = float(_SIZES["FSW_RETURN_SHARE"])
