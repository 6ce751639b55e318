"""What an interface is made of: types, fields, constants and structures.

The type classes have the names and attributes of ``rosidl_parser.definition``; messages show them in ``SLOT_TYPES``.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple


class Traits(NamedTuple):
    """A basic type: code for struct, array and numpy; class of a value; number in ``FieldType`` messages."""

    code: str
    size: int
    python: str
    type_id: int


TRAITS = {
    "int8": Traits("b", 1, "int", 2),
    "uint8": Traits("B", 1, "int", 3),
    "int16": Traits("h", 2, "int", 4),
    "uint16": Traits("H", 2, "int", 5),
    "int32": Traits("i", 4, "int", 6),
    "uint32": Traits("I", 4, "int", 7),
    "int64": Traits("q", 8, "int", 8),
    "uint64": Traits("Q", 8, "int", 9),
    "float": Traits("f", 4, "float", 10),
    "double": Traits("d", 8, "float", 11),
    "boolean": Traits("?", 1, "bool", 15),
    "octet": Traits("c", 1, "bytes", 16),
}
INTEGER_RANGES: dict[str, tuple[int, int]] = {
    **{f"int{n}": (-(2 ** (n - 1)), 2 ** (n - 1) - 1) for n in (8, 16, 32, 64)},
    **{f"uint{n}": (0, 2**n - 1) for n in (8, 16, 32, 64)},
}


class InvalidInterfaceError(ValueError):
    """An interface definition cannot be understood; the message says which, where and why."""


class UnknownInterfaceError(LookupError):
    """No definition of an interface could be found."""


class AbstractType:
    """Base of all types."""


@dataclass(frozen=True)
class BasicType(AbstractType):
    """A number, boolean or octet, under its IDL name (``double``, ``boolean``, ``octet``, ``uint8`` ...)."""

    typename: str

    @property
    def traits(self) -> Traits:
        """Code, size, class and number of the type."""
        return TRAITS[self.typename]

    @property
    def is_number(self) -> bool:
        """Whether messages keep several values in a numpy array (fixed size) or array.array (sequence), not a list."""
        return self.traits.python in ("int", "float")


@dataclass(frozen=True)
class AbstractGenericString(AbstractType):
    """Any string."""

    maximum_size: int | None = None


class AbstractWString(AbstractGenericString):
    """A string of UTF-16 code units; the others are UTF-8."""


class UnboundedString(AbstractGenericString):
    """``string``."""


class BoundedString(AbstractGenericString):
    """``string<=N``."""


class UnboundedWString(AbstractWString):
    """``wstring``."""


class BoundedWString(AbstractWString):
    """``wstring<=N``."""


@dataclass(frozen=True)
class NamespacedType(AbstractType):
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

    value_type: AbstractType


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


class UnboundedSequence(AbstractSequence):
    """``type[]``."""


@dataclass(frozen=True)
class Member:
    """A field of a structure with its default (None without one), or a constant; octets are ``bytes`` of length one."""

    name: str
    type: AbstractType
    value: Any = None


@dataclass(frozen=True)
class Structure:
    """A message, or a part of a service or an action."""

    type_name: str
    fields: tuple[Member, ...] = ()
    constants: tuple[Member, ...] = ()

    def values(self) -> dict[str, Any]:
        """Constants and default values by the names that they have in a message class."""
        defaults = {f"{field.name.upper()}__DEFAULT": field.value for field in self.fields}
        constants = {constant.name: constant.value for constant in self.constants}
        return constants | {name: value for name, value in defaults.items() if value is not None}

    def references(self) -> list[str]:
        """Names of the structures that the fields are made of, sorted."""
        elements = (element_type(field.type) for field in self.fields)
        return sorted({element.type_name for element in elements if isinstance(element, NamespacedType)})


def element_type(type_: AbstractType) -> AbstractType:
    """Type of the elements of an array or sequence, or the type itself."""
    return type_.value_type if isinstance(type_, AbstractNestedType) else type_


def python_type(type_: AbstractType) -> str:
    """Name of the Python class of a basic type or string."""
    return type_.traits.python if isinstance(type_, BasicType) else "str"


def namespaced(type_name: str) -> NamespacedType:
    """Make the type of ``'std_msgs/msg/Header'``."""
    *namespaces, name = type_name.split("/")
    return NamespacedType(namespaces, name)
