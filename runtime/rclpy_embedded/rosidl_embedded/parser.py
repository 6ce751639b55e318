"""Reads ``.msg``, ``.srv`` and ``.action`` texts."""

import ast
import keyword
import re
from typing import Any

from . import definition as d

# Names in .msg files -> IDL. A .msg char has been an uint8 since ROS 2 began.
BASIC_TYPES = {
    **{name: name for name in d.INTEGER_RANGES},
    "bool": "boolean",
    "byte": "octet",
    "char": "uint8",
    "float32": "float",
    "float64": "double",
}
_TYPE = re.compile(
    r"(?P<base>string|wstring|(?P<structure>[A-Za-z][\w/]*))(?(structure)|(<=(?P<bound>[1-9]\d*))?)"
    r"(?P<several>\[((?P<limit><=)?(?P<size>[1-9]\d*))?\])?"
)
_STRING_ITEM = re.compile(r"""\s*("(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'|[^,]+?)\s*(?:,|$)""")
_FIELD_NAME = re.compile(r"(?!.*__)(?!.*_$)[a-z][a-z0-9_]*")
_CONSTANT_NAME = re.compile(r"[A-Z](_?[A-Z0-9])*")
_STRUCTURE_NAME = re.compile(r"\w+/(msg/[A-Z][A-Za-z0-9]*|(srv|action)/[A-Z]\w*)")
#: The parts that the text of a service, and that of an action, consists of.
PARTS = {"srv": ("Request", "Response"), "action": ("Goal", "Result", "Feedback")}


def parse_type(text: str, package: str) -> d.AbstractType:
    """Read a type such as ``float64[3]``, ``string<=10[]`` or ``geometry_msgs/Pose``; ValueError if it is none.

    Structures without a package belong to `package`.
    """
    match = _TYPE.fullmatch(text)
    if match is None:
        raise ValueError(f"{text!r} is not a type, such as 'float64', 'float64[3]', 'string<=10[]' or 'pkg/Name[<=5]'")
    element = _element_type(match["base"], int(match["bound"] or 0), package)
    if match["several"] is None:
        return element
    if match["size"] is None:
        return d.UnboundedSequence(element)
    return (d.BoundedSequence if match["limit"] else d.Array)(element, int(match["size"]))


def _element_type(base: str, bound: int, package: str) -> d.AbstractType:
    if base in BASIC_TYPES:
        return d.BasicType(BASIC_TYPES[base])
    if base == "string":
        return d.BoundedString(bound) if bound else d.UnboundedString()
    if base == "wstring":
        return d.BoundedWString(bound) if bound else d.UnboundedWString()
    parts = base.split("/") if "/" in base else [package, base]
    if len(parts) == 2:
        parts.insert(1, "msg")
    if not _STRUCTURE_NAME.fullmatch("/".join(parts)):
        raise ValueError(f"{base!r} is neither a basic type nor the name of a message")
    return d.NamespacedType(parts[:2], parts[2])


def parse_value(text: str, type_: d.AbstractType) -> Any:
    """Read the value of a constant or a default, as a field of the type would hold it; ValueError if it is none."""
    text = text.strip()
    match type_:
        case d.AbstractGenericString():
            return _string(text)
        case d.BasicType(typename):
            return _basic_value(_literal(text), typename)
        case d.NamespacedType() | d.AbstractNestedType(d.NamespacedType()):
            raise ValueError("a message field cannot have a default")
    assert isinstance(type_, d.AbstractNestedType)
    if text[:1] + text[-1:] != "[]":
        raise ValueError(f"{text!r} is not a list of values")
    element = type_.value_type
    if isinstance(element, d.BasicType):
        values = [_basic_value(value, element.typename) for value in _literal(text)]
    else:
        values = [_string(item) for item in _STRING_ITEM.findall(text[1:-1])]
    if isinstance(type_, d.Array) and len(values) != type_.size:
        raise ValueError(f"{len(values)} values for an array of {type_.size}")
    if isinstance(type_, d.BoundedSequence) and len(values) > type_.maximum_size:
        raise ValueError(f"{len(values)} values for a sequence of at most {type_.maximum_size}")
    return values


