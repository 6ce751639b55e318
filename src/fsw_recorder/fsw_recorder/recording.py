"""Parts of a recorder besides its writer: names, attachments, custom data."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Sequence
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from itertools import chain, count
from pathlib import Path

from fsw_recorder.errors import BagError

_DISTRIBUTIONS = ("fsw-control", "rclpy-embedded", "mcap", "numpy", "casadi", "cyclonedds", "rosbags")
_MAX_ATTACHMENT_BYTES = 64 * 1024 * 1024
_MEDIA_TYPES = {".yaml": "application/yaml", ".yml": "application/yaml", ".json": "application/json"}


def output_folder(wanted: str, now: datetime) -> Path:
    """Folder of the bag; where none is given, one named after the time at which the recording began."""
    return Path(wanted).expanduser() if wanted else Path("out") / now.strftime("weld_%Y_%m_%d-%H_%M_%S")


def free_sibling(folder: Path) -> Path:
    """The folder itself if it does not exist, else the first free one of ``<name>_1``, ``<name>_2``, ..."""
    siblings = (folder.with_name(f"{folder.name}_{number}") for number in count(1))
    return next(one for one in chain([folder], siblings) if not os.path.lexists(one))


def versions_text() -> bytes:
    """Contents of the attachment ``versions.json``: Python, ROS distribution, packages."""
    found = {
        "python": platform.python_version(),
        "system": platform.system(),
        "ros_distro": os.environ.get("ROS_DISTRO", ""),
    }
    for name in _DISTRIBUTIONS:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return json.dumps(found, indent=2).encode()


def read_attachment(path: str) -> bytes:
    """Contents of a file to attach; a `BagError` when it cannot be read or is too large."""
    try:
        data = Path(path).expanduser().read_bytes()
    except OSError as error:
        raise BagError(f"{path}: cannot be attached to the bag: {error.strerror}") from None
    if len(data) > _MAX_ATTACHMENT_BYTES:
        raise BagError(f"{path}: {len(data)} bytes, more than the {_MAX_ATTACHMENT_BYTES} allowed for an attachment")
    return data


def media_type(name: str) -> str:
    """Media type of an attachment by its name."""
    return _MEDIA_TYPES.get(Path(name).suffix, "text/plain" if name.endswith(".txt") else "application/octet-stream")


def custom_entries(entries: Sequence[str]) -> dict[str, str]:
    """Custom data of ``metadata.yaml`` from ``key=value`` texts; a `BagError` for one without ``=``."""
    result: dict[str, str] = {}
    for entry in entries:
        key, separator, value = entry.partition("=")
        if not separator or not key.strip():
            raise BagError(f"custom_data '{entry}': write key=value")
        result[key.strip()] = value.strip()
    return result
