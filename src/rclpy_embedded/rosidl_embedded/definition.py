"""What an interface is made of: types, fields, constants, structures and services.

The type classes carry the names and attributes of ``rosidl_parser.definition``, because message classes show them in
``SLOT_TYPES``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

# Code and size of each basic type, as modules struct, array and numpy have it.
CODES = {
    "boolean": ("?", 1),
    "octet": ("c", 1),
    "int8": ("b", 1),
    "uint8": ("B", 1),
    "int16": ("h", 2),
    "uint16": ("H", 2),
    "int32": ("i", 4),
    "uint32": ("I", 4),
    "int64": ("q", 8),
    "uint64": ("Q", 8),
    "float": ("f", 4),
    "double": ("d", 8),
}
# Elements that Python messages keep in numpy arrays (fixed size) or array.array (sequences) instead of lists.
PACKED = frozenset(CODES) - {"boolean", "octet"}
EMPTY_STRUCTURE_REQUIRED_MEMBER_NAME = "structure_needs_at_least_one_member"


class InvalidInterfaceError(ValueError):
    """An interface definition cannot be understood; the message says which, where and why."""


class UnknownInterfaceError(LookupError):
    """No definition of an interface could be found."""


class AbstractType:
    """Base of all types."""


class AbstractNestableType(AbstractType):
    """A type that may be the element of an array or a sequence."""


@dataclass(frozen=True)
class BasicType(AbstractNestableType):
    """A number, boolean or octet, under its IDL name (``double``, ``boolean``, ``octet``, ``uint8`` ...)."""

    typename: str


class AbstractGenericString(AbstractNestableType):
    """Any string."""

    maximum_size: int | None = None

    def has_maximum_size(self) -> bool:
        """Tell whether the string is bounded."""
        return self.maximum_size is not None


class AbstractString(AbstractGenericString):
    """A string of bytes, UTF-8."""


class AbstractWString(AbstractGenericString):
    """A string of UTF-16 code units."""


@dataclass(frozen=True)
class UnboundedString(AbstractString):
    """``string``."""


@dataclass(frozen=True)
class BoundedString(AbstractString):
    """``string<=N``."""

    maximum_size: int


@dataclass(frozen=True)
class UnboundedWString(AbstractWString):
    """``wstring``."""


@dataclass(frozen=True)
class BoundedWString(AbstractWString):
    """``wstring<=N``."""

    maximum_size: int


@dataclass(frozen=True)
class NamespacedType(AbstractNestableType):
    """Another structure: ``NamespacedType(['std_msgs', 'msg'], 'Header')``."""

    namespaces: list[str]
    name: str

    @property
    def type_name(self) -> str:
        """Full name, ``std_msgs/msg/Header``."""
        return "/".join((*self.namespaces, self.name))


@dataclass(frozen=True)
class AbstractNestedType(AbstractType):
    """Several values of one type."""

    value_type: AbstractNestableType


@dataclass(frozen=True)
class Array(AbstractNestedType):
    """``type[N]``."""

    size: int


class AbstractSequence(AbstractNestedType):
    """A sequence, bounded or not."""


@dataclass(frozen=True)
class BoundedSequence(AbstractSequence):
    """``type[<=N]``."""

    maximum_size: int


@dataclass(frozen=True)
class UnboundedSequence(AbstractSequence):
    """``type[]``."""


@dataclass(frozen=True)
class Constant:
    """A named value of a structure; octets are ``bytes`` of length one."""

    name: str
    type: AbstractNestableType
    value: Any


@dataclass(frozen=True)
class Field:
    """A member of a structure; `default` is None where the definition gives none."""

    name: str
    type: AbstractType
    default: Any = None


@dataclass(frozen=True)
class Structure:
    """A message, or the request, response or event of a service."""

    type_name: str
    fields: tuple[Field, ...] = ()
    constants: tuple[Constant, ...] = ()

    def references(self) -> list[str]:
        """Names of the structures that the fields are made of, in order of first use."""
        found: dict[str, None] = {}
        for field in self.fields:
            element = element_type(field.type)
            if isinstance(element, NamespacedType):
                found[element.type_name] = None
        return list(found)


def element_type(type_: AbstractType) -> AbstractType:
    """Type of the elements of an array or sequence, or the type itself."""
    return type_.value_type if isinstance(type_, AbstractNestedType) else type_


def namespaced(type_name: str) -> NamespacedType:
    """Make the type of ``'std_msgs/msg/Header'``."""
    *namespaces, name = type_name.split("/")
    return NamespacedType(namespaces, name)
