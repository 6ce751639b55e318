"""Topics and messages in a bag: description, QoS, selection, gaps in the message numbers."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import yaml
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos

from fsw_recorder.errors import BagError

#: pattern of the topics of a weld or its nodes, e.g. ``/cell1/fsw/depth`` and
#: ``/cell1/fsw_plant/transition_event``
_WELD = re.compile(r"((?:/\w+?)*?)/fsw(?:_\w+)?/")
#: an infinite duration, as ROS 2 writes it
INFINITE = QosTime(9223372036, 854775807)


def profile(reliable: bool = True, latched: bool = False, depth: int = 10) -> Qos:
    """A profile with the given strength and defaults otherwise."""
    return Qos(
        QosHistory.KEEP_LAST,
        depth,
        QosReliability.RELIABLE if reliable else QosReliability.BEST_EFFORT,
        QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        INFINITE,
        INFINITE,
        QosLiveliness.AUTOMATIC,
        INFINITE,
        False,
    )


def is_reliable(qos: Qos) -> bool:
    """Whether messages are resent until they arrive."""
    return bool(qos.reliability != QosReliability.BEST_EFFORT)


def is_latched(qos: Qos) -> bool:
    """Whether late subscribers get the last messages."""
    return bool(qos.durability == QosDurability.TRANSIENT_LOCAL)


def qos_values(profiles: Sequence[Qos]) -> list[Any]:
    """Profiles as ``metadata.yaml`` holds them."""
    return list(dump_qos_v9(list(profiles)))


def qos_text(profiles: Sequence[Qos]) -> str:
    """Profiles as in the channel metadata of an MCAP file; empty if there are none."""
    return yaml.safe_dump(qos_values(profiles), sort_keys=False).strip() if profiles else ""


def read_qos(text: Any) -> list[Qos]:
    """Profiles from channel metadata of any version; empty if damaged."""
    try:
        return [
            qos for qos in parse_qos(text) if isinstance(qos.depth, int) and 0 <= qos.depth < 2**31
        ]
    except Exception:  # rosbags passes on any exception caused by damage
        return []


def missing_requests(offers: Sequence[Qos], present: Sequence[Qos], depth: int) -> list[Qos]:
    """QoS of the additional subscriptions needed to receive every publisher at its strength.

    A reliable subscription does not match a best-effort publisher, and a best-effort one loses
    messages of a reliable one; similarly a latched (transient local) one does not match a
    volatile publisher. A publisher's larger depth overrides ``depth``, so that all latched
    messages are received.
    """
    requests = list(present)
    for offer in sorted(
        offers, key=lambda qos: (-is_reliable(qos) - is_latched(qos), -qos.depth, repr(qos))
    ):
        reliable, latched = is_reliable(offer), is_latched(offer)
        if not any(
            is_reliable(request) <= reliable and is_latched(request) <= latched
            for request in requests
        ):
            requests.append(profile(reliable, latched, max(depth, offer.depth)))
    return requests[len(present) :]


def replayed_qos(offers: Sequence[Qos]) -> Qos:
    """QoS that matches all subscriptions of the recorded publishers: the strongest of theirs."""
    if not offers:
        return profile()
    depth = max(1, *(offer.depth for offer in offers))
    return profile(any(map(is_reliable, offers)), any(map(is_latched, offers)), depth)


class Sequences:
    """The mixed sequences of numbers of several publishers on one topic.

    The middleware reports a message's number, but not its publisher. A number that continues no
    sequence begins another one if there is a new publisher, or if all sequences are beyond it (a
    restarted publisher); otherwise numbers are missing in the closest sequence before it.
    """

    def __init__(self) -> None:
        self._ends: list[int] = []

    def take(self, number: int, publishers: Callable[[], int]) -> int:
        """Take a message's number; return how many are missing before it.

        ``publishers`` returns their present number; it is only called if no sequence is continued.
        """
        before = max((end for end in self._ends if end < number), default=None)
        if before is None or (before != number - 1 and len(self._ends) < publishers()):
            self._ends.append(number)
            return 0
        self._ends[self._ends.index(before)] = number
        return number - before - 1


@dataclass(frozen=True, slots=True)
class RecordedTopic:
    """Description of a topic in a bag."""

    #: e.g. ``/fsw/depth`` and ``fsw_msgs/msg/ShoulderDepth``
    name: str
    type_name: str
    definition: str = ""  #: ``ros2msg`` text with all nested definitions; empty if unknown
    type_hash: str = ""  #: ``RIHS01_...``; empty if unknown
    qos: tuple[Qos, ...] = (profile(),)  #: of the publishers
    #: of messages and definition
    encoding: str = "cdr"
    definition_encoding: str = "ros2msg"


class BagRecord(NamedTuple):
    """A recorded message.

    `log_time_ns` is its receive time, `publish_time_ns` its publish time (equal if the storage
    has only one). `data` is CDR with its header of four bytes. `sequence` is the publisher's
    number, 0 if unknown.
    """

    topic: str
    type_name: str
    log_time_ns: int
    publish_time_ns: int
    data: bytes
    sequence: int


@dataclass(frozen=True, slots=True)
class TopicSelection:
    """Selects topics, by the recorder's parameters of the same names (``parameters.py``).

    Without ``topics`` and ``regex`` all are selected, except, with a ``namespace``, those of
    other welds.

    Raises
    ------
    BagError
        If an expression is invalid.
    """

    topics: Sequence[str] = ()
    regex: str = ""
    exclude: Sequence[str] = ()
    exclude_regex: str = ""
    include_hidden: bool = False
    namespace: str = ""  #: of the node; ``/`` covers all

    def __post_init__(self) -> None:
        for text in (self.regex, self.exclude_regex):
            try:
                re.compile(text)
            except re.error as error:
                raise BagError(f"'{text}' is not a regular expression: {error}") from None

    def takes(self, topic: str) -> bool:
        """Whether the topic is selected."""
        if topic in self.exclude or (self.exclude_regex and re.search(self.exclude_regex, topic)):
            return False
        if topic in self.topics:
            return True
        if not self.include_hidden and any(part.startswith("_") for part in topic.split("/")):
            return False
        if self.regex:
            return re.fullmatch(self.regex, topic) is not None
        return not self.topics and (not self.namespace or self._is_own(topic))

    def _is_own(self, topic: str) -> bool:
        """Whether the topic belongs to the namespace's weld, or to the domain (``/clock``)."""
        home = self.namespace.rstrip("/")
        return topic.count("/") == 1 or (
            topic.startswith(f"{home}/") and not self.other_weld(topic)
        )

    def takes_node(self, name: str) -> bool:
        """Whether the parameters of the node with this full name belong to the bag."""
        shared_or_near = name.count("/") == 1 or name.startswith(f"{self.namespace.rstrip('/')}/")
        return shared_or_near and "/_" not in name and not self.other_weld(f"{name}/")

    def other_weld(self, topic: str) -> str:
        """Namespace of the topic's weld if it is not the node's own; else empty."""
        weld = _WELD.match(topic)
        return (
            weld[1] or "/"
            if weld and self.namespace and weld[1] != self.namespace.rstrip("/")
            else ""
        )
