"""Reads values at a place of a file; goes when the last reader has a model (see fsw_control.schema)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from fsw_control.ranges import Range
from fsw_control.schema import InputError
from fsw_control.yaml_text import load_yaml


@dataclass(frozen=True, slots=True)
class Place:
    """A place in a file of events; reads values there and makes the errors of it.

    Attributes
    ----------
    where : str
        The file.
    path : str
        The place in it, e.g. ``events[2].fault``.
    failure : type
        Of the errors.
    whole : str
        What the file as a whole is called.
    """

    where: str
    path: str = ""
    failure: type[ValueError] = InputError
    whole: str = "scenario"

    def inside(self, name: str) -> Place:
        """A place one step further in."""
        return Place(self.where, f"{self.path}.{name}" if self.path else name, self.failure, self.whole)

    def error(self, problem: str) -> ValueError:
        """The error to raise when something is wrong here."""
        return self.failure(f"{self.where}: {self.path or self.whole} {problem}")

    def yaml(self, text: str) -> Any:
        """Content of YAML text, in which no key is given twice."""
        try:
            return load_yaml(text)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark
            line = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
            raise self.failure(f"{self.where}{line}: not valid YAML: {error.problem or 'broken'}") from None
        except yaml.YAMLError as error:
            raise self.failure(f"{self.where}: not valid YAML: {' '.join(str(error).split())}") from None

    def keys(self, entry: Mapping[Any, Any], known: Sequence[str], required: Sequence[str] = ()) -> None:
        """Refuse unknown and missing keys."""
        unknown = [str(key) for key in entry if key not in known]
        if unknown:
            raise self.error(f"has unknown key {', '.join(unknown)}; known: {', '.join(known)}")
        missing = [key for key in required if key not in entry]
        if missing:
            raise self.error(f"lacks {', '.join(missing)}")

    def mapping(self, entry: Any) -> dict[str, Any]:
        """The entry, if it is a mapping."""
        if not isinstance(entry, dict):
            raise self.error(f"is {entry!r}, not a mapping")
        return entry

    def list(self, entry: Mapping[str, Any], key: str) -> list[Any]:
        """A list in a mapping; empty when it is not there."""
        value = entry.get(key)
        if value is not None and not isinstance(value, list):
            raise self.inside(key).error(f"is {value!r}, not a list")
        return value or []

    def number(self, entry: Mapping[str, Any], key: str, allowed: Range, default: float | None = None) -> float:
        """A number in a mapping, in its range."""
        value = entry.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.inside(key).error(f"is {value!r}, not a number ({allowed})")
        complaint = allowed.complaint(value)
        if complaint:
            raise self.inside(key).error(f"= {complaint}")
        return float(value)

    def optional(self, entry: Mapping[str, Any], key: str, allowed: Range) -> float | None:
        """A number in a mapping, or None when it is not there."""
        return self.number(entry, key, allowed) if key in entry else None

    def word(self, entry: Mapping[str, Any], key: str, default: str | None = None) -> str:
        """A name in a mapping."""
        value = entry.get(key, default)
        if not isinstance(value, str) or not value.replace("_", "a").isalnum() or not value.isascii():
            raise self.inside(key).error(f"is {value!r}, not a name (letters, digits, _)")
        return value

    def choice(self, entry: Mapping[str, Any], key: str, allowed: Sequence[str]) -> str:
        """One of several words in a mapping."""
        value = entry.get(key)
        if value not in allowed:
            raise self.inside(key).error(f"is {value!r}; one of {', '.join(allowed)}")
        return str(value)
