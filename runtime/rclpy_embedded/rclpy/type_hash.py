"""Hashes of interface definitions."""

from __future__ import annotations

import re
from dataclasses import dataclass

_SIZE = 32


@dataclass(slots=True)
class TypeHash:
    """Version and value of a hash; version -1 means none."""

    version: int = -1
    value: bytes = bytes(_SIZE)

    @classmethod
    def from_string(cls, text: str | None) -> TypeHash:
        """Read ``RIHS01_<64 hex digits>``; anything else gives an invalid hash."""
        match = re.fullmatch(r"RIHS(\d\d)_([0-9a-f]{64})", text or "")
        return cls(int(match[1]), bytes.fromhex(match[2])) if match else cls()

    def __str__(self) -> str:
        if self.version <= 0 or len(self.value) != _SIZE:
            return "INVALID"
        return f"RIHS{self.version:02}_{self.value.hex()}"
