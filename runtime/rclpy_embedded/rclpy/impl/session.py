"""A participant in a DDS domain, and the nodes it announces on ros_discovery_info."""

from __future__ import annotations

import atexit
import os
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from cyclonedds.core import DDSException, Entity, Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter, Publisher
from cyclonedds.sub import DataReader, Subscriber
from cyclonedds.topic import Topic
from rclpy._rclpy_pybind11 import RCLError
from rclpy.impl.dds import RawSample, delete, qos_to_dds, raw_type
from rclpy.impl.discovery import configuration, discovery_range, static_peers
from rclpy.impl.graph import Graph
from rclpy.impl.handle import Handle, WeakMembers
from rclpy.impl.type_information import hidden
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile

from rosidl_embedded.typesupport import TypeSupport, get_message, type_support


@dataclass
class _Domain:
    entity: Domain
    #: Discovery range and static peers.
    options: tuple[str, list[str]]
    sessions: int = 0


_domains: dict[int, _Domain] = {}
_domains_lock = threading.RLock()
# Topics are made and deleted one at a time. While the type information of one is hidden, it cannot be made again; and
# Cyclone DDS 11.0.1 reads its table of types without a lock while it makes one, and crashes if it changes meanwhile.
# Reentrant, because the garbage collector may close another session at any moment.
_topics_lock = threading.RLock()
_sessions: WeakMembers[Session] = WeakMembers()

