"""C text of tables and structs."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import Any

_LINE = 116


def number(value: float) -> str:
    """A number as a C constant, exactly."""
    return repr(value)


def array(kind: str, name: str, values: Sequence[float]) -> str:
    """Definition of a constant array.

    Parameters
    ----------
    kind : str
        Type of the elements.
    name : str
    values : sequence of float
        At least one.
    """
    body = fill(", ".join(map(number, values)), _LINE, initial_indent="  ", subsequent_indent="  ")
    return f"static const {kind} {name}[{len(values)}] = {{\n{body}\n}};\n"


def struct(kind: str, name: str, value: ctypes.Structure, pointers: Mapping[str, str] | None = None) -> str:
    """Definition of a constant struct, field by field.

    Parameters
    ----------
    kind : str
        Name of the struct.
    name : str
    value : ctypes.Structure
    pointers : mapping of str to str, optional
        Name of the array that each pointer field refers to.
    """
    known = pointers or {}
    lines = [
        f"  .{field} = {known[field] if field in known else _initialiser(getattr(value, field))},"
        for field, *_ in value._fields_
    ]
    return "\n".join([f"const {kind} {name} = {{", *lines, "};\n"])


def _initialiser(value: Any) -> str:
    if isinstance(value, ctypes.Array):
        return "{" + ", ".join(_initialiser(one) for one in value) + "}"
    return number(value)


def columns(name: str, struct_name: str, fields: Mapping[str, tuple[str, bool]]) -> str:
    """Table of CSV columns: name, where the field is in its struct, and whether it is an int.

    Parameters
    ----------
    name : str
        Of the table.
    struct_name : str
    fields : mapping of str to (str, bool)
        Member designator of each column, and whether it is an int.
    """
    rows = [
        f'  {{"{column}", offsetof({struct_name}, {member}), {int(is_int)}}},'
        for column, (member, is_int) in fields.items()
    ]
    return "\n".join([f"static const column {name}[] = {{", *rows, "};\n"])
