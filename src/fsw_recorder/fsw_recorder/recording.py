"""Parts of a recorder other than its writer: names, attachments, custom data."""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Iterator, Sequence
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from fsw_control.coded import Worded
from fsw_control.schema.files import open_regular
from fsw_recorder.errors import BagError

_DISTRIBUTIONS = ("fsw-control", "ros-rclpy", "ros-fastrtps", "mcap", "numpy", "casadi", "rosbags")
#: packages that determine the commands, with the suffixes of their sources
_PACKAGES = (
    "fsw_control",
    "fsw_model",
    "fsw_nmpc",
    "fsw_decentral",
    "fsw_supervisor",
    "fsw_plant",
    "fsw_scenario",
)
_SOURCES = (".py", ".yaml", ".c", ".h")


class Note(Worded):
    """Diagnostics of the recorder."""

    RECORDING = "recording"
    PAUSED = "paused"
    INCOMPLETE = "recording, but not everything is in the bag"
    AWAITED = "recording nothing until these topics are there: {topics}"
    FAILED = "{error}"


_MAX_ATTACHMENT_BYTES = 64 * 1024 * 1024
_MEDIA_TYPES = {".yaml": "application/yaml", ".json": "application/json", ".txt": "text/plain"}


def output_folder(requested: str, now: datetime) -> Path:
    """Folder of the bag; by default named after the start time of the recording."""
    return (
        Path(requested).expanduser()
        if requested
        else Path("out") / now.strftime("weld_%Y_%m_%d-%H_%M_%S")
    )


def versions_text() -> bytes:
    """Attachment ``versions.json``: Python, ROS distribution, packages, hashes of our code."""
    versions = {
        "python": platform.python_version(),
        "system": platform.system(),
        "ros_distro": os.environ.get("ROS_DISTRO", ""),
    }
    for name in _DISTRIBUTIONS:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    versions |= {
        f"code of {name}": code_sha256(name) for name in _PACKAGES if find_spec(name) is not None
    }
    return json.dumps(versions, indent=2).encode()


def code_files(package: str) -> Iterator[Path]:
    """Source files of an installed package, C and parameters included, in a fixed order."""
    spec = find_spec(package)
    for folder in spec.submodule_search_locations or () if spec else ():
        for path in sorted(Path(folder).rglob("*")):
            if path.suffix in _SOURCES and path.is_file():
                yield path


def code_sha256(package: str) -> str:
    """Hash of a package's source files by name and content, independent of its version number."""
    total = hashlib.sha256()
    for path in code_files(package):
        content = path.read_bytes()
        total.update(f"{path.parent.name}/{path.name}\0{len(content)}\0".encode() + content)
    return total.hexdigest()


def read_attachment(path: str) -> bytes:
    """Content of a file to attach; a `BagError` if it is unreadable or too large."""
    try:
        with open_regular(Path(path).expanduser()) as file:
            data = file.read(_MAX_ATTACHMENT_BYTES + 1)
    except OSError as error:
        raise BagError(f"{path}: cannot be attached to the bag: {error.strerror}") from None
    if len(data) > _MAX_ATTACHMENT_BYTES:
        raise BagError(
            f"{path}: more than the {_MAX_ATTACHMENT_BYTES} bytes allowed for an attachment"
        )
    return data


def media_type(name: str) -> str:
    """Media type of an attachment by its name."""
    return _MEDIA_TYPES.get(Path(name).suffix, "application/octet-stream")


def custom_entries(entries: Sequence[str]) -> dict[str, str]:
    """Custom data of ``metadata.yaml`` from ``key=value`` texts; a `BagError` without ``=``."""
    result: dict[str, str] = {}
    for entry in entries:
        key, separator, value = entry.partition("=")
        if not separator or not key.strip():
            raise BagError(f"custom_data '{entry}': write key=value")
        result[key.strip()] = value.strip()
    return result
