"""What is known about a domain: participants, nodes and endpoints, updated at every query."""

import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from typing import Any

from cyclonedds.builtin import (
    BuiltinDataReader,
    BuiltinTopicDcpsParticipant,
    BuiltinTopicDcpsPublication,
    BuiltinTopicDcpsSubscription,
)
from cyclonedds.builtin_types import DcpsEndpoint
from cyclonedds.core import InstanceState, Policy, Qos
from cyclonedds.domain import DomainParticipant
from rclpy._rclpy_pybind11 import NodeNameNonExistentError
from rclpy.impl import faults

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
    if package.endswith(("::srv", "::action")):
        name = name.removesuffix("_Request").removesuffix("_Response")
    return f"{package.replace('::', '/')}/{name}"


def ros_topic(dds_topic: str) -> str | None:
    """Return the ROS topic of a DDS topic, None if it is not one."""
    return dds_topic[2:] if dds_topic.startswith("rt/") else None


def ros_service(dds_topic: str) -> str | None:
    """Return the ROS service a DDS topic belongs to, None if it belongs to none."""
    for prefix, suffix in (("rq/", "Request"), ("rr/", "Reply")):
        if dds_topic.startswith(prefix) and dds_topic.endswith(suffix):
            return dds_topic[2 : -len(suffix)]
    return None


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


class Graph:
    """Participants, nodes and endpoints of a domain; `info_reader` receives ros_discovery_info.

    `using` guards queries: it raises an error with the text it is given once the context is shut down.
    """

    def __init__(
        self,
        participant: DomainParticipant,
        info_reader: Any,
        deserialize: Callable[[bytes], Any],
        using: Callable[[str], AbstractContextManager[None]],
    ) -> None:
        self._lock = threading.Lock()
        self._info_reader = info_reader
        self._deserialize = deserialize
        self._using = using
        self._participant = participant
        self._participant_reader = BuiltinDataReader(participant, BuiltinTopicDcpsParticipant)
        # Made at the first query: most programs have none.
        self._endpoint_readers: list[BuiltinDataReader] = []
        self._enclaves: dict[bytes, str] = {}
        self._writers: dict[bytes, DcpsEndpoint] = {}
        self._readers: dict[bytes, DcpsEndpoint] = {}
        # NodeEntitiesInfo messages by participant.
        self._announced: dict[bytes, list[Any]] = {}

    def tidy(self) -> None:
        """Take what has arrived since the last query, so that it does not accumulate between queries."""
        with self._lock:
            self._update()

    def _update(self) -> None:
        for sample in _drain(self._participant_reader):
            guid = sample.key.bytes
            if sample.sample_info.instance_state == InstanceState.Alive:
                self._enclaves[guid] = user_data_field(sample.qos, "enclave") or "/"
            else:
                self._enclaves.pop(guid, None)
                self._announced.pop(guid, None)
        for reader, endpoints in zip(self._endpoint_readers, (self._writers, self._readers), strict=False):
            for sample in _drain(reader):
                name = sample.topic_name
                # DCPS...: Cyclone's own, read by this participant.
                if sample.sample_info.instance_state == InstanceState.Alive and name and not name.startswith("DCPS"):
                    sample.type_name = sample.type_name or ""
                    endpoints[sample.key.bytes] = sample
                else:
                    endpoints.pop(sample.key.bytes, None)
        for sample in _drain(self._info_reader):
            if sample.sample_info.valid_data:
                try:
                    info = self._deserialize(sample.data)
                    self._announced[bytes(info.gid.data)] = info.node_entities_info_seq
                except ValueError as error:
                    faults.count("ros_discovery_info", f"malformed ros_discovery_info: {error}")

    def nodes(self) -> list[tuple[str, Any]]:
        """Return all nodes of the participants that are alive: enclave and what is announced of the node."""
        with self._using("failed to look at the graph"), self._lock:
            self._update()
            enclaves = self._enclaves.items()
            return [(enclave, node) for guid, enclave in enclaves for node in self._announced.get(guid, ())]

    def endpoints(self, *, writers: bool) -> list[DcpsEndpoint]:
        with self._using("failed to look at the graph"), self._lock:
            if not self._endpoint_readers:
                topics = (BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription)
                self._endpoint_readers = [BuiltinDataReader(self._participant, topic) for topic in topics]
            self._update()
            return list((self._writers if writers else self._readers).values())

    def endpoints_of(self, dds_topic: str, *, writers: bool) -> list[DcpsEndpoint]:
        return [endpoint for endpoint in self.endpoints(writers=writers) if endpoint.topic_name == dds_topic]

    def node_of(self, endpoint: DcpsEndpoint) -> Any:
        """Return the node that announced an endpoint, None if none did."""
        nodes = self._announced.get(endpoint.participant_key.bytes, ())
        guid = endpoint.key.bytes
        return next((node for node in nodes if guid in _guids(node, True) | _guids(node, False)), None)

    def endpoints_by_node(self, name: str, namespace: str, *, writers: bool) -> list[DcpsEndpoint]:
        """Return the writers or the readers of a node; NodeNameNonExistentError if no such node is known."""
        nodes = [node for _, node in self.nodes() if (node.node_name, node.node_namespace) == (name, namespace)]
        if not nodes:
            raise NodeNameNonExistentError(f"node '{name}' in namespace '{namespace}' does not exist")
        guids = set[bytes]().union(*(_guids(node, writers) for node in nodes))
        return [endpoint for endpoint in self.endpoints(writers=writers) if endpoint.key.bytes in guids]


def _guids(node: Any, writers: bool) -> set[bytes]:
    return {bytes(gid.data) for gid in (node.writer_gid_seq if writers else node.reader_gid_seq)}


def names_and_types(endpoints: Iterable[DcpsEndpoint], demangle: Callable[[str], str | None] | None) -> NamesAndTypes:
    """Collect the names that `demangle` gives for the DDS topics, sorted, each with its sorted types.

    Without `demangle`, names and types are those of DDS.
    """
    found: dict[str, set[str]] = {}
    for endpoint in endpoints:
        name = demangle(endpoint.topic_name) if demangle else endpoint.topic_name
        if name is not None:
            found.setdefault(name, set()).add(ros_type(endpoint.type_name) if demangle else endpoint.type_name)
    return [(name, sorted(types)) for name, types in sorted(found.items())]
