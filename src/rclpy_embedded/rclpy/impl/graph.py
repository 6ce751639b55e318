"""What is known of a domain: participants, nodes and endpoints, kept up to date when asked."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cyclonedds.builtin import (
    BuiltinDataReader,
    BuiltinTopicDcpsParticipant,
    BuiltinTopicDcpsPublication,
    BuiltinTopicDcpsSubscription,
)
from cyclonedds.core import InstanceState, Policy, Qos
from rclpy._rclpy_pybind11 import NodeNameNonExistentError
from rclpy.impl import faults

if TYPE_CHECKING:
    from rclpy.impl.session import Session

_BATCH = 128
NamesAndTypes = list[tuple[str, list[str]]]


def user_data_field(qos: Qos, key: str) -> str | None:
    """Return a field of the USER_DATA (``key=value;...``), None if it is absent or not text."""
    policy = qos[Policy.Userdata]
    for entry in (policy.data if policy is not None else b"").split(b";"):
        name, separator, value = entry.partition(b"=")
        if separator and name == key.encode():
            return str(value.decode(errors="replace"))
    return None


def ros_type(dds_type: str) -> str:
    """Return the ROS name of a DDS type, e.g. std_msgs/msg/String; a type that is not of ROS keeps its name."""
    package, separator, name = dds_type.rpartition("::dds_::")
    if not separator or not name.endswith("_"):
        return dds_type
    name = name[:-1]
    if package.endswith("::srv"):
        for suffix in ("_Request", "_Response"):
            name = name.removesuffix(suffix)
    return f"{package.replace('::', '/')}/{name}"


def ros_topic(dds_topic: str) -> str | None:
    """Return the ROS topic of a DDS topic, None if it is not one."""
    return dds_topic[2:] if dds_topic.startswith("rt/") else None


def ros_service(dds_topic: str) -> str | None:
    """Return the ROS service a DDS topic belongs to, None if it belongs to none."""
    if dds_topic.startswith("rq/") and dds_topic.endswith("Request"):
        return dds_topic[2:-7]
    if dds_topic.startswith("rr/") and dds_topic.endswith("Reply"):
        return dds_topic[2:-5]
    return None


@dataclass(frozen=True)
class Endpoint:
    """A writer or reader somewhere in the domain."""

    guid: bytes
    participant: bytes
    dds_topic: str
    dds_type: str
    qos: Qos


@dataclass(frozen=True)
class RemoteNode:
    """A node as its participant announces it."""

    participant: bytes
    namespace: str
    name: str
    readers: frozenset[bytes]
    writers: frozenset[bytes]


class Graph:
    """Participants, nodes and endpoints of a domain."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._lock = threading.Lock()
        participant = session.participant
        self._participant_reader = BuiltinDataReader(participant, BuiltinTopicDcpsParticipant)
        self._writer_reader = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
        self._reader_reader = BuiltinDataReader(participant, BuiltinTopicDcpsSubscription)
        self._enclaves: dict[bytes, str] = {}
        self._writers: dict[bytes, Endpoint] = {}
        self._readers: dict[bytes, Endpoint] = {}
        self._announced: dict[bytes, list[RemoteNode]] = {}

    # Keeping up

    @staticmethod
    def _drain(reader: Any) -> Iterator[Any]:
        while True:
            try:
                samples = reader.take(N=_BATCH)
            except (ValueError, TypeError, UnicodeError, KeyError) as error:
                faults.count("discovery", f"discovery data that cannot be read: {error}")
                return
            yield from samples
            if len(samples) < _BATCH:
                return

    def _update(self) -> None:
        for sample in self._drain(self._participant_reader):
            guid = sample.key.bytes
            if sample.sample_info.instance_state == InstanceState.Alive:
                self._enclaves[guid] = user_data_field(sample.qos, "enclave") or "/"
            else:
                self._enclaves.pop(guid, None)
                self._announced.pop(guid, None)
        for reader, endpoints in ((self._writer_reader, self._writers), (self._reader_reader, self._readers)):
            for sample in self._drain(reader):
                guid = sample.key.bytes
                name = sample.topic_name
                # DCPS...: Cyclone's own, read by this participant.
                if sample.sample_info.instance_state == InstanceState.Alive and name and not name.startswith("DCPS"):
                    endpoints[guid] = Endpoint(
                        guid, sample.participant_key.bytes, name, sample.type_name or "", sample.qos
                    )
                else:
                    endpoints.pop(guid, None)
        support = self._session.info_support
        for sample in self._drain(self._session.info_reader):
            if not sample.sample_info.valid_data:
                continue
            try:
                self._take_info(support.deserialize(sample.data))
            except ValueError as error:
                faults.count("ros_discovery_info", f"malformed ros_discovery_info: {error}")

    def _take_info(self, info: Any) -> None:
        guid = bytes(info.gid.data)
        self._announced[guid] = [
            RemoteNode(
                guid,
                node.node_namespace,
                node.node_name,
                frozenset(bytes(gid.data) for gid in node.reader_gid_seq),
                frozenset(bytes(gid.data) for gid in node.writer_gid_seq),
            )
            for node in info.node_entities_info_seq
        ]

    # Questions

    def nodes(self) -> list[RemoteNode]:
        """Return all nodes of the participants that are alive."""
        with self._lock:
            self._update()
            return [node for guid in self._enclaves for node in self._announced.get(guid, ())]

    def enclave(self, participant: bytes) -> str:
        """Return the enclave a participant announced."""
        return self._enclaves.get(participant, "/")

    def endpoints(self, *, writers: bool) -> list[Endpoint]:
        """Return all writers or all readers."""
        with self._lock:
            self._update()
            return list((self._writers if writers else self._readers).values())

    def endpoints_of(self, dds_topic: str, *, writers: bool) -> list[Endpoint]:
        """Return the writers or the readers of a DDS topic."""
        return [endpoint for endpoint in self.endpoints(writers=writers) if endpoint.dds_topic == dds_topic]

    def node_of(self, endpoint: Endpoint) -> RemoteNode | None:
        """Return the node that announced an endpoint."""
        for node in self._announced.get(endpoint.participant, ()):
            if endpoint.guid in node.writers or endpoint.guid in node.readers:
                return node
        return None

    def endpoints_by_node(self, name: str, namespace: str, *, writers: bool) -> list[Endpoint]:
        """Return the writers or the readers of a node.

        Raises
        ------
        NodeNameNonExistentError
            If no such node is known.
        """
        found = [node for node in self.nodes() if node.name == name and node.namespace == namespace]
        if not found:
            raise NodeNameNonExistentError(
                f"Cannot get endpoints of node: node '{name}' in namespace '{namespace}' does not exist"
            )
        guids = frozenset[bytes]().union(*(node.writers if writers else node.readers for node in found))
        return [endpoint for endpoint in self.endpoints(writers=writers) if endpoint.guid in guids]


def names_and_types(endpoints: Iterable[Endpoint], demangle: Callable[[str], str | None] | None) -> NamesAndTypes:
    """Collect the names that `demangle` gives for the DDS topics, sorted, each with its sorted types.

    Without `demangle`, names and types are those of DDS.
    """
    found: dict[str, set[str]] = {}
    for endpoint in endpoints:
        name = demangle(endpoint.dds_topic) if demangle else endpoint.dds_topic
        if name is not None:
            found.setdefault(name, set()).add(ros_type(endpoint.dds_type) if demangle else endpoint.dds_type)
    return [(name, sorted(types)) for name, types in sorted(found.items())]
