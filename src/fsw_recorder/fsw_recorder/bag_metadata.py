"""The texts of rosbag2: QoS profiles and ``metadata.yaml`` (version 9, as ROS 2 Jazzy writes it)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from fsw_recorder.errors import BagError

METADATA_NAME = "metadata.yaml"
METADATA_VERSION = 9
NO_TIME_NS = 2**63 - 1
MAX_METADATA_BYTES = 16 * 1024 * 1024
_INFINITE = (9223372036, 854775807)


@dataclass(frozen=True, slots=True)
class OfferedQos:
    """QoS of one publisher of a topic, in rosbag2's words.

    Attributes
    ----------
    reliability : str
        ``reliable`` or ``best_effort``.
    durability : str
        ``volatile`` or ``transient_local``.
    history : str
        ``keep_last``, ``keep_all`` or ``unknown``.
    depth : int
        Of ``keep_last``.
    deadline, lifespan, liveliness_lease : tuple[int, int]
        Seconds and nanoseconds; infinite by default.
    liveliness : str
        ``automatic`` or ``manual_by_topic``.
    """

    reliability: str = "reliable"
    durability: str = "volatile"
    history: str = "keep_last"
    depth: int = 10
    deadline: tuple[int, int] = _INFINITE
    lifespan: tuple[int, int] = _INFINITE
    liveliness: str = "automatic"
    liveliness_lease: tuple[int, int] = _INFINITE

    def lines(self) -> list[str]:
        """Lines of YAML, without the list's dash."""

        def duration(name: str, value: tuple[int, int]) -> list[str]:
            return [f"{name}:", f"  sec: {value[0]}", f"  nsec: {value[1]}"]

        return [
            f"history: {self.history}",
            f"depth: {self.depth}",
            f"reliability: {self.reliability}",
            f"durability: {self.durability}",
            *duration("deadline", self.deadline),
            *duration("lifespan", self.lifespan),
            f"liveliness: {self.liveliness}",
            *duration("liveliness_lease_duration", self.liveliness_lease),
            "avoid_ros_namespace_conventions: false",
        ]


def qos_lines(profiles: Sequence[OfferedQos], indent: str) -> list[str]:
    """YAML lines of a list of profiles."""
    lines: list[str] = []
    for profile in profiles:
        first, *rest = profile.lines()
        lines.append(f"{indent}- {first}")
        lines += [f"{indent}  {line}" for line in rest]
    return lines


def qos_text(profiles: Sequence[OfferedQos]) -> str:
    """Text of the MCAP channel metadata ``offered_qos_profiles``; empty when there is none."""
    return "\n".join(qos_lines(profiles, ""))


_HISTORY = {0: "keep_last", 1: "keep_last", 2: "keep_all"}
_RELIABILITY = {0: "reliable", 1: "reliable", 2: "best_effort"}
_DURABILITY = {0: "volatile", 1: "transient_local", 2: "volatile"}


def parse_qos(text: str | Sequence[Any]) -> list[OfferedQos]:
    """Profiles from channel metadata or ``metadata.yaml``; both numbers (older bags) and words are understood.

    What cannot be understood is left at its default; nothing is raised.
    """
    try:
        items = yaml.safe_load(text) if isinstance(text, str) else text
    except (yaml.YAMLError, ValueError, RecursionError):
        return []
    profiles: list[OfferedQos] = []
    for item in items if isinstance(items, list) else []:
        if not isinstance(item, Mapping):
            continue
        depth = item.get("depth")
        profiles.append(
            OfferedQos(
                reliability=_word(item.get("reliability"), _RELIABILITY, "reliable"),
                durability=_word(item.get("durability"), _DURABILITY, "volatile"),
                history=_word(item.get("history"), _HISTORY, "keep_last"),
                depth=depth if isinstance(depth, int) and 0 <= depth < 2**31 else 10,
                deadline=_duration(item.get("deadline")),
                lifespan=_duration(item.get("lifespan")),
                liveliness=_word(item.get("liveliness"), {0: "automatic", 1: "automatic"}, "automatic"),
                liveliness_lease=_duration(item.get("liveliness_lease_duration")),
            )
        )
    return profiles


def _word(value: object, numbers: Mapping[int, str], default: str) -> str:
    if isinstance(value, int):
        return numbers.get(value, default)
    known = {*numbers.values(), "manual_by_topic"}
    return value if isinstance(value, str) and value in known else default


def _duration(value: object) -> tuple[int, int]:
    if isinstance(value, Mapping):
        seconds, nanoseconds = value.get("sec"), value.get("nsec")
        if isinstance(seconds, int) and isinstance(nanoseconds, int) and (seconds, nanoseconds) != (0, 0):
            return seconds, nanoseconds
    return _INFINITE


@dataclass(slots=True)
class FileSummary:
    """What ``metadata.yaml`` says of one file of the bag."""

    path: str
    start_ns: int = NO_TIME_NS
    end_ns: int = 0
    message_count: int = 0

    @property
    def duration_ns(self) -> int:
        """From the first message to the last."""
        return self.end_ns - self.start_ns if self.message_count else 0


