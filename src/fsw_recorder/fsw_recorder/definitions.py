"""Decodes and encodes messages by their ``ros2msg`` definition, without ROS or message classes.

Also definition, hash and class of an installed interface.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from fsw_recorder.errors import BagError
from fsw_recorder.topic import RecordedTopic

_SEPARATOR = "=" * 80
_FIELD = re.compile(r"^\s*([A-Za-z][\w/]*)(?:<=\d+)?(?:\[[^\]]*\])?\s+\w+", re.MULTILINE)
_PRIMITIVES = frozenset(
    ["bool", "byte", "char", "float32", "float64", "string", "wstring"]
    + [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
)


@cache
def interface_definition(type_name: str) -> str:
    """``ros2msg`` text of a message type with all nested types, as rosbag2's; empty if unknown."""
    return _definition(type_name) or ""


@cache
def interface_hash(type_name: str) -> str:
    """``RIHS01_...`` hash of an interface; empty if unknown."""
    definition = _definition(type_name)
    try:
        return (
            ""
            if definition is None
            else str(Definitions().typestore(type_name, definition).hash_rihs01(type_name))
        )
    except Exception:  # a kind that rosbags cannot describe
        return ""


def definition_of(topic: RecordedTopic) -> str:
    """``ros2msg`` text of a topic's type: from the bag, or the installed one if that is unusable.

    Bags of Foxy and Humble in sqlite3 have none, and others may have an empty schema or IDL.

    Raises
    ------
    BagError
        If neither exists, or the installed one is another version by its hash.
    """
    if topic.encoding != "cdr":
        raise BagError(f"its encoding {topic.encoding!r} is not CDR")
    if topic.definition and topic.definition_encoding == "ros2msg":
        return topic.definition
    installed = interface_definition(topic.type_name)
    if not installed:
        name = topic.type_name or "its type"
        raise BagError(
            f"the bag holds no definition of {name} that can be read, and none is installed"
        )
    if topic.type_hash and topic.type_hash != interface_hash(topic.type_name):
        raise BagError(
            f"the bag holds no definition of {topic.type_name}, "
            "and the installed one is another version"
        )
    return installed


def message_class(type_name: str) -> Any:
    """Message class of a type; a `BagError` if it is not installed."""
    try:
        package, kind, name = type_name.split("/")
        return getattr(import_module(f"{package}.{kind}"), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise BagError(f"its type {type_name} is not installed here: {error}") from None


def _share(package: str) -> Path:
    """Folder of a package's definitions: in a sourced ROS 2, or in this environment's wheels."""
    prefixes = [
        *filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)),
        sys.prefix,
    ]
    folders = [Path(prefix) / "share" / package for prefix in prefixes]
    return next((folder for folder in folders if folder.is_dir()), folders[-1])


def _definition(type_name: str) -> str | None:
    """As `interface_definition`, but None if unknown."""
    parts = type_name.split("/")
    name = f"{parts[0]}/{parts[-1]}"
    seen = {name}

    def text_of(short_name: str) -> str:
        package, name = short_name.split("/")
        text = (_share(package) / "msg" / f"{name}.msg").read_text(encoding="utf-8")
        for match in _FIELD.finditer(re.sub(r"#.*", "", text)):
            nested = match[1] if "/" in match[1] else f"{package}/{match[1]}"
            if match[1] not in _PRIMITIVES and nested not in seen:
                seen.add(nested)
                text += f"\n{_SEPARATOR}\nMSG: {nested}\n{text_of(nested)}"
        return text

    try:
        return text_of(name)
    except (OSError, ValueError):  # messages of an unknown type are recorded without a definition
        return None


class Definitions:
    """Cache of parsed definitions."""

    def __init__(self) -> None:
        self._stores: dict[tuple[str, str], Any] = {}

    def decode(self, type_name: str, definition: str, data: bytes) -> Any:
        """Decode a message, fields as attributes; a `BagError` if it violates its definition."""
        store = self.typestore(type_name, definition)
        try:
            return store.deserialize_cdr(data, type_name)
        except MemoryError:
            raise BagError(
                f"a message of type {type_name} is damaged: it announces more data than it has"
            ) from None
        except Exception as error:  # rosbags passes on any exception of its generated code
            raise BagError(f"a message of type {type_name} is damaged: {error}") from None

    def encode(self, type_name: str, definition: str, values: Mapping[str, Any]) -> bytes:
        """Encode a message as CDR; ``values`` by field (nested: mappings), others are zero."""
        store = self.typestore(type_name, definition)
        return bytes(store.serialize_cdr(_built(store, type_name, values), type_name))

    def typestore(self, type_name: str, definition: str) -> Any:
        """Type store of ``rosbags`` with this type only; a `BagError` if it cannot be parsed."""
        key = (type_name, definition)
        if key not in self._stores:
            store = get_typestore(Stores.EMPTY)
            try:
                store.register(get_types_from_msg(definition, type_name))
                store.generate_msgdef(
                    type_name, ros_version=2
                )  # refuses names of types that are not defined
            except Exception as error:  # rosbags' parser raises many kinds
                raise BagError(
                    f"the definition of {type_name} in the bag cannot be parsed: {error}"
                ) from None
            self._stores[key] = store
        return self._stores[key]


def _built(store: Any, type_name: str, values: Mapping[str, Any]) -> Any:
    arguments: dict[str, Any] = {}
    for name, (kind, detail) in store.fielddefs[type_name][1]:
        value = values.get(name)
        if kind.name == "BASE":
            zero: Any = "" if detail[0] == "string" else False if detail[0] == "bool" else 0
            arguments[name] = zero if value is None else value
        elif kind.name == "NAME":
            arguments[name] = _built(store, detail, value or {})
        elif detail[0][0].name == "NAME":
            arguments[name] = [_built(store, detail[0][1], element) for element in value or []]
        elif detail[0][1][0] == "string":
            arguments[name] = list(value or [])
        else:
            arguments[name] = np.array(value if value is not None else [], dtype=detail[0][1][0])
    return store.types[type_name](**arguments)
