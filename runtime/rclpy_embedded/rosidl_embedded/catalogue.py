"""Definitions of interfaces by name. The files are those that `search.definitions` finds."""

import re
from functools import cache
from pathlib import Path

from . import definition as d
from .parser import parse_service, parse_structure
from .search import INTERFACE_PATH, definitions

_SERVICE_PART = re.compile(r"_(Request|Response|Event)$")


@cache
def structure(type_name: str) -> d.Structure:
    """Return the definition of a message, of a service's request, response or event, or of a service made of these.

    Raises d.UnknownInterfaceError if there is none and d.InvalidInterfaceError if it is wrong.
    """
    if split_name(type_name)[1] == "srv":
        return _service(_SERVICE_PART.sub("", type_name))[type_name]
    path = _find(type_name)
    return parse_structure(_read(path), type_name, path)


@cache
def _service(type_name: str) -> dict[str, d.Structure]:
    path = _find(type_name)
    request, response = parse_service(_read(path), type_name, path)
    # As service introspection publishes it; part of the service's type hash.
    event = d.Structure(
        f"{type_name}_Event",
        (
            d.Member("info", d.namespaced("service_msgs/msg/ServiceEventInfo")),
            d.Member("request", d.BoundedSequence(d.namespaced(request.type_name), 1)),
            d.Member("response", d.BoundedSequence(d.namespaced(response.type_name), 1)),
        ),
    )
    parts = {"request_message": request, "response_message": response, "event_message": event}
    whole = d.Structure(type_name, tuple(d.Member(name, d.namespaced(part.type_name)) for name, part in parts.items()))
    return {found.type_name: found for found in (whole, *parts.values())}


def source(type_name: str) -> tuple[str, str]:
    """Return kind (``msg``, ``srv``) and text of an interface; parts of services are ``implicit``, without text."""
    if _SERVICE_PART.search(type_name):
        return "implicit", ""
    return split_name(type_name)[1], _read(_find(type_name))


def split_name(type_name: str) -> tuple[str, str, str]:
    """Split ``pkg/msg/Name``; ``pkg/Name`` counts as a message. UnknownInterfaceError if it is no such name."""
    parts = type_name.split("/")
    if len(parts) == 2:
        parts.insert(1, "msg")
    if len(parts) != 3 or parts[1] not in ("msg", "srv") or not all(part.isidentifier() for part in parts):
        raise d.UnknownInterfaceError(f"{type_name!r} is not the name of an interface such as 'std_msgs/msg/String'")
    return parts[0], parts[1], parts[2]


def is_service(type_name: str) -> bool:
    """Return whether it is a service rather than a message or the request, response or event of a service."""
    return "/srv/" in type_name and not _SERVICE_PART.search(type_name)


def _read(path: str) -> str:
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise d.InvalidInterfaceError(f"{path} cannot be read: {error}") from error


def _find(type_name: str) -> str:
    package, kind, name = split_name(type_name)
    try:
        return definitions(package, kind)[name]
    except KeyError:
        raise d.UnknownInterfaceError(
            f"no definition of '{package}/{kind}/{name}': it is neither a common Jazzy interface nor in a folder of"
            f" {INTERFACE_PATH} or sys.path"
        ) from None
