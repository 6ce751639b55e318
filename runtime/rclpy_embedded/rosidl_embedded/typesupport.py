"""Message and service classes for a middleware: names, type hashes, serialization."""

import struct
from functools import cache, cached_property
from io import BytesIO
from typing import Any

from .cdr import HEADER_SIZE, Codec
from .description import interface_definition as interface_definition
from .description import type_hash as type_hash
from .message import get_interface as get_interface
from .message import get_message as get_message

# Plain CDR, little-endian.
_HEADER = b"\x00\x01\x00\x00"
# Writers pad a payload to a multiple of 4 bytes.
_MAX_PADDING = 3


class SerializationError(ValueError):
    """A message holds values that its type does not allow."""


class DeserializationError(ValueError):
    """Received bytes are not the encoding of the message type."""


class TypeSupport:
    """Type support of one message class, of which `dds_name` is ``std_msgs::msg::dds_::String_``."""

    def __init__(self, cls: Any) -> None:
        self.cls = cls
        self.type_name: str = cls._TYPE_NAME
        package, kind, name = self.type_name.split("/")
        self.dds_name = f"{package}::{kind}::dds_::{name}_"

    @property
    def type_hash(self) -> str:
        """RIHS01 hash of the type's description."""
        return type_hash(self.type_name)

    @cached_property
    def _codec(self) -> Codec:
        return Codec(self.type_name)

    @cached_property
    def _encode(self) -> Any:
        return self._codec.compile("encode")

    @cached_property
    def _decode(self) -> Any:
        return self._codec.compile("decode")

    def serialize(self, msg: Any, prefix: bytes = b"") -> bytes:
        """Encode a message: 4 byte encapsulation header and CDR, not padded.

        The CDR body begins with `prefix`, a multiple of 8 bytes (header of service calls). Raises SerializationError if
        a field holds a value of a wrong type or length.
        """
        if msg.__class__ is not self.cls and not isinstance(msg, self.cls):
            raise SerializationError(f"expected a message of type {self.type_name}, not {type(msg).__name__}")
        # Unlike a bytearray, which would be copied at the end, this returns its buffer.
        stream = BytesIO()
        stream.write(_HEADER + prefix)
        try:
            self._encode(msg, stream.write, stream.tell)
        except (AttributeError, OverflowError, TypeError, ValueError, struct.error) as error:
            raise SerializationError(f"cannot serialize {self.type_name}: {error}") from error
        return stream.getvalue()

    def deserialize(self, data: bytes | memoryview) -> Any:
        """Decode a message; up to three bytes of padding at the end are accepted; see `deserialize_with_prefix`."""
        return self.deserialize_with_prefix(data, 0)[1]

    def deserialize_with_prefix(self, data: bytes | memoryview, size: int) -> tuple[bytes, Any]:
        """Decode a message whose CDR body begins with a prefix of `size` bytes, a multiple of 8: (prefix, message).

        Raises DeserializationError if the data are not the encoding of such a message.
        """
        if data.__class__ is not bytes:
            data = bytes(data)
        if data[:2] != _HEADER[:2]:
            encapsulation = data[:2].hex() or "missing"
            text = f"encapsulation {encapsulation}, only little-endian plain CDR is supported"
            raise DeserializationError(f"not a {self.type_name}: {text}")
        start = HEADER_SIZE + size
        try:
            msg, end = self._decode(data, start)
        except (IndexError, ValueError, struct.error) as error:
            raise DeserializationError(f"{len(data)} bytes are not a {self.type_name}: {error}") from error
        surplus = len(data) - end
        if not 0 <= surplus <= _MAX_PADDING:
            raise DeserializationError(f"{len(data)} bytes are not a {self.type_name}: {surplus} bytes too many")
        return data[HEADER_SIZE:start], msg


@cache
def type_support(cls: Any) -> TypeSupport:
    """Type support of a message class; TypeError if `cls` is not a class of this package."""
    if not (hasattr(cls, "_TYPE_NAME") and hasattr(cls, "__slots__")):
        raise TypeError(f"{cls!r} is not a message class, such as the ones that 'pkg.msg' modules hold")
    return TypeSupport(cls)
