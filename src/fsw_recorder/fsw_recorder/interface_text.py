"""Definition and hash of an interface, as bags store them, on ROS 2 and on the embedded runtime."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

_SEPARATOR = "=" * 80
_FIELD = re.compile(r"^\s*([A-Za-z][\w/]*)(?:<=\d+)?(?:\[[^\]]*\])?\s+\w+", re.MULTILINE)
_PRIMITIVES = frozenset(
    ["bool", "byte", "char", "float32", "float64", "string", "wstring"]
    + [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
)


def interface_definition(type_name: str) -> str:
    """``ros2msg`` text of a message with all nested definitions, as rosbag2 writes it; empty when unknown.

    Parameters
    ----------
    type_name : str
        E.g. ``fsw_msgs/msg/ShoulderDepth``.
    """
    try:
        from ament_index_python.packages import get_package_share_directory
    except ImportError:
        return _embedded_definition(type_name)
    try:
        return _installed_definition(type_name, get_package_share_directory)
    except (LookupError, OSError, ValueError):
        return _embedded_definition(type_name)  # launch's Python packages may be there without any interfaces


def interface_hash(type_name: str) -> str:
    """``RIHS01_...`` hash of an interface; empty when unknown."""
    try:
        from ament_index_python.packages import get_package_share_directory
    except ImportError:
        return _embedded_hash(type_name)
    try:
        package, kind, name = type_name.split("/")
        text = (Path(get_package_share_directory(package)) / kind / f"{name}.json").read_text(encoding="utf-8")
        hashes = {one["type_name"]: one["hash_string"] for one in json.loads(text)["type_hashes"]}
        return str(hashes.get(type_name, ""))
    except (LookupError, OSError, ValueError, TypeError):
        return _embedded_hash(type_name)


def message_class(type_name: str) -> Any:
    """Message class of a type.

    Raises
    ------
    ImportError, AttributeError, ValueError, LookupError
        It is not installed.
    """
    try:
        from rosidl_runtime_py.utilities import get_message
    except ImportError:
        from rosidl_embedded.typesupport import get_message
    return get_message(type_name)


def _embedded_definition(type_name: str) -> str:
    try:
        from rosidl_embedded.typesupport import interface_definition as embedded

        return str(embedded(type_name))
    except Exception:  # unknown types raise different errors; the message is recorded without a definition
        return ""


def _embedded_hash(type_name: str) -> str:
    try:
        from rosidl_embedded.typesupport import type_hash

        return str(type_hash(type_name))
    except Exception:  # unknown types raise different errors; the message is recorded without a hash
        return ""


def _installed_definition(type_name: str, share_directory: Any) -> str:
    seen = {_short(type_name)}

    def text_of(short_name: str) -> str:
        package, name = short_name.split("/")
        text = (Path(share_directory(package)) / "msg" / f"{name}.msg").read_text(encoding="utf-8")
        for match in _FIELD.finditer(re.sub(r"#.*", "", text)):
            if match[1] in _PRIMITIVES:
                continue
            nested = match[1] if "/" in match[1] else f"{package}/{match[1]}"
            if nested not in seen:
                seen.add(nested)
                text += f"\n{_SEPARATOR}\nMSG: {nested}\n{text_of(nested)}"
        return text

    return text_of(_short(type_name))


def _short(type_name: str) -> str:
    package, *_, name = type_name.split("/")
    return f"{package}/{name}"
