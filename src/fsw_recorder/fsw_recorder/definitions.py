"""Decodes and encodes messages by their ``ros2msg`` definition, without ROS or message classes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from fsw_recorder.errors import BagError


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
        given = values.get(name)
        if kind.name == "BASE":
            zero: Any = "" if detail[0] == "string" else False if detail[0] == "bool" else 0
            arguments[name] = zero if given is None else given
        elif kind.name == "NAME":
            arguments[name] = _built(store, detail, given or {})
        elif detail[0][0].name == "NAME":
            arguments[name] = [_built(store, detail[0][1], one) for one in given or []]
        elif detail[0][1][0] == "string":
            arguments[name] = list(given or [])
        else:
            arguments[name] = np.array(given if given is not None else [], dtype=detail[0][1][0])
    return store.types[type_name](**arguments)
