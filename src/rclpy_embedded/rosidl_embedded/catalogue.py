"""Finds the definition of an interface by its name.

Looked at in this order: the definitions that ship with this package (services, and messages with default values, which
rosbags does not carry), folders named in ``RCLPY_EMBEDDED_INTERFACE_PATH``, the importable Python package of the name
(its folder or the one above holds ``msg/`` and ``srv/``), the Jazzy type store of rosbags, ``share/`` of
``AMENT_PREFIX_PATH``.
"""

from __future__ import annotations

import importlib.machinery
import os
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from .definition import (
    EMPTY_STRUCTURE_REQUIRED_MEMBER_NAME,
    AbstractNestableType,
    AbstractType,
    Array,
    BasicType,
    BoundedSequence,
    BoundedString,
    Constant,
    Field,
    InvalidInterfaceError,
    Structure,
    UnboundedSequence,
    UnboundedString,
    UnknownInterfaceError,
    namespaced,
)
from .parser import BASIC_TYPES, basic_value, parse_service, parse_structure

INTERFACE_PATH = "RCLPY_EMBEDDED_INTERFACE_PATH"
_SHARE = Path(__file__).parent / "share"
_SERVICE_PARTS = ("_Request", "_Response", "_Event")


@cache
def structure(type_name: str) -> Structure:
    """Find the definition of a message, or of a service's request, response or event.

    Parameters
    ----------
    type_name : str
        For example ``std_msgs/msg/String`` or ``std_srvs/srv/Trigger_Request``.

    Raises
    ------
    UnknownInterfaceError
        If there is no such interface.
    InvalidInterfaceError
        If there is one and its definition is wrong.
    """
    package, kind, name = split_name(type_name)
    if kind == "srv":
        base, part = service_part(name)
        if part == "_Event":
            return _event(f"{package}/srv/{base}")
        if not part:
            raise UnknownInterfaceError(f"{type_name!r} is a service, not a message")
        return service(f"{package}/srv/{base}")[_SERVICE_PARTS.index(part)]
    path = _find_file(package, kind, name)
    if path is not None:
        return parse_structure(_read(path), type_name, str(path))
    definition = _store().get(type_name)
    if definition is not None:
        return _from_rosbags(type_name, definition)
    path = _find_file(package, kind, name, ament=True)
    if path is None:
        raise UnknownInterfaceError(_not_found(type_name))
    return parse_structure(_read(path), type_name, str(path))


@cache
def service(type_name: str) -> tuple[Structure, Structure]:
    """Find request and response of a service such as ``std_srvs/srv/Trigger``; raises like `structure`."""
    package, kind, name = split_name(type_name)
    path = _find_file(package, kind, name) or _find_file(package, kind, name, ament=True) if kind == "srv" else None
    if path is None:
        raise UnknownInterfaceError(_not_found(type_name))
    return parse_service(_read(path), type_name, str(path))


def split_name(type_name: str) -> tuple[str, str, str]:
    """Split ``pkg/msg/Name``; ``pkg/Name`` counts as a message.

    Raises
    ------
    UnknownInterfaceError
        If the text is not the name of an interface.
    """
    parts = type_name.split("/")
    if len(parts) == 2:
        parts.insert(1, "msg")
    if len(parts) != 3 or parts[1] not in ("msg", "srv") or not all(part.isidentifier() for part in parts):
        raise UnknownInterfaceError(f"{type_name!r} is not the name of an interface such as 'std_msgs/msg/String'")
    return parts[0], parts[1], parts[2]


def service_part(name: str) -> tuple[str, str]:
    """Split ``Trigger_Request`` into ``Trigger`` and ``_Request``; the part is empty for the service itself."""
    for part in _SERVICE_PARTS:
        if name.endswith(part):
            return name[: -len(part)], part
    return name, ""


def interface_names(package: str, kind: str) -> list[str]:
    """Names of all messages (`kind` ``msg``) or services (``srv``) of a package, sorted."""
    found = {path.stem for folder in _folders(package, ament=True) for path in (folder / kind).glob(f"*.{kind}")}
    if kind == "msg" and (not found or (_SHARE / package).is_dir()):
        prefix = f"{package}/msg/"
        found |= {name[len(prefix) :] for name in _store() if name.startswith(prefix)}
    return sorted(found)


