"""Optional dependencies (extras) of the distributions, and their installation on demand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module, invalidate_caches
from importlib.util import find_spec
from typing import Any

from fsw_control.schema.models import InputError

#: installs the extra of a name into this environment; set by a clone of the repository
#: (scripts/_bootstrap.py)
install: Callable[[str], None] | None = None


class MissingExtraError(InputError):
    """A module of an extra is not installed; the text says how to install it."""


@dataclass(frozen=True, slots=True)
class Extra:
    """An extra of a distribution, and the modules that show whether it is installed."""

    distribution: str
    name: str
    modules: tuple[str, ...]

    def missing(self) -> list[str]:
        """Missing modules, after an attempt to install them if that is possible."""
        if self._absent() and install is not None:
            install(self.name)
            invalidate_caches()
        return self._absent()

    def need(self, what: str) -> None:
        """Ensure that it is installed.

        Raises
        ------
        MissingExtraError
            If it is not; ``what`` begins the text.
        """
        if absent := self.missing():
            verb = "is" if len(absent) == 1 else "are"
            text = (
                f"{what}: {', '.join(absent)} {verb} missing: "
                f"pip install '{self.distribution}[{self.name}]'"
            )
            raise MissingExtraError(text)

    def module(self, name: str, what: str) -> Any:
        """Return one of its modules; errors as in :meth:`need`."""
        self.need(what)
        return import_module(name)

    def _absent(self) -> list[str]:
        return [name for name in self.modules if find_spec(name) is None]