def _basic_value(value: Any, typename: str) -> Any:
    if typename == "boolean" and value in (True, False):
        return bool(value)
    if typename in ("float", "double") and isinstance(value, int | float):
        return float(value)
    low, high = d.INTEGER_RANGES.get("uint8" if typename == "octet" else typename, (1, 0))
    if isinstance(value, int) and low <= value <= high:
        return bytes([value]) if typename == "octet" else int(value)
    raise ValueError(f"{value!r} is not a value of type {typename}")


def _literal(text: str) -> Any:
    try:
        return ast.literal_eval(re.sub(r"\b(true|false)\b", lambda word: word[0].capitalize(), text))
    except (SyntaxError, ValueError):
        raise ValueError(f"{text!r} is not a value") from None


def _string(text: str) -> str:
    if len(text) >= 2 and text[0] == text[-1] and text[0] in "\"'":
        return text[1:-1].replace("\\" + text[0], text[0])
    return text


def parse_structure(text: str, type_name: str, origin: str) -> d.Structure:
    """Read one structure: the whole of a ``.msg`` file or one part of another."""
    package = type_name.split("/")[0]
    fields: list[d.Member] = []
    constants: list[d.Member] = []
    names: set[str] = set()
    for number, line in enumerate(text.splitlines(), start=1):
        line = line.partition("#")[0].strip()
        if not line:
            continue
        try:
            member, is_constant = _member(line, package)
        except ValueError as error:
            raise d.InvalidInterfaceError(f"{origin}, line {number}: {error}") from None
        if member.name in names:
            raise d.InvalidInterfaceError(f"{origin}, line {number}: {member.name!r} is defined twice")
        names.add(member.name)
        (constants if is_constant else fields).append(member)
    return d.Structure(type_name, tuple(fields), tuple(constants))


def _member(line: str, package: str) -> tuple[d.Member, bool]:
    """Read a field or a constant; the latter with True."""
    type_text, _, rest = line.replace("\t", " ").partition(" ")
    type_ = parse_type(type_text, package)
    name, separator, value = rest.partition("=")
    if separator:
        name = name.strip()
        if not _CONSTANT_NAME.fullmatch(name):
            raise ValueError(f"{name!r} is not a constant's name (upper case letters, digits, single underscores)")
        if not isinstance(type_, d.BasicType | d.AbstractGenericString):
            raise ValueError(f"constant {name!r} must be a number, a boolean or a string")
        return d.Member(name, type_, parse_value(value, type_)), True
    name, _, default = rest.strip().partition(" ")
    if not _FIELD_NAME.fullmatch(name) or keyword.iskeyword(name):
        raise ValueError(f"{name!r} is not a field's name (lower case letters, digits, single underscores; no keyword)")
    return d.Member(name, type_, parse_value(default, type_) if default.strip() else None), False


def split_parts(text: str, type_name: str, origin: str, names: tuple[str, ...]) -> dict[str, str]:
    """Return the texts between the lines ``---`` by the names of the structures that they define."""
    lines = text.splitlines()
    marks = [number for number, line in enumerate(lines) if line.partition("#")[0].strip() == "---"]
    if len(marks) != len(names) - 1:
        places = " and ".join(name.lower() for name in names)
        raise d.InvalidInterfaceError(f"{origin}: needs exactly {len(names) - 1} x '---', between {places}")
    starts, ends = [0, *(mark + 1 for mark in marks)], [*marks, len(lines)]
    # Blank lines keep the line numbers of error messages true.
    return {
        f"{type_name}_{name}": "\n" * start + "".join(f"{line}\n" for line in lines[start:end])
        for name, start, end in zip(names, starts, ends, strict=True)
    }
