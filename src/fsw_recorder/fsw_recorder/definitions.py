"""Decodes messages by their ``ros2msg`` definition, without ROS and without message classes."""

from __future__ import annotations

from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from fsw_recorder.errors import BagError


class Definitions:
    """Definitions met so far, parsed once each."""

    def __init__(self) -> None:
        self._stores: dict[tuple[str, str], Any] = {}

    def decode(self, type_name: str, definition: str, data: bytes) -> Any:
        """One message, with its fields as attributes; a `BagError` when it does not follow its definition."""
        store = self.typestore(type_name, definition)
        try:
            return store.deserialize_cdr(data, type_name)
        except MemoryError:
            raise BagError(f"a message of type {type_name} is damaged: it announces more data than it has") from None
        except Exception as error:  # rosbags lets any exception of its generated code through
            raise BagError(f"a message of type {type_name} is damaged: {error}") from None

    def typestore(self, type_name: str, definition: str) -> Any:
        """Type store of ``rosbags`` that knows only this; a `BagError` when the definition cannot be parsed."""
        key = (type_name, definition)
        if key not in self._stores:
            store = get_typestore(Stores.EMPTY)
            try:
                store.register(get_types_from_msg(definition, type_name))
                store.generate_msgdef(type_name, ros_version=2)  # refuses names of types that are not defined
            except Exception as error:  # rosbags' parser raises many kinds
                raise BagError(f"the definition of {type_name} in the bag cannot be parsed: {error}") from None
            self._stores[key] = store
        return self._stores[key]
