"""Messages to bytes and back."""

from typing import Any

from rosidl_embedded.typesupport import type_support


def serialize_message(message: Any) -> bytes:
    """Return the CDR of a message, with its 4 byte encapsulation header."""
    message_type: Any = type(message)
    return type_support(message_type).serialize(message)


def deserialize_message(serialized_message: bytes, message_type: Any) -> Any:
    """Return the message of a type that `serialized_message` holds; ValueError if the bytes are not one."""
    return type_support(message_type).deserialize(serialized_message)
