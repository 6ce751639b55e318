"""Extras of the distributions: what only some commands and nodes need, and who installs it where it is missing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module, invalidate_caches
from importlib.util import find_spec
from typing import Any

from fsw_schema.models import InputError

#: installs the extra of a name into this environment; a clone of the repository sets it
#: (scripts/_bootstrap.py)
install: Callable[[str], None] | None = None


class MissingExtraError(InputError):
    """A module of an extra is not installed; the text says how to install it."""


@dataclass(frozen=True, slots=True)
class Extra:
    """An extra of a distribution, and the modules by which it is recognised."""

    distribution: str
    name: str
    modules: tuple[str, ...]

    def missing(self) -> list[str]:
        """Modules that are not there, after an attempt to install them where that is possible."""
        if self._absent() and install is not None:
            install(self.name)
            invalidate_caches()
        return self._absent()

    def need(self, what: str) -> None:
        """Do nothing if it is installed.

        Raises
        ------
        MissingExtraError
            It is not; ``what`` begins the text.
        """
        if absent := self.missing():
            verb = "is" if len(absent) == 1 else "are"
            text = f"{what}: {', '.join(absent)} {verb} missing: pip install '{self.distribution}[{self.name}]'"
            raise MissingExtraError(text)

    def module(self, name: str, what: str) -> Any:
        """One of its modules; errors as :meth:`need`."""
        self.need(what)
        return import_module(name)

    def _absent(self) -> list[str]:
        return [name for name in self.modules if find_spec(name) is None]