_INFO_WRITER = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_INFO_READER = QoSProfile(history=HistoryPolicy.KEEP_ALL, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def _gid(entity: Entity) -> Any:
    return get_message("rmw_dds_common/msg/Gid")(data=list(entity.guid.bytes))


class Writer(Handle, DataWriter[RawSample]):
    """A writer of CDR; `name` is that of the topic or service it is for."""

    name = ""


class Reader(Handle, DataReader[RawSample]):
    """A reader of CDR; `name` is that of the topic or service it is for."""

    name = ""


_Kind = TypeVar("_Kind", bound=Reader | Writer)


class LocalNode(Handle):
    """A node of this participant; `info` is what is announced of it."""

    def __init__(self, session: Session, namespace: str, name: str) -> None:
        self.session = session
        self.namespace = namespace
        self.name = name
        self.info = get_message("rmw_dds_common/msg/NodeEntitiesInfo")(node_namespace=namespace, node_name=name)

    def gids(self, endpoint: Reader | Writer) -> list[Any]:
        """Return the announced GIDs among which that of an endpoint belongs."""
        gids: list[Any] = self.info.writer_gid_seq if isinstance(endpoint, Writer) else self.info.reader_gid_seq
        return gids

    @property
    def full_name(self) -> str:
        return f"{self.namespace.rstrip('/')}/{self.name}"

    @property
    def logger_name(self) -> str:
        return self.full_name[1:].replace("/", ".")


class Session(Handle):
    """The DDS side of a context: domain, participant, announced nodes. The `enclave` is announced only."""

    def __init__(self, domain_id: int, enclave: str = "/") -> None:
        self.domain_id = domain_id
        self._lock = threading.RLock()
        self._ids = 0
        self._closed = False
        self._endpoints: WeakMembers[Reader | Writer] = WeakMembers()
        # By name and type, kept until the end: the garbage collector would delete them without the lock.
        self._topics: dict[tuple[str, str], Topic[RawSample]] = {}
        self._left: list[Reader | Writer] = []
        self._closer: threading.Thread | None = None
        self._gone = threading.Event()
        self.is_shut_down = False
        _acquire_domain(domain_id)
        self.participant = DomainParticipant(domain_id, Qos(Policy.Userdata(f"enclave={enclave};".encode())))
        self.publisher = Publisher(self.participant)
        self.subscriber = Subscriber(self.participant)
        self.info_support = type_support(get_message("rmw_dds_common/msg/ParticipantEntitiesInfo"))
        self._info = self.info_support.cls(gid=_gid(self.participant))
        self._info_writer = self.create(Writer, "ros_discovery_info", self.info_support, _INFO_WRITER)
        self.info_reader = self.create(Reader, "ros_discovery_info", self.info_support, _INFO_READER)
        #: What is known of all participants of the domain.
        self.graph = Graph(self.participant, self.info_reader, self.info_support.deserialize, self.using)
        _sessions.add(self)

    def create(
        self, kind: type[_Kind], dds_topic: str, support: TypeSupport, profile: QoSProfile, prefix: str = ""
    ) -> _Kind:
        """Create a writer or reader; `prefix` precedes the type hash in its USER_DATA."""
        qos = qos_to_dds(profile, f"{prefix}typehash={support.type_hash};", writer=issubclass(kind, Writer))
        parent: Any = self.publisher if issubclass(kind, Writer) else self.subscriber
        with self.using(f"failed to create an endpoint of '{dds_topic}'"), _topics_lock:
            key = dds_topic, support.dds_name
            if key not in self._topics:
                self._topics[key] = Topic(self.participant, dds_topic, raw_type(support.dds_name))
            with hidden(self._topics[key]) as topic:
                endpoint = kind(parent, topic, qos)
        self._endpoints.add(endpoint)
        return endpoint

    def check(self, complaint: str) -> None:
        """Raise an RCLError with `complaint` if the context was shut down."""
        if self.is_shut_down:
            raise RCLError(f"{complaint}: the context is invalid")

    @contextmanager
    def using(self, complaint: str) -> Iterator[None]:
        """Raise an RCLError with `complaint` if the context is shut down, or what is used is destroyed meanwhile."""
        self.check(complaint)
        try:
            yield
        except DDSException as error:
            raise RCLError(f"{complaint}: the context or an entity is invalid: {error}") from error

    def next_id(self) -> str:
        """Return a new client or service id in the notation of rmw: bytes in hex, the first padded with a blank."""
        with self._lock:
            self._ids += 1
            raw = self.participant.guid.bytes[:12] + self._ids.to_bytes(4, "big")
        return f"{raw[0]:2x}." + ".".join(f"{byte:x}" for byte in raw[1:])

    def add_node(self, node: LocalNode) -> None:
        with self.using("failed to announce the node"), self._lock:
            self._info.node_entities_info_seq.append(node.info)
            self._announce()

    def remove_node(self, node: LocalNode) -> None:
        with self._lock:
            if not self._closed:
                infos = self._info.node_entities_info_seq
                self._info.node_entities_info_seq = [info for info in infos if info is not node.info]
                self._announce()

    def add_endpoints(self, node: LocalNode, *endpoints: Reader | Writer) -> None:
        with self.using("failed to announce endpoints"), self._lock:
            for endpoint in endpoints:
                node.gids(endpoint).append(_gid(endpoint))
            self._announce()

    def remove_endpoints(self, node: LocalNode, *endpoints: Reader | Writer) -> None:
        with self._lock:
            if self._closed:
                return
            for endpoint in endpoints:
                node.gids(endpoint).remove(_gid(endpoint))
            self._announce()
            if self.is_shut_down:  # close() follows and deletes them all at once
                self._left.extend(endpoints)
            else:
                for endpoint in endpoints:
                    delete(endpoint)

    def _announce(self) -> None:
        self._info_writer.write(self._info_writer.data_type(self.info_support.serialize(self._info)))

    def close(self, *, wait: bool = True) -> None:
        """Leave the graph; return when that is done, also, with `wait`, if another thread does it.

        Without `wait`, the garbage collector may call this in any thread, also in those that another close waits for.
        """
        this = threading.current_thread()
        with self._lock:
            under_way, self._closed = self._closed, True
            self._closer = self._closer or this
        if under_way:
            if wait and this is not self._closer:
                self._gone.wait()
            return
        # Without the lock, which the garbage collector may need in the threads that are waited for.
        _delete_all(list(self._endpoints))
        self._left.clear()
        with _topics_lock:
            for topic in self._topics.values():
                delete(topic)
            delete(self.participant)
            _release_domain(self.domain_id)
            _sessions.discard(self)
        self._gone.set()


def _delete_all(endpoints: Sequence[Reader | Writer]) -> None:
    """Delete endpoints side by side: each writer waits up to a second for readers that may have died."""
    threads = [threading.Thread(target=delete, args=(endpoint,)) for endpoint in endpoints]
    try:
        for thread in threads:
            thread.start()
    except RuntimeError:  # the interpreter ends and starts no threads; the participant deletes the rest
        pass
    for thread in threads:
        if thread.ident is not None:
            thread.join()


def _acquire_domain(domain_id: int) -> None:
    options = discovery_range(), static_peers()
    with _domains_lock:
        if domain_id not in _domains:
            _domains[domain_id] = _Domain(_new_domain(domain_id), options)
        domain = _domains[domain_id]
        if options != domain.options:
            present = domain.options
            raise RCLError(
                f"a context of this process is in domain {domain_id} with the discovery range {present[0]} and the "
                f"static peers {present[1]}; it cannot be joined with {options[0]} and {options[1]}"
            )
        domain.sessions += 1


def _new_domain(domain_id: int) -> Domain:
    try:
        return Domain(domain_id, configuration(domain_id))
    except (DDSException, UnicodeError) as error:  # Cyclone DDS says more on stderr
        uri = os.environ.get("CYCLONEDDS_URI", "")
        raise RCLError(f"cannot join domain {domain_id}" + (f"; CYCLONEDDS_URI is {uri!r}" if uri else "")) from error


def _release_domain(domain_id: int) -> None:
    with _domains_lock:
        _domains[domain_id].sessions -= 1
        if not _domains[domain_id].sessions:
            delete(_domains.pop(domain_id).entity)


@atexit.register
def _close_all() -> None:
    """Leave the domain at exit in any case; else peers would take the nodes for alive until the lease ends."""
    for session in _sessions:
        session.close()