@dataclass(slots=True)
class TopicSummary:
    """What ``metadata.yaml`` says of one topic."""

    name: str
    type_name: str
    type_hash: str
    qos: list[OfferedQos]
    message_count: int = 0


@dataclass(slots=True)
class BagMetadata:
    """Contents of ``metadata.yaml``."""

    files: list[FileSummary] = field(default_factory=list)
    topics: list[TopicSummary] = field(default_factory=list)
    custom_data: dict[str, str] = field(default_factory=dict)
    ros_distro: str = "jazzy"
    storage: str = "mcap"
    compression_format: str = ""
    compression_mode: str = ""
    stored_paths: list[str] = field(default_factory=list)

    def lines(self) -> list[str]:
        """The document below ``rosbag2_bagfile_information``, unindented."""
        used = [file for file in self.files if file.message_count]
        start = min((file.start_ns for file in used), default=NO_TIME_NS)
        duration = max((file.end_ns for file in used), default=start) - start
        lines = [
            f"version: {METADATA_VERSION}",
            f"storage_identifier: {self.storage}",
            "duration:",
            f"  nanoseconds: {duration}",
            "starting_time:",
            f"  nanoseconds_since_epoch: {start}",
            f"message_count: {sum(file.message_count for file in self.files)}",
            "topics_with_message_count:",
        ]
        for topic in self.topics:
            lines += [
                "  - topic_metadata:",
                f"      name: {_scalar(topic.name)}",
                f"      type: {_scalar(topic.type_name)}",
                "      serialization_format: cdr",
                *(
                    ["      offered_qos_profiles:", *qos_lines(topic.qos, "        ")]
                    if topic.qos
                    else ["      offered_qos_profiles: []"]
                ),
                f"      type_description_hash: {_scalar(topic.type_hash)}",
                f"    message_count: {topic.message_count}",
            ]
        if not self.topics:
            lines.append("  []")
        lines += ['compression_format: ""', 'compression_mode: ""', "relative_file_paths:"]
        lines += [f"  - {_scalar(file.path)}" for file in self.files]
        lines.append("files:")
        for file in self.files:
            lines += [
                f"  - path: {_scalar(file.path)}",
                "    starting_time:",
                f"      nanoseconds_since_epoch: {file.start_ns}",
                "    duration:",
                f"      nanoseconds: {file.duration_ns}",
                f"    message_count: {file.message_count}",
            ]
        if self.custom_data:
            lines.append("custom_data:")
            lines += [f"  {_scalar(key)}: {_scalar(value)}" for key, value in self.custom_data.items()]
        else:
            lines.append("custom_data: ~")
        lines.append(f"ros_distro: {_scalar(self.ros_distro)}")
        return lines

    def document(self) -> str:
        """Text of ``metadata.yaml``."""
        return "\n".join(["rosbag2_bagfile_information:", *(f"  {line}" for line in self.lines())]) + "\n"

    def inner_text(self) -> str:
        """Text of the MCAP metadata record ``rosbag2``, which older tools and the reindexer look at."""
        return "\n".join(self.lines())


def _scalar(text: str) -> str:
    """Plain where YAML allows it, quoted where it does not."""
    plain = text and all(c.isalnum() or c in "/_.-" for c in text) and text[0] not in "-." and not text.isdigit()
    if plain and yaml.safe_load(text) == text:
        return text
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'


def read_metadata(folder: Path) -> BagMetadata | None:
    """What ``metadata.yaml`` says, as far as a reader needs it; None when there is no such file.

    Raises
    ------
    BagError
        The file exists but is not rosbag2's metadata.
    """
    path = folder / METADATA_NAME
    try:
        with path.open("rb") as stream:
            raw = stream.read(MAX_METADATA_BYTES + 1)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise BagError(f"{path}: cannot be read: {error.strerror}") from None
    if len(raw) > MAX_METADATA_BYTES:
        raise BagError(f"{path}: larger than {MAX_METADATA_BYTES} bytes, not read")
    try:
        document = yaml.load(raw, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
        information = document["rosbag2_bagfile_information"]
        names = information["relative_file_paths"]
        if not isinstance(names, list):
            raise TypeError("relative_file_paths is not a list")
        custom = information.get("custom_data") or {}
        return BagMetadata(
            stored_paths=[str(name) for name in names],
            storage=str(information["storage_identifier"]),
            compression_format=str(information.get("compression_format") or "").lower(),
            compression_mode=str(information.get("compression_mode") or "").lower(),
            ros_distro=str(information.get("ros_distro") or ""),
            custom_data={str(key): str(value) for key, value in dict(custom).items()},
        )
    except (yaml.YAMLError, KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        detail = " ".join(str(error).split())[:200]
        raise BagError(f"{path}: not the metadata of a rosbag2 bag: {detail}") from None
