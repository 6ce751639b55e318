"""Loads what installed distributions, including the user's, register as entry points.

Groups:

- ``fsw.commands``: modules with commands, by their first word (``bag.info``: another module with
  commands of ``bag``)
- ``fsw.nodes``: functions that run a node
- ``fsw.controllers``: classes of controllers
- ``fsw.processes``: functions that make the heat model of a plant's process
- ``fsw.record_hooks``: functions of bag and procedure that return the command to run after a
  recording
- ``fsw.schemas``: models of files, by their kind
- ``fsw.api``: public names of ``import fsw``
"""

from __future__ import annotations

from functools import cache
from importlib import metadata
from typing import Any

from fsw_control.schema.errors import InputError


@cache
def extensions(group: str) -> dict[str, metadata.EntryPoint]:
    """Entry points of a group by name, sorted; identical ones of two distributions appear once.

    Raises
    ------
    fsw_control.schema.models.InputError
        If two distributions give a name different meanings.
    """
    found: dict[str, metadata.EntryPoint] = {}
    for point in sorted(
        metadata.entry_points(group=group), key=lambda point: (point.name, point.value)
    ):
        other = found.setdefault(point.name, point)
        if other.value != point.value:
            raise InputError(
                f"{group}: {point.name} is both {_words(other)} and {_words(point)}; uninstall one"
            )
    return found


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
        raise InputError(
            f"{group}: {name} of {_words(point)}: {type(error).__name__}: {error}"
        ) from error


def program_path(program: str) -> str:
    """Dotted path of a program's function: a node by its entry point, else a module's ``main``."""
    point = extensions("fsw.nodes").get(program)
    return f"{program}.main" if point is None else f"{point.module}.{point.attr}"


def all_loaded(group: str) -> dict[str, Any]:
    """All objects registered in a group, by name; errors as in :func:`loaded`."""
    return {name: loaded(group, name) for name in extensions(group)}


def _words(point: metadata.EntryPoint) -> str:
    return f"{point.value} ({point.dist.name if point.dist else 'unknown distribution'})"
