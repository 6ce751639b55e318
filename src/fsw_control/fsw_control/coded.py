"""Enums that travel as numbers, and codes with a text for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import EnumType, IntEnum, StrEnum
from typing import Any, NamedTuple, Self


class Coded(IntEnum):
    """Base of enums with a member ``UNKNOWN``, which stands for numbers of later versions.

    Members are ``NAME = number`` or ``NAME = number, words``: a text for people.
    """

    words: str

    def __new__(cls, value: int, words: str = "") -> Self:
        """Create a member with its text."""
        code = int.__new__(cls, value)
        code._value_, code.words = value, words
        return code

    @classmethod
    def _missing_(cls, value: object) -> Self:
        return cls["UNKNOWN"]

    @property
    def word(self) -> str:
        """Its name in small letters."""
        return self.name.lower()


class _NamedByMember(EnumType):
    """Gives a member that is only a text its name in small letters as value."""

    def __new__(
        cls, name: str, bases: tuple[type, ...], body: Mapping[str, Any], **options: Any
    ) -> _NamedByMember:
        """Create the enum."""
        named = cls.__prepare__(name, bases, **options)
        for key, item in body.items():
            is_text = key.isupper() and isinstance(item, str)
            named[key] = (key.lower(), item) if is_text else item
        return super().__new__(cls, name, bases, named, **options)


class Worded(StrEnum, metaclass=_NamedByMember):
    """Base of codes with a text for people, which names the fields of the fact in braces.

    Members are ``NAME = words``, with the value ``name``, or ``NAME = value, words``.
    """

    words: str

    def __new__(cls, value: str, words: str) -> Self:
        """Create a code with its text."""
        code = str.__new__(cls, value)
        code._value_, code.words = value, words
        return code


class Fact(NamedTuple):
    """A code with its fields: names, figures, reasons or other facts."""

    code: Worded
    data: Mapping[str, Any]

    @classmethod
    def of(cls, code: Worded, /, **data: Any) -> Fact:
        """Return the fact with these fields."""
        return cls(code, data)

    @property
    def words(self) -> str:
        """The fact in words."""
        return self.code.words.format_map({key: _plain(item) for key, item in self.data.items()})


class RefusedError(ValueError):
    """A refusal, with its reason as a fact."""

    def __init__(self, fact: Fact) -> None:
        super().__init__(fact.words)
        self.fact = fact

    @classmethod
    def of(cls, code: Worded, /, **data: Any) -> RefusedError:
        """Return the error of this fact."""
        return cls(Fact(code, data))


class _Several(Worded):
    """A code for several facts."""

    SEVERAL = "{facts}"


def several(facts: Sequence[Fact]) -> Fact | None:
    """One fact for all of them; None if there is none."""
    if len(facts) < 2:
        return facts[0] if facts else None
    return Fact.of(_Several.SEVERAL, facts=tuple(facts))


def _plain(item: Any) -> Any:
    if type(item) is not tuple:
        return item
    if item and isinstance(item[0], Fact):
        return "; ".join(fact.words for fact in item)
    return ", ".join(map(str, item)) or "none"


class Answer(NamedTuple):
    """Answer to an operator's request."""

    ok: bool
    fact: Fact

    @classmethod
    def done(cls, code: Worded, /, **data: Any) -> Answer:
        """Return the answer to a request that is served."""
        return cls(True, Fact(code, data))

    @classmethod
    def refused(cls, code: Worded, /, **data: Any) -> Answer:
        """Return the answer to a request that is refused."""
        return cls(False, Fact(code, data))
