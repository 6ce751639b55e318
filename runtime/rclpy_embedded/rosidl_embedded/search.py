"""Where the definitions of interface packages are.

They are looked up in this order: ``share/`` beside this file (the common packages of Jazzy),
``RCLPY_EMBEDDED_INTERFACE_PATH``, ``sys.path``, and ``share/`` of ``AMENT_PREFIX_PATH``. An entry is the folder of the
package or the one above it. Imported whenever the interpreter starts, so this imports next to nothing itself.
"""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

INTERFACE_PATH = "RCLPY_EMBEDDED_INTERFACE_PATH"
KINDS = ("msg", "srv", "action")
_SHARE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "share")
COMMON_PACKAGES = frozenset(os.listdir(_SHARE))


def _entries(variable: str, *parts: str) -> list[str]:
    return [os.path.join(entry, *parts) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _roots() -> list[str]:
    return [_SHARE, *_entries(INTERFACE_PATH), *sys.path, *_entries("AMENT_PREFIX_PATH", "share")]


def definitions(package: str, kind: str) -> dict[str, str]:
    """Return the files of all messages (`kind` ``msg``), services (``srv``) or actions of a package by name."""
    found: dict[str, str] = {}
    for root in _roots():
        for folder in (os.path.join(root, package), root):
            if os.path.basename(folder) == package and os.path.isdir(os.path.join(folder, kind)):
                for file in os.listdir(os.path.join(folder, kind)):
                    if file.endswith(f".{kind}"):
                        found.setdefault(file.removesuffix(f".{kind}"), os.path.join(folder, kind, file))
    return found


def packages(folders: Sequence[str]) -> Iterator[str]:
    """Return the names of the interface packages in folders; a folder may be a package itself."""
    for folder in folders:
        for entry in (folder, *(os.path.join(folder, name) for name in sorted(os.listdir(folder)))):
            name = os.path.basename(os.path.abspath(entry))
            if name.isidentifier() and any(os.path.isdir(os.path.join(entry, kind)) for kind in KINDS):
                yield name


def may_have_definitions(package: str) -> bool:
    """Return quickly whether a package without Python code may have definitions; called for every import."""
    if package in COMMON_PACKAGES or any(os.path.basename(entry) == package for entry in sys.path):
        return True
    named = _entries(INTERFACE_PATH) + _entries("AMENT_PREFIX_PATH", "share")
    return any(os.path.basename(entry) == package or os.path.isdir(os.path.join(entry, package)) for entry in named)
