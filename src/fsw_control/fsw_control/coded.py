"""Enums that travel as numbers, and codes with a text for people."""

from __future__ import annotations

from enum import IntEnum, StrEnum
from typing import Self


class Coded(IntEnum):
    """Base of enums with a member ``UNKNOWN``, which stands for numbers of later versions."""

    @classmethod
    def _missing_(cls, value: object) -> Self:
        return cls["UNKNOWN"]

    @property
    def word(self) -> str:
        """Its name in small letters."""
        return self.name.lower()


class Worded(StrEnum):
    """Base of codes with a text for people, which names the fields of the fact in braces.

    Members are ``NAME = value, words``.
    """

    words: str

    def __new__(cls, value: str, words: str) -> Self:
        """Create a code with its text."""
        code = str.__new__(cls, value)
        code._value_, code.words = value, words
        return code
