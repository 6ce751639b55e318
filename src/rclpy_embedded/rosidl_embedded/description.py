"""Type descriptions: RIHS01 hashes and definition texts."""

from __future__ import annotations

import json
from functools import cache
from hashlib import sha256
from typing import Any

from . import catalogue
from .definition import (
    EMPTY_STRUCTURE_REQUIRED_MEMBER_NAME,
    AbstractGenericString,
    AbstractString,
    AbstractType,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
    Structure,
    UnboundedSequence,
    element_type,
)

# type_description_interfaces/msg/FieldType: ids of single values, and what an array or sequence adds.
_TYPE_IDS = {
    "int8": 2,
    "uint8": 3,
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float": 10,
    "double": 11,
    "boolean": 15,
    "octet": 16,
}
_NESTED, _STRING, _WSTRING, _BOUNDED_STRING, _BOUNDED_WSTRING = 1, 17, 18, 21, 22
_ARRAY, _BOUNDED_SEQUENCE, _UNBOUNDED_SEQUENCE = 48, 96, 144

_MSG_NAMES = {"boolean": "bool", "octet": "byte", "float": "float32", "double": "float64"}
_SEPARATOR = "=" * 80


@cache
def type_hash(type_name: str) -> str:
    """RIHS01 hash of a message, a service, or a service's request, response or event (REP 2016).

    Raises
    ------
    UnknownInterfaceError
        If the interface or one that it refers to is not known.
    """
    return "RIHS01_" + sha256(json.dumps(type_description(type_name)).encode()).hexdigest()


def type_description(type_name: str) -> dict[str, Any]:
    """Description of an interface with the members of ``type_description_interfaces/msg/TypeDescription``.

    Default values are left out, as they are from the hash.

    Raises
    ------
    UnknownInterfaceError
        If the interface or one that it refers to is not known.
    """
    referenced: dict[str, Any] = {}
    package, kind, name = catalogue.split_name(type_name)
    type_name = f"{package}/{kind}/{name}"
    if kind == "srv" and not catalogue.service_part(name)[1]:
        catalogue.service(type_name)
        parts = [("request_message", "_Request"), ("response_message", "_Response"), ("event_message", "_Event")]
        fields = [_field(member, _NESTED, nested=f"{type_name}{part}") for member, part in parts]
        for _, part in parts:
            _collect(f"{type_name}{part}", referenced)
    else:
        _collect(type_name, referenced)
        fields = referenced.pop(type_name)
    return {
        "type_description": {"type_name": type_name, "fields": fields},
        "referenced_type_descriptions": [{"type_name": key, "fields": referenced[key]} for key in sorted(referenced)],
    }


def _collect(type_name: str, found: dict[str, Any]) -> None:
    if type_name in found:
        return
    definition = catalogue.structure(type_name)
    found[type_name] = [_describe(field.name, field.type) for field in definition.fields] or [
        _field(EMPTY_STRUCTURE_REQUIRED_MEMBER_NAME, _TYPE_IDS["uint8"])
    ]
    for name in definition.references():
        _collect(name, found)


def _field(name: str, type_id: int, capacity: int = 0, string_capacity: int = 0, nested: str = "") -> dict[str, Any]:
    return {
        "name": name,
        "type": {
            "type_id": type_id,
            "capacity": capacity,
            "string_capacity": string_capacity,
            "nested_type_name": nested,
        },
    }


def _describe(name: str, type_: AbstractType) -> dict[str, Any]:
    capacity, offset = 0, 0
    if isinstance(type_, Array):
        capacity, offset = type_.size, _ARRAY
    elif isinstance(type_, BoundedSequence):
        capacity, offset = type_.maximum_size, _BOUNDED_SEQUENCE
    elif isinstance(type_, UnboundedSequence):
        offset = _UNBOUNDED_SEQUENCE
    element = element_type(type_)
    if isinstance(element, NamespacedType):
        return _field(name, offset + _NESTED, capacity, nested=element.type_name)
    if isinstance(element, AbstractGenericString):
        narrow = isinstance(element, AbstractString)
        if element.maximum_size is not None:
            type_id = _BOUNDED_STRING if narrow else _BOUNDED_WSTRING
            return _field(name, offset + type_id, capacity, element.maximum_size)
        return _field(name, offset + (_STRING if narrow else _WSTRING), capacity)
    assert isinstance(element, BasicType)
    return _field(name, offset + _TYPE_IDS[element.typename], capacity)


@cache
def interface_definition(type_name: str) -> str:
    """Definition of a message with all that it refers to, in the ``ros2msg`` format of rosbag2's MCAP schemas.

    For a service the definitions of request and response are separated by ``---``, and what they refer to follows.
    """
    package, kind, name = catalogue.split_name(type_name)
    if kind == "srv" and not catalogue.service_part(name)[1]:
        roots = list(catalogue.service(type_name))
    else:
        roots = [catalogue.structure(f"{package}/{kind}/{name}")]
    text = "---\n".join(_definition_text(root) for root in roots)
    pending = [reference for root in roots for reference in root.references()]
    seen: dict[str, None] = {}
    while pending:
        reference = pending.pop(0)
        if reference in seen:
            continue
        seen[reference] = None
        definition = catalogue.structure(reference)
        pending += definition.references()
        text += f"{_SEPARATOR}\nMSG: {_short_name(reference)}\n{_definition_text(definition)}"
    return text


def _short_name(type_name: str) -> str:
    return type_name.replace("/msg/", "/")


def _definition_text(definition: Structure) -> str:
    lines = [f"{type_text(item.type)} {item.name}={value_text(item.value)}" for item in definition.constants]
    for field in definition.fields:
        default = "" if field.default is None else f" {value_text(field.default)}"
        lines.append(f"{type_text(field.type)} {field.name}{default}")
    return "".join(f"{line}\n" for line in lines)


def type_text(type_: AbstractType) -> str:
    """Type as ``.msg`` files write it."""
    element = element_type(type_)
    if isinstance(element, NamespacedType):
        text = _short_name(element.type_name)
    elif isinstance(element, AbstractGenericString):
        text = "string" if isinstance(element, AbstractString) else "wstring"
        text += f"<={element.maximum_size}" if element.has_maximum_size() else ""
    else:
        assert isinstance(element, BasicType)
        text = _MSG_NAMES.get(element.typename, element.typename)
    if isinstance(type_, Array):
        return f"{text}[{type_.size}]"
    if isinstance(type_, BoundedSequence):
        return f"{text}[<={type_.maximum_size}]"
    return f"{text}[]" if isinstance(type_, UnboundedSequence) else text


def value_text(value: Any) -> str:
    """Value of a constant or default as ``.msg`` files write it."""
    if isinstance(value, bytes):
        return str(value[0])
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace('"', '\\"') + '"'
    if isinstance(value, list):
        return "[" + ", ".join(value_text(item) for item in value) + "]"
    return repr(value)
