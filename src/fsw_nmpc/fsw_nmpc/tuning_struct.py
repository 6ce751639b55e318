"""The kernel's tuning as a C struct, generated from fields and properties of :class:`.Settings`.

The text (``kernel/fsw_nmpc_tuning.h``, written by :mod:`.kernel_codegen`) is compiled, read by
cffi, and exported.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache
from operator import attrgetter
from textwrap import wrap
from typing import Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

from fsw_control import Limits
from fsw_control.schema.models import Model, descriptions
from fsw_nmpc.tuning import PRIORITIES, TRAJECTORIES, Settings, Share, Tuning

#: Settings without a member in the kernel: the model is a struct of its own, the horizon a part
#: of it; announced set-points are an input; instead of a memory's time constant the kernel has the
#: decay per tick.
_OTHERS = {
    "model",
    "preview",
    "blocks",
    "offset_memory_s",
    "depth_rate_memory_s",
    "temperature_rate_memory_s",
}
_HEAD = (
    "/* Generated from the models in fsw_nmpc/tuning.py by fsw_nmpc/kernel_codegen.py; "
    "do not edit. */"
)
_WIDTH = 99


class Member(NamedTuple):
    """A member of a struct."""

    name: str
    kind: Any  #: its type in Python
    text: str  #: its description
    place: str  #: path of its value in an object of the class

    @property
    def is_model(self) -> bool:
        """Whether it is itself a struct."""
        return isinstance(self.kind, type) and issubclass(self.kind, Model)

    @property
    def is_array(self) -> bool:
        """Whether it has a number for each state of the estimator."""
        return any(get_origin(part) is tuple for part in get_args(self.kind)[:1])

    @property
    def is_int(self) -> bool:
        """Whether it is an int in C; a choice is the index of the enumeration."""
        kind = getattr(self.kind, "__origin__", self.kind)  # without its range
        return kind is int or kind is Literal

    def in_c(self, value: Any) -> Any:
        """Return a value in the form that cffi takes."""
        if self.is_model:
            return values(value)
        return get_args(self.kind).index(value) if get_origin(self.kind) is Literal else value


@cache
def members(owner: type) -> tuple[Member, ...]:
    """Members of a class's struct: fields and properties; limits and tuning are flattened."""
    texts = descriptions(owner) if issubclass(owner, Model) else {}
    listed: list[Member] = []
    for name, kind in get_type_hints(owner, include_extras=True).items():
        if kind in (Limits, Tuning):
            listed += [member._replace(place=f"{name}.{member.place}") for member in members(kind)]
        elif name not in _OTHERS:
            listed.append(Member(name, kind, texts.get(name, ""), name))
    for name, value in vars(owner).items():
        if isinstance(value, property):
            kind = get_type_hints(value.fget, include_extras=True)["return"]
            listed.append(Member(name, kind, value.__doc__ or "", name))
    return tuple(listed)


def values(owner: Any) -> dict[str, Any]:
    """Values of the members in the form that cffi takes."""
    return {
        member.name: member.in_c(attrgetter(member.place)(owner))
        for member in members(owner.__class__)
    }


def header() -> str:
    """Text of ``fsw_nmpc_tuning.h``: enumerations, structs, list of all shares."""
    lines = [_HEAD, "#ifndef FSW_NMPC_TUNING_H", "#define FSW_NMPC_TUNING_H", ""]
    for name, prefix, choices in (
        ("trajectory", "", TRAJECTORIES),
        ("priority", "KEEP_", PRIORITIES),
    ):
        listed = ", ".join(f"FSW_{prefix}{choice.upper()}" for choice in choices)
        lines += [f"typedef enum {{ {listed} }} fsw_{name};", ""]
    parts = [member for member in members(Settings) if member.is_model]
    for part in parts:
        lines += _struct(f"fsw_{part.name}_tuning", members(part.kind))
    lines += _struct("fsw_nmpc_tuning", members(Settings))
    calls = " ".join(f"DO({name})" for name in _shares(members(Settings)))
    indented = wrap(calls, _WIDTH - 2, initial_indent="  ", subsequent_indent="  ")
    lines += [" \\\n".join(["#define FSW_EACH_SHARE(DO)", *indented]), ""]
    return "\n".join([*lines, "#endif", ""])


def _struct(name: str, parts: Iterable[Member]) -> list[str]:
    """Text of a struct; ints come last: without padding the kernel checks all numbers at once."""
    lines = []
    for member in sorted(parts, key=lambda part: part.is_int):
        size = "[FSW_STATES]" if member.is_array else ""
        kind = (
            f"fsw_{member.name}_tuning"
            if member.is_model
            else "int"
            if member.is_int
            else "double"
        )
        text = " ".join(member.text.replace("`", "").split())
        lines += (
            wrap(f"/* {text} */", _WIDTH, initial_indent="  ", subsequent_indent="   * ")
            if text
            else []
        )
        lines.append(f"  {kind} {member.name}{size};")
    return ["typedef struct {", *lines, f"}} {name};", ""]


def _shares(parts: Iterable[Member], prefix: str = "") -> Iterator[str]:
    """Names of all numbers from 0 to 1."""
    for member in parts:
        if member.is_model:
            yield from _shares(members(member.kind), f"{prefix}{member.name}.")
        elif member.kind == Share:
            yield prefix + member.name