def has_folder(package: str) -> bool:
    """Tell whether definitions of the package are anywhere but in rosbags and in importable Python packages."""
    folders = (_with_interfaces(_SHARE / package), _named_folders(package), _ament_folders(package))
    return any(True for found in folders for _ in found)


def _not_found(type_name: str) -> str:
    return (
        f"no definition of {type_name!r}: it is neither a common Jazzy interface nor in a folder of {INTERFACE_PATH}"
        " (package folders with msg/ and srv/, or a folder of such)"
    )


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInterfaceError(f"{path} cannot be read: {error}") from error


def _find_file(package: str, kind: str, name: str, *, ament: bool = False) -> Path | None:
    for folder in _ament_folders(package) if ament else _folders(package):
        path = folder / kind / f"{name}.{kind}"
        if path.is_file():
            return path
    return None


def _folders(package: str, *, ament: bool = False) -> Iterator[Path]:
    yield from _with_interfaces(_SHARE / package)
    yield from _named_folders(package)
    yield from _python_folders(package)
    if ament:
        yield from _ament_folders(package)


def _with_interfaces(*folders: Path) -> Iterator[Path]:
    for folder in folders:
        if any(next((folder / kind).glob(f"*.{kind}"), None) for kind in ("msg", "srv")):
            yield folder


def _named_folders(package: str) -> Iterator[Path]:
    for entry in filter(None, os.environ.get(INTERFACE_PATH, "").split(os.pathsep)):
        folder = Path(entry)
        yield from _with_interfaces(*([folder] if folder.name == package else []), folder / package)


def _python_folders(package: str) -> tuple[Path, ...]:
    return _python_folders_on(package, tuple(sys.path))


@cache
def _python_folders_on(package: str, search_path: tuple[str, ...]) -> tuple[Path, ...]:
    # Asked of the path finder, not of importlib.util.find_spec, which would ask our own importer again.
    spec = importlib.machinery.PathFinder.find_spec(package, search_path)
    locations = [Path(location) for location in (spec.submodule_search_locations or [])] if spec else []
    return tuple(_with_interfaces(*(folder for location in locations for folder in (location, location.parent))))


def _ament_folders(package: str) -> Iterator[Path]:
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        yield from _with_interfaces(Path(prefix) / "share" / package)


def _event(type_name: str) -> Structure:
    """Event of a service as service introspection publishes it; part of the service's type hash."""
    request, response = service(type_name)
    return Structure(
        f"{type_name}_Event",
        (
            Field("info", namespaced("service_msgs/msg/ServiceEventInfo")),
            Field("request", BoundedSequence(namespaced(request.type_name), 1)),
            Field("response", BoundedSequence(namespaced(response.type_name), 1)),
        ),
    )


@cache
def _store() -> dict[str, Any]:
    # Imported on first need: the type store takes 0.1 s to load.
    from rosbags.typesys.stores import ros2_jazzy

    return dict(ros2_jazzy.FIELDDEFS)


def _from_rosbags(type_name: str, definition: Any) -> Structure:
    constants, fields = definition[:2]
    return Structure(
        type_name,
        tuple(
            Field(name, _type_from_rosbags(description))
            for name, description in fields
            if name != EMPTY_STRUCTURE_REQUIRED_MEMBER_NAME
        ),
        tuple(_constant_from_rosbags(*constant) for constant in constants),
    )


def _constant_from_rosbags(name: str, typename: str, value: Any) -> Constant:
    type_ = _base_from_rosbags(typename, 0)
    return Constant(name, type_, value if isinstance(value, str) else basic_value(value, BASIC_TYPES[typename]))


def _base_from_rosbags(typename: str, bound: int) -> AbstractNestableType:
    if typename == "string":
        return BoundedString(bound) if bound else UnboundedString()
    return BasicType(BASIC_TYPES[typename])


def _type_from_rosbags(description: Any) -> AbstractType:
    from rosbags.interfaces import Nodetype

    node, content = description
    if node == Nodetype.BASE:
        return _base_from_rosbags(*content)
    if node == Nodetype.NAME:
        return namespaced(content)
    element, size = content
    value_type = _type_from_rosbags(element)
    assert isinstance(value_type, AbstractNestableType)
    if node == Nodetype.ARRAY:
        return Array(value_type, size)
    return BoundedSequence(value_type, size) if size else UnboundedSequence(value_type)
