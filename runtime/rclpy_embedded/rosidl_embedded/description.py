"""Type descriptions: RIHS01 hashes and definition texts."""

import json
from functools import cache
from hashlib import sha256
from typing import Any

from . import catalogue
from . import definition as d

# type_description_interfaces/msg/FieldType: numbers of single values, and what an array or sequence adds.
_TYPE_IDS: dict[type, int] = {
    d.NamespacedType: 1,
    d.UnboundedString: 17,
    d.UnboundedWString: 18,
    d.BoundedString: 21,
    d.BoundedWString: 22,
}
_NESTED_IDS: dict[type, int] = {d.Array: 48, d.BoundedSequence: 96, d.UnboundedSequence: 144}
# What stands for the fields of an empty structure.
_EMPTY = (d.Member("structure_needs_at_least_one_member", d.BasicType("uint8")),)


@cache
def type_hash(type_name: str) -> str:
    """RIHS01 hash of a message, a service, an action or a part of one (REP 2016); raises like `catalogue.structure`."""
    return "RIHS01_" + sha256(json.dumps(type_description(type_name)).encode()).hexdigest()


def type_description(type_name: str) -> dict[str, Any]:
    """Description of an interface with the members of ``type_description_interfaces/msg/TypeDescription``.

    Default values are left out, as they are from the hash. Raises like `catalogue.structure`.
    """
    main, *referenced = _with_references(type_name)
    return {
        "type_description": _describe(main),
        "referenced_type_descriptions": [_describe(name) for name in sorted(referenced)],
    }


def type_sources(type_name: str) -> list[dict[str, Any]]:
    """Texts of an interface and of what it refers to, as ``type_description_interfaces/msg/TypeSource`` has them."""
    return [
        {"type_name": name, "encoding": encoding, "raw_file_contents": text}
        for name in _with_references(type_name)
        for encoding, text in [catalogue.source(name)]
    ]


@cache
def interface_definition(type_name: str) -> str:
    """Text of a message with all that it refers to, as rosbag2 writes it into MCAP schemas (``ros2msg``).

    Parts of services and actions, for which rosbag2 writes nothing, are written like messages.
    """
    main, *referenced = _with_references(type_name)
    text = catalogue.message_text(main)
    for name in referenced:
        package, _, short = name.split("/")
        text += f"\n{'=' * 80}\nMSG: {package}/{short}\n{catalogue.message_text(name)}"
    return text


def _with_references(type_name: str) -> list[str]:
    """Full name of an interface and of all that it refers to, each before its own references, as rosbag2 has them."""
    found: list[str] = []

    def add(name: str) -> None:
        if name not in found:
            found.append(name)
            for reference in catalogue.structure(name).references():
                add(reference)

    add("/".join(catalogue.split_name(type_name)))
    return found


def _describe(type_name: str) -> dict[str, Any]:
    fields = catalogue.structure(type_name).fields or _EMPTY
    return {"type_name": type_name, "fields": [_describe_field(field) for field in fields]}


def _describe_field(field: d.Member) -> dict[str, Any]:
    type_, element = field.type, d.element_type(field.type)
    type_id = element.traits.type_id if isinstance(element, d.BasicType) else _TYPE_IDS[type(element)]
    capacity = type_.size if isinstance(type_, d.Array) else 0
    return {
        "name": field.name,
        "type": {
            "type_id": type_id + _NESTED_IDS.get(type(type_), 0),
            "capacity": type_.maximum_size if isinstance(type_, d.BoundedSequence) else capacity,
            "string_capacity": element.maximum_size if isinstance(element, d.BoundedString | d.BoundedWString) else 0,
            "nested_type_name": element.type_name if isinstance(element, d.NamespacedType) else "",
        },
    }
