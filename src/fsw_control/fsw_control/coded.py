"""Enums that travel in messages as numbers."""

from __future__ import annotations

from enum import IntEnum
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
