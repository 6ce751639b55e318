"""Makes interface packages importable: ``from my_msgs.msg import Name`` without generated code.

Classes are made when they are first taken from their module (PEP 562), so importing ``std_msgs.msg`` builds nothing.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, cast

from . import catalogue
from .definition import UnknownInterfaceError
from .message import get_message, get_service

if TYPE_CHECKING:
    # Only for annotations: importing importlib.abc takes 10 ms.
    from importlib.abc import Loader, MetaPathFinder

_KINDS = ("msg", "srv")


def lazy_interfaces(module_name: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Make ``__getattr__`` and ``__dir__`` of a module such as ``std_msgs.msg`` or ``std_srvs.srv``.

    The first keeps in the module what it has made.
    """
    package, kind = module_name.split(".")

    def get_attribute(name: str) -> Any:
        if name == "__all__":
            return list_attributes()
        if name.startswith("_") or not name.isidentifier():
            raise AttributeError(f"module {module_name!r} has no attribute {name!r}")
        type_name = f"{package}/{kind}/{name}"
        try:
            cls = (get_service if catalogue.is_service(type_name) else get_message)(type_name)
        except UnknownInterfaceError as error:
            raise AttributeError(f"module {module_name!r} has no {name!r}: {error}") from None
        setattr(sys.modules[module_name], name, cls)
        return cls

    def list_attributes() -> list[str]:
        return catalogue.interface_names(package, kind)

    return get_attribute, list_attributes


class InterfaceFinder:
    """Finds interface packages that have no Python package; asked last, so that genuine ones win."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find ``pkg``, ``pkg.msg`` or ``pkg.srv``, if definitions of `pkg` are known."""
        package, _, kind = fullname.partition(".")
        if (kind and kind not in _KINDS) or not catalogue.has_folder(package):
            return None
        if kind and not catalogue.interface_names(package, kind):
            return None
        return ModuleSpec(fullname, cast("Loader", self), is_package=not kind)

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """Leave it to Python."""
        return None

    def exec_module(self, module: ModuleType) -> None:
        """Fill a module of messages or services."""
        if "." in module.__name__:
            module.__dict__["__getattr__"], module.__dict__["__dir__"] = lazy_interfaces(module.__name__)


class FolderFinder(InterfaceFinder):
    """Finds ``pkg.msg`` where it is a folder of definitions; asked first, for Python would take it for a package."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find ``pkg.msg`` or ``pkg.srv`` of a package that is a folder on ``sys.path``."""
        kind = fullname.partition(".")[2]
        if kind not in _KINDS or any(Path(folder, kind, "__init__.py").exists() for folder in path or ()):
            return None
        if not any(next(Path(folder, kind).glob(f"*.{kind}"), None) for folder in path or ()):
            return None
        return ModuleSpec(fullname, cast("Loader", self))


def install() -> None:
    """Put the finders into ``sys.meta_path``, once."""
    if not any(isinstance(finder, InterfaceFinder) for finder in sys.meta_path):
        sys.meta_path.insert(0, cast("MetaPathFinder", FolderFinder()))
        sys.meta_path.append(cast("MetaPathFinder", InterfaceFinder()))
