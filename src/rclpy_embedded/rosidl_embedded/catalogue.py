"""Finds the definition of an interface by its name.

Looked at in this order: ``share/`` of this package with the common interfaces of Jazzy, folders named in
``RCLPY_EMBEDDED_INTERFACE_PATH``, the importable Python package of the name (its folder or the one above holds ``msg/``
and ``srv/``), ``share/`` of ``AMENT_PREFIX_PATH``. The messages in ``share/`` are those of the Jazzy type store of
rosbags, with the default values that it leaves out; as files they load 80 ms sooner. A test compares the two.
"""

from __future__ import annotations

import importlib.machinery
import os
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from .definition import BoundedSequence, Field, InvalidInterfaceError, Structure, UnknownInterfaceError, namespaced
from .parser import parse_service, parse_structure

INTERFACE_PATH = "RCLPY_EMBEDDED_INTERFACE_PATH"
_SHARE = Path(__file__).parent / "share"
_SERVICE_PART = re.compile(r"_(Request|Response|Event)$")


@cache
def structure(type_name: str) -> Structure:
    """Find the definition of a message, of a service's request, response or event, or of a service made of these three.

    Raises
    ------
    UnknownInterfaceError
        If there is no such interface.
    InvalidInterfaceError
        If there is one and its definition is wrong.
    """
    package, kind, name = split_name(type_name)
    if kind == "srv":
        return _service(_SERVICE_PART.sub("", type_name))[type_name]
    path = _find_file(package, kind, name)
    return parse_structure(_read(path), type_name, str(path))


@cache
def _service(type_name: str) -> dict[str, Structure]:
    path = _find_file(*split_name(type_name))
    request, response = parse_service(_read(path), type_name, str(path))
    # As service introspection publishes it; part of the service's type hash.
    event = Structure(
        f"{type_name}_Event",
        (
            Field("info", namespaced("service_msgs/msg/ServiceEventInfo")),
            Field("request", BoundedSequence(namespaced(request.type_name), 1)),
            Field("response", BoundedSequence(namespaced(response.type_name), 1)),
        ),
    )
    parts = {"request_message": request, "response_message": response, "event_message": event}
    whole = Structure(type_name, tuple(Field(name, namespaced(part.type_name)) for name, part in parts.items()))
    return {found.type_name: found for found in (whole, *parts.values())}


def source(type_name: str) -> tuple[str, str]:
    """Find kind (``msg``, ``srv``) and text of an interface; parts of services are ``implicit``, without text."""
    if _SERVICE_PART.search(type_name):
        return "implicit", ""
    package, kind, name = split_name(type_name)
    return kind, _read(_find_file(package, kind, name))


def split_name(type_name: str) -> tuple[str, str, str]:
    """Split ``pkg/msg/Name``; ``pkg/Name`` counts as a message. UnknownInterfaceError if it is no such name."""
    parts = type_name.split("/")
    if len(parts) == 2:
        parts.insert(1, "msg")
    if len(parts) != 3 or parts[1] not in ("msg", "srv") or not all(part.isidentifier() for part in parts):
        raise UnknownInterfaceError(f"{type_name!r} is not the name of an interface such as 'std_msgs/msg/String'")
    return parts[0], parts[1], parts[2]


def is_service(type_name: str) -> bool:
    """Tell a service from a message and from the request, response or event of a service."""
    return "/srv/" in type_name and not _SERVICE_PART.search(type_name)


def interface_names(package: str, kind: str) -> list[str]:
    """Names of all messages (`kind` ``msg``) or services (``srv``) of a package, sorted."""
    return sorted({path.stem for folder in _folders(package) for path in (folder / kind).glob(f"*.{kind}")})


def has_folder(package: str) -> bool:
    """Tell whether definitions of the package are anywhere but in an importable Python package."""
    folders = (_with_interfaces(_SHARE / package), _named_folders(package), _ament_folders(package))
    return any(True for found in folders for _ in found)


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInterfaceError(f"{path} cannot be read: {error}") from error


def _find_file(package: str, kind: str, name: str) -> Path:
    for folder in _folders(package):
        path = folder / kind / f"{name}.{kind}"
        if path.is_file():
            return path
    raise UnknownInterfaceError(
        f"no definition of '{package}/{kind}/{name}': it is neither a common Jazzy interface nor in a folder of"
        f" {INTERFACE_PATH} (package folders with msg/ and srv/, or a folder of such)"
    )


def _folders(package: str) -> Iterator[Path]:
    yield from _with_interfaces(_SHARE / package)
    yield from _named_folders(package)
    yield from _python_folders(package, tuple(sys.path))
    yield from _ament_folders(package)


def _with_interfaces(*folders: Path) -> Iterator[Path]:
    for folder in folders:
        if any(next((folder / kind).glob(f"*.{kind}"), None) for kind in ("msg", "srv")):
            yield folder


def _named_folders(package: str) -> Iterator[Path]:
    for entry in filter(None, os.environ.get(INTERFACE_PATH, "").split(os.pathsep)):
        folder = Path(entry)
        yield from _with_interfaces(*([folder] if folder.name == package else []), folder / package)


@cache
def _python_folders(package: str, search_path: tuple[str, ...]) -> tuple[Path, ...]:
    # Asked of the path finder, not of importlib.util.find_spec, which would ask our own importer again.
    spec = importlib.machinery.PathFinder.find_spec(package, search_path)
    locations = [Path(location) for location in (spec.submodule_search_locations or [])] if spec else []
    # Definitions are in the package itself, in a folder of it (a wheel) or beside it (a source tree).
    folders = (folder for location in locations for folder in (location, location / "interfaces", location.parent))
    return tuple(_with_interfaces(*folders))


def _ament_folders(package: str) -> Iterator[Path]:
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        yield from _with_interfaces(Path(prefix) / "share" / package)
