"""Structs of a C library for ctypes, read from its header itself, so that they cannot differ."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable, Iterator
from math import prod
from pathlib import Path
from typing import Any, TypeVar

Struct = TypeVar("Struct", bound=ctypes.Structure)

_DECLARATION = re.compile(r"(?:const )?(\w+)\s+(.+)", re.DOTALL)
_DECLARATOR = re.compile(r"(\*?)(\w+)((?:\[.+?\])*)")


class Header:
    """A C header: sizes as ``#define NAME product``, structs as ``typedef struct {...} name;``.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    defined : dict of str to str
        Text of each ``#define``.
    """

    def __init__(self, path: Path) -> None:
        text = re.sub(r"\s*/\*.*?\*/", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
        self._name = path.name
        self.defined: dict[str, str] = dict(re.findall(r"#define (\w+)[ \t]+(.+)", text))
        self._bodies = {name: body for body, name in re.findall(r"typedef struct \{(.*?)\} (\w+);", text, re.DOTALL)}
        self._types: dict[str, Any] = {"int": ctypes.c_int, "double": ctypes.c_double}

    def size(self, text: str) -> int:
        """Value of a size in the header: a product of numbers and names."""
        factors = (word.strip() for word in text.strip("() ").split("*"))
        return prod(int(word) if word.isdigit() else self.size(self.defined[word]) for word in factors)

    def _fields(self, name: str) -> Iterator[tuple[str, Any]]:
        for declaration in self._bodies[name].split(";")[:-1]:
            found = _DECLARATION.fullmatch(declaration.strip())
            if found is None:
                raise ValueError(f"{self._name}: cannot read '{declaration.strip()}' of {name}")
            if found[1] not in self._types:
                return
            for star, field, dimensions in _DECLARATOR.findall(found[2]):
                kind = ctypes.POINTER(self._types[found[1]]) if star else self._types[found[1]]
                for length in reversed(re.findall(r"\[(.+?)\]", dimensions)):
                    kind = kind * self.size(length)
                yield field, kind

    def struct(self, name: str) -> Callable[[type[Struct]], type[Struct]]:
        """Class decorator that fills in the fields of a struct.

        They end before the first of a type that was not read before and so is not part of the interface.

        Raises
        ------
        ValueError
            If a declaration cannot be read.
        """

        def read(struct: type[Struct]) -> type[Struct]:
            struct._fields_ = list(self._fields(name))
            self._types[name] = struct
            return struct

        return read
