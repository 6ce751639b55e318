"""Entry points registered by distributions, including the user's; optional dependencies.

Groups:

- ``fsw.commands``: modules with commands, by their first word (``bag.info``: another module with
  commands of ``bag``)
- ``fsw.nodes``: functions that run a node
- ``fsw.controllers``: classes of controllers
- ``fsw.processes``: functions that make the heat model of a plant's process
- ``fsw.pages``: functions that return the HTML of a page beside the operator's, from a folder
- ``fsw.record_hooks``: functions of bag and procedure that return the command to run after a
  recording
- ``fsw.schemas``: models of files, by their kind
- ``fsw.api``: public names of ``import fsw``
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module, invalidate_caches, metadata
from importlib.util import find_spec
from typing import Any

from fsw_control.schema.errors import InputError

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
        if self.missing():
            raise MissingExtraError(f"{what}: {self.absence}")

    @property
    def absence(self) -> str:
        """The missing modules, and how to install them."""
        absent = self._absent()
        try:
            metadata.distribution(self.distribution)
            remedy = f"pip install '{self.distribution}[{self.name}]'"
        except metadata.PackageNotFoundError:  # in a colcon workspace pip would ask its index
            remedy = "see docs/how-to/ros2.md"
        return f"{', '.join(absent)} {'is' if len(absent) == 1 else 'are'} missing: {remedy}"

    def module(self, name: str, what: str) -> Any:
        """Return one of its modules; errors as in :meth:`need`."""
        self.need(what)
        return import_module(name)

    def _absent(self) -> list[str]:
        return [name for name in self.modules if find_spec(name) is None]


@cache
def extensions(group: str) -> dict[str, metadata.EntryPoint]:
    """Entry points of a group by name, sorted; identical ones of two distributions appear once.

    Raises
    ------
    fsw_control.schema.models.InputError
        If two distributions give a name different meanings.
    """
    points: dict[str, metadata.EntryPoint] = {}
    for point in sorted(metadata.entry_points(group=group)):
        other = points.setdefault(point.name, point)
        if other.value != point.value:
            both = f"{_words(other)} and {_words(point)}"
            raise InputError(f"{group}: {point.name} is both {both}; uninstall one")
    return points


def loaded(group: str, name: str) -> Any:
    """Load an entry point's object; None if there is no such entry point.

    Raises
    ------
    fsw_control.schema.models.InputError
        If it cannot be imported; the text names its distribution.
    """
    point = extensions(group).get(name)
    if point is None:
        return None
    try:
        return point.load()
    except InputError:
        raise
    except Exception as error:  # a user's module may fail in any way
        text = f"{type(error).__name__}: {error}"
        raise InputError(f"{group}: {name} of {_words(point)}: {text}") from error


def program_path(program: str) -> str:
    """Dotted path of a program's function: a node by its entry point, else a module's ``main``."""
    point = extensions("fsw.nodes").get(program)
    return f"{program}.main" if point is None else f"{point.module}.{point.attr}"


def all_loaded(group: str) -> dict[str, Any]:
    """All objects registered in a group, by name; errors as in :func:`loaded`."""
    return {name: loaded(group, name) for name in extensions(group)}


def _words(point: metadata.EntryPoint) -> str:
    return f"{point.value} ({point.dist.name if point.dist else 'unknown distribution'})"
