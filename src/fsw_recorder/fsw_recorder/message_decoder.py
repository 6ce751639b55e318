"""Decodes recorded messages with the message classes that are installed, or from the definition in the bag."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from fsw_recorder.errors import BagError

#: type name and serialized message to message object; raises any exception when it cannot
DecodeHook = Callable[[str, bytes], Any]


def installed_decoder() -> DecodeHook | None:
    """Decoder that yields the installed message classes; None where there is no ROS and no embedded runtime."""
    try:
        from rclpy.serialization import deserialize_message
        from rosidl_runtime_py.utilities import get_message
    except ImportError:
        try:
            from rosidl_embedded.typesupport import get_message, type_support
        except ImportError:
            return None
        return lambda type_name, data: type_support(get_message(type_name)).deserialize(data)
    classes: dict[str, Any] = {}

    def decode(type_name: str, data: bytes) -> Any:
        if type_name not in classes:
            classes[type_name] = get_message(type_name)
        return deserialize_message(data, classes[type_name])

    return decode


class SchemaDecoder:
    """Decodes from the ``ros2msg`` definition that the bag carries; the result has the fields as attributes.

    Needs neither ROS nor the message package, so foreign bags can be read.
    """

    def __init__(self) -> None:
        self._stores: dict[tuple[str, str], Any] = {}

    def decode(self, type_name: str, schema_text: str, data: bytes) -> Any:
        """Decode one message.

        Raises
        ------
        BagError
            The definition cannot be parsed or the data does not follow it.
        """
        store = self.typestore(type_name, schema_text)
        try:
            return store.deserialize_cdr(data, type_name)
        except MemoryError:
            raise BagError(f"a message of type {type_name} is damaged: it announces more data than it has") from None
        except Exception as error:  # rosbags lets any exception of its generated code through
            raise BagError(f"a message of type {type_name} is damaged: {error}") from None

    def typestore(self, type_name: str, schema_text: str) -> Any:
        """Type store of ``rosbags`` that knows the definition (and nothing else).

        Raises
        ------
        BagError
            The definition cannot be parsed.
        """
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        key = (type_name, schema_text)
        if key not in self._stores:
            store = get_typestore(Stores.EMPTY)
            try:
                store.register(get_types_from_msg(schema_text, type_name))
                _check_types(store.fielddefs, type_name, ())
            except Exception as error:  # rosbags' parser raises many kinds
                raise BagError(f"the definition of {type_name} in the bag cannot be parsed: {error}") from None
            self._stores[key] = store
        return self._stores[key]


def _check_types(fields: Mapping[str, Any], type_name: str, inside: tuple[str, ...]) -> None:
    """Refuse definitions that name unknown types or contain themselves."""
    if type_name not in fields:
        raise ValueError(f"{type_name} is not defined")
    if type_name in inside:
        raise ValueError(f"{type_name} contains itself")
    for _, (kind, detail) in fields[type_name][1]:
        if kind.name in ("ARRAY", "SEQUENCE"):
            kind, detail = detail[0]
        if kind.name == "NAME":
            _check_types(fields, detail, (*inside, type_name))
