"""Definition, hash and class of an interface, on ROS 2 and on the embedded runtime."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

from fsw_recorder.definitions import Definitions
from fsw_recorder.errors import BagError

_SEPARATOR = "=" * 80
_FIELD = re.compile(r"^\s*([A-Za-z][\w/]*)(?:<=\d+)?(?:\[[^\]]*\])?\s+\w+", re.MULTILINE)
_PRIMITIVES = frozenset(
    ["bool", "byte", "char", "float32", "float64", "string", "wstring"]
    + [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
)


@cache
def interface_definition(type_name: str) -> str:
    """``ros2msg`` text of a message type with all nested definitions, as rosbag2 writes it; empty when unknown."""
    return _definition(type_name) or ""


@cache
def interface_hash(type_name: str) -> str:
    """``RIHS01_...`` hash of an interface; empty when unknown."""
    definition = _definition(type_name)
    try:
        return "" if definition is None else str(Definitions().typestore(type_name, definition).hash_rihs01(type_name))
    except Exception:  # of a kind that rosbags cannot describe
        return ""


def message_class(type_name: str) -> Any:
    """Message class of a type; a `BagError` when it is not installed."""
    try:
        from rosidl_runtime_py.utilities import get_message
    except ImportError:
        from rosidl_embedded.typesupport import get_message
    try:
        return get_message(type_name)
    except (ImportError, AttributeError, ValueError, LookupError) as error:
        raise BagError(f"its type {type_name} is not installed here: {error}") from None


def _definition(type_name: str) -> str | None:
    for source in (_installed_definition, _embedded_definition):
        try:
            return source(type_name)
        except Exception:  # an unknown type raises different errors; its messages are recorded without a definition
            continue
    return None


def _embedded_definition(type_name: str) -> str:
    from rosidl_embedded.typesupport import interface_definition as embedded

    return str(embedded(type_name))


def _installed_definition(type_name: str) -> str:
    from ament_index_python.packages import get_package_share_directory

    package, *_, message = type_name.split("/")
    seen = {f"{package}/{message}"}

    def text_of(short_name: str) -> str:
        package, name = short_name.split("/")
        text = (Path(get_package_share_directory(package)) / "msg" / f"{name}.msg").read_text(encoding="utf-8")
        for match in _FIELD.finditer(re.sub(r"#.*", "", text)):
            nested = match[1] if "/" in match[1] else f"{package}/{match[1]}"
            if match[1] not in _PRIMITIVES and nested not in seen:
                seen.add(nested)
                text += f"\n{_SEPARATOR}\nMSG: {nested}\n{text_of(nested)}"
        return text

    return text_of(f"{package}/{message}")
