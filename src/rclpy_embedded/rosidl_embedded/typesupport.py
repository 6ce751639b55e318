"""What a middleware needs to know of a message or service class: names, type hash, and the way to bytes and back."""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache, cached_property
from typing import Any

from .cdr import HEADER_SIZE, NATIVE, make_decoder, make_encoder
from .description import interface_definition as interface_definition
from .description import type_hash as type_hash
from .message import get_message as get_message
from .message import get_service as get_service

_HEADER = b"\x00\x01\x00\x00" if NATIVE == "<" else bytes(4)
_ORDERS = {b"\x00\x01": "<", b"\x00\x00": ">"}
# Writers pad a payload to a multiple of 4 bytes.
_MAX_PADDING = 3


class SerializationError(ValueError):
    """A message holds values that its type does not allow."""


class DeserializationError(ValueError):
    """Received bytes are not the encoding of the message type."""


class TypeSupport:
    """Type support of one message class.

    Attributes
    ----------
    cls : type
        The message class.
    type_name : str
        ``std_msgs/msg/String``.
    dds_name : str
        ``std_msgs::msg::dds_::String_``.
    type_hash : str
        ``RIHS01_`` and 64 hexadecimal digits.
    """

    def __init__(self, cls: Any) -> None:
        self.cls = cls
        self.type_name: str = cls._TYPE_NAME
        package, kind, name = self.type_name.split("/")
        self.dds_name = f"{package}::{kind}::dds_::{name}_"
        self._decoders: dict[bytes, Callable[[bytes, int], tuple[Any, int]]] = {}

    @cached_property
    def type_hash(self) -> str:
        """RIHS01 hash of the type's description."""
        return type_hash(self.type_name)

    @cached_property
    def _encode(self) -> Callable[[Any, bytearray], None]:
        return make_encoder(self.type_name)

    def serialize(self, msg: Any) -> bytes:
        """Encode a message: 4 byte encapsulation header and CDR, not padded; see `serialize_with_prefix`."""
        return self.serialize_with_prefix(b"", msg)

    def serialize_with_prefix(self, prefix: bytes, msg: Any) -> bytes:
        """Encode a message whose CDR body begins with `prefix`, a multiple of 8 bytes (header of service calls).

        Raises
        ------
        SerializationError
            If a field holds a value of a wrong type or length.
        """
        if msg.__class__ is not self.cls and not isinstance(msg, self.cls):
            raise SerializationError(f"expected a message of type {self.type_name}, not {type(msg).__name__}")
        data = bytearray(_HEADER + prefix)
        try:
            self._encode(msg, data)
        except (AttributeError, OverflowError, TypeError, ValueError, struct.error) as error:
            raise SerializationError(f"cannot serialize {self.type_name}: {error}") from error
        return bytes(data)

    def deserialize(self, data: bytes | memoryview) -> Any:
        """Decode a message; up to three bytes of padding at the end are accepted; see `deserialize_with_prefix`."""
        return self.deserialize_with_prefix(data, 0)[1]

    def deserialize_with_prefix(self, data: bytes | memoryview, size: int) -> tuple[bytes, Any]:
        """Decode a message whose CDR body begins with a prefix of `size` bytes, a multiple of 8: (prefix, message).

        Raises
        ------
        DeserializationError
            If the data are not the encoding of such a message.
        """
        if data.__class__ is not bytes:
            data = bytes(data)
        start = HEADER_SIZE + size
        try:
            decode = self._decoders[data[:2]]
        except KeyError:
            decode = self._decoder(data[:2])
        try:
            msg, end = decode(data, start)
        except (IndexError, ValueError, struct.error) as error:
            raise DeserializationError(f"{len(data)} bytes are not a {self.type_name}: {error}") from error
        if not 0 <= len(data) - end <= _MAX_PADDING:
            surplus = len(data) - end
            raise DeserializationError(f"{len(data)} bytes are not a {self.type_name}: {surplus} bytes too many")
        return data[HEADER_SIZE:start], msg

    def _decoder(self, encapsulation: bytes) -> Callable[[bytes, int], tuple[Any, int]]:
        order = _ORDERS.get(encapsulation)
        if order is None:
            raise DeserializationError(
                f"not a {self.type_name}: encapsulation {encapsulation.hex() or 'missing'}, only plain CDR is supported"
            )
        decoder = self._decoders[encapsulation] = make_decoder(self.type_name, order)
        return decoder


class ServiceTypeSupport:
    """Type support of a service class: that of request and response; names as in `TypeSupport`."""

    def __init__(self, cls: Any) -> None:
        self.cls = cls
        self.type_name: str = cls._TYPE_NAME
        self.request = type_support(cls.Request)
        self.response = type_support(cls.Response)

    @cached_property
    def type_hash(self) -> str:
        """RIHS01 hash of the service's description."""
        return type_hash(self.type_name)


@cache
def type_support(cls: Any) -> TypeSupport:
    """Type support of a message class; TypeError if `cls` is none of this package."""
    _require(cls, "message", "__slots__")
    return TypeSupport(cls)


@cache
def service_type_support(cls: Any) -> ServiceTypeSupport:
    """Type support of a service class; TypeError if `cls` is none of this package."""
    _require(cls, "service", "Request")
    return ServiceTypeSupport(cls)


def _require(cls: Any, what: str, attribute: str) -> None:
    if not (hasattr(cls, "_TYPE_NAME") and hasattr(cls, attribute)):
        raise TypeError(f"{cls!r} is not a {what} class, such as the ones that 'pkg.{what[:3]}' modules hold")
