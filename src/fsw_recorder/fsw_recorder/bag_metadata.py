"""``metadata.yaml`` of a rosbag2 bag (version 9, as ROS 2 Jazzy writes it)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from fsw_control.schema.files import read_regular
from fsw_control.schema.yaml_text import load_yaml
from fsw_recorder.errors import BagError
from fsw_recorder.topic import RecordedTopic, qos_values

METADATA_NAME = "metadata.yaml"
#: attestation of a bag, beside its manifest
ATTESTATION_NAME = "attestation.json"
#: custom data that identifies canister, lid, tool and machine: ``recorder`` parameter
#: ``custom_data``
IDENTITY = ("canister", "lid", "tool", "machine")
#: rosbag2's start time of a bag without messages
NO_TIME_NS = 2**63 - 1
_ROOT = "rosbag2_bagfile_information"


@dataclass(slots=True)
class FileSummary:
    """Entry of a file in ``metadata.yaml``; ``counts`` are messages by topic."""

    path: str
    start_ns: int = NO_TIME_NS
    end_ns: int = 0
    counts: Counter[str] = field(default_factory=Counter)
    size_bytes: int = 0

    def note(self, topic: str, log_time_ns: int) -> None:
        """Count a message."""
        self.counts[topic] += 1
        self.start_ns, self.end_ns = min(self.start_ns, log_time_ns), max(self.end_ns, log_time_ns)

    def values(self) -> dict[str, Any]:
        """Return the entry as in ``metadata.yaml``."""
        return {
            "path": self.path,
            "starting_time": {"nanoseconds_since_epoch": self.start_ns},
            "duration": {"nanoseconds": max(self.end_ns - self.start_ns, 0)},
            "message_count": self.counts.total(),
        }


@dataclass(slots=True)
class BagMetadata:
    """Content of ``metadata.yaml`` that readers need."""

    files: list[str] = field(default_factory=list)
    storage: str = ""
    messages_compressed: bool = False
    ros_distro: str = ""
    custom_data: dict[str, str] = field(default_factory=dict)


def metadata_text(
    files: Sequence[FileSummary],
    topics: Iterable[RecordedTopic],
    custom_data: Mapping[str, str],
    whole: bool = True,
) -> str:
    """Text of ``metadata.yaml``; unless ``whole``, only its root's content (MCAP ``rosbag2``)."""
    bag = FileSummary("")
    for file in files:
        bag.counts += file.counts
        bag.start_ns, bag.end_ns = min(bag.start_ns, file.start_ns), max(bag.end_ns, file.end_ns)
    totals = bag.values()
    content = {
        "version": 9,
        "storage_identifier": "mcap",
        "duration": totals["duration"],
        "starting_time": totals["starting_time"],
        "message_count": totals["message_count"],
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type_name,
                    "serialization_format": topic.encoding,
                    "offered_qos_profiles": qos_values(topic.qos),
                    "type_description_hash": topic.type_hash,
                },
                "message_count": bag.counts[topic.name],
            }
            for topic in topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.path for file in files],
        "files": [file.values() for file in files],
        "custom_data": dict(custom_data) or None,
        "ros_distro": "jazzy",
    }
    return str(
        yaml.safe_dump({_ROOT: content} if whole else content, sort_keys=False, allow_unicode=True)
    )


def read_metadata(folder: Path) -> BagMetadata:
    """Read ``metadata.yaml``; a `BagError` if it is missing or not rosbag2's metadata."""
    path = folder / METADATA_NAME
    try:
        raw = read_regular(path)
    except FileNotFoundError:
        raise BagError(f"{folder}: {METADATA_NAME} is missing") from None
    except OSError as error:
        raise BagError(f"{path}: cannot be read: {error.strerror}") from None
    try:
        return _metadata(load_yaml(raw.decode())[_ROOT])
    except _NO_METADATA as error:
        raise BagError(
            f"{path}: not the metadata of a rosbag2 bag: {' '.join(str(error).split())[:200]}"
        ) from None


def metadata_inside(text: str) -> BagMetadata:
    """Metadata that a recorder has put into an MCAP file; empty if they are not rosbag2's."""
    try:
        return _metadata(load_yaml(text))
    except _NO_METADATA:
        return BagMetadata()


_NO_METADATA = (yaml.YAMLError, KeyError, TypeError, ValueError, AttributeError, RecursionError)


def _metadata(information: Any) -> BagMetadata:
    names = information["relative_file_paths"]
    if not isinstance(names, list):
        raise TypeError("relative_file_paths is not a list")
    return BagMetadata(
        files=[Path(str(name)).name for name in names],
        storage=str(information.get("storage_identifier") or ""),
        messages_compressed=str(information.get("compression_mode")).lower() == "message",
        ros_distro=str(information.get("ros_distro") or ""),
        custom_data={
            str(key): str(value)
            for key, value in dict(information.get("custom_data") or {}).items()
        },
    )
