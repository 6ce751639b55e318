"""Makes interface packages importable from their definitions: ``from my_msgs.msg import Name``.

Generated Python packages win, and nothing is found next to a genuine rclpy. A ``.pth`` file imports this module
whenever the interpreter starts, so that messages can be imported before rclpy.
"""

from __future__ import annotations

import os
import sys
from importlib.machinery import ModuleSpec, PathFinder

from .search import KINDS, definitions, may_have_definitions

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import ModuleType
    from typing import Any

_ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


def _with_own_rclpy() -> bool:
    rclpy = sys.modules.get("rclpy")
    spec = PathFinder.find_spec("rclpy") if rclpy is None else rclpy.__spec__
    return spec is None or os.path.dirname(os.path.dirname(spec.origin or "")) == _ROOT


class InterfaceFinder:
    """Finds and loads ``pkg``, ``pkg.msg``, ``pkg.srv`` and ``pkg.action``; classes are made when first asked for."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find a package that has definitions and no Python code, or its module of messages or services."""
        package, _, kind = fullname.partition(".")
        if kind in KINDS:
            if any(os.path.exists(os.path.join(folder, kind, "__init__.py")) for folder in path or ()):
                return None
            if not definitions(package, kind):
                return None
        elif kind or not may_have_definitions(package):
            return None
        else:
            python = PathFinder.find_spec(package)
            if (python is not None and python.loader) or not any(definitions(package, kind) for kind in KINDS):
                return None
        return ModuleSpec(fullname, self, is_package=not kind) if _with_own_rclpy() else None  # type: ignore[arg-type]

    def create_module(self, spec: ModuleSpec) -> None:
        """Let Python create the module."""

    def exec_module(self, module: ModuleType) -> None:
        package, _, kind = module.__name__.partition(".")
        if not kind:
            return

        def get_attribute(name: str) -> Any:
            if name == "__all__":
                return list_attributes()
            if name.startswith("_") or not name.isidentifier():
                raise AttributeError(f"module {module.__name__!r} has no attribute {name!r}")
            from .definition import UnknownInterfaceError
            from .message import get_interface

            try:
                cls = get_interface(f"{package}/{kind}/{name}")
            except UnknownInterfaceError as error:
                raise AttributeError(f"module {module.__name__!r} has no {name!r}: {error}") from None
            setattr(module, name, cls)
            return cls

        def list_attributes() -> list[str]:
            return sorted(definitions(package, kind))

        module.__dict__.update(__getattr__=get_attribute, __dir__=list_attributes)


def install() -> None:
    """Put the finder first in ``sys.meta_path``: Python would take a folder ``msg`` for a namespace package."""
    if not any(isinstance(finder, InterfaceFinder) for finder in sys.meta_path):
        sys.meta_path.insert(0, InterfaceFinder())  # type: ignore[arg-type]
