"""What publishers, subscriptions, clients and services share."""

import copy
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar

from cyclonedds.core import DDSException
from rclpy._rclpy_pybind11 import RCLError
from rclpy.callback_groups import CallbackGroup
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.impl import faults
from rclpy.impl.dds import Readable, delete, matched, profile_from_dds
from rclpy.impl.graph import user_data_field
from rclpy.impl.handle import Destroyable
from rclpy.impl.session import LocalNode, Reader, Session, Writer
from rclpy.qos import REQUESTED_POLICIES, WEAK_AND_STRICT, QoSProfile, qos_profile_best_available

from rosidl_embedded.typesupport import TypeSupport, type_support

# Goes before requests and replies: the client's id and the number of the request.
_HEADER = struct.Struct("<Qq")
_ENCAPSULATION_SIZE = 4


class Endpoint(Destroyable):
    """One or two DDS entities under a full name, announced as a node's; the first one is the handle."""

    #: What wakes the executor.
    condition: Any = None
    event_handlers: list[Any] | tuple[()] = ()

    def __init__(self, local_node: LocalNode, name: str, *entities: Reader | Writer) -> None:
        super().__init__(entities[0])
        self._local_node = local_node
        entities[0].name = name
        self._entities = entities
        if isinstance(entities[0], Reader):
            self.condition = Readable(entities[0])
        local_node.session.add_endpoints(local_node, *entities)

    @contextmanager
    def using(self, complaint: str) -> Iterator[Any]:
        """Use the handle; InvalidHandle or an RCLError with `complaint` if it or the context is gone, now or later."""
        handle = self.handle
        try:
            with self._local_node.session.using(complaint):
                yield handle
        except RCLError:
            self._check()
            raise

    def _use(self, method: Callable[..., Any], *arguments: Any) -> Any:
        """Call a method of an entity; InvalidHandle or RCLError if that is gone."""
        try:
            return method(*arguments)
        except DDSException as error:
            self._check()
            raise RCLError(f"failed to {method.__name__} on '{self._entities[0].name}': {error}") from error

    def _clean_up(self) -> None:
        for handler in self.event_handlers:
            handler.destroy()
        delete(self.condition)
        self._local_node.session.remove_endpoints(self._local_node, *self._entities)


class TopicEndpoint(Endpoint):
    """A publisher or subscription of a `topic` (as it was given) with the full `name`."""

    #: Class of the handle.
    _kind: ClassVar[type[Reader | Writer]]

    def __init__(
        self,
        local_node: LocalNode,
        msg_type: Any,
        topic: str,
        name: str,
        qos_profile: QoSProfile,
        event_callbacks: PublisherEventCallbacks | SubscriptionEventCallbacks,
        callback_group: CallbackGroup,
    ) -> None:
        self.msg_type = msg_type
        self.topic = topic
        self.qos_profile = qos_profile
        self.callback_group = callback_group
        self._support = type_support(msg_type)
        session, dds_topic = local_node.session, "rt" + name
        profile = _resolve(qos_profile, session, dds_topic, writer=issubclass(self._kind, Writer))
        entity = session.create(self._kind, dds_topic, self._support, profile)
        super().__init__(local_node, name, entity)
        logger_name = local_node.logger_name
        self.event_handlers = event_callbacks.create_event_handlers(callback_group, entity, topic, logger_name)

    @property
    def topic_name(self) -> str:
        """Full name of the topic."""
        return str(self.handle.name)


def _resolve(profile: QoSProfile, session: Session, dds_topic: str, *, writer: bool) -> QoSProfile:
    """Choose the BEST_AVAILABLE policies: the strictest that match what is in the graph now."""
    wanted = [
        name for name in REQUESTED_POLICIES if getattr(profile, name) == getattr(qos_profile_best_available, name)
    ]
    if not wanted:
        return profile
    peers = [profile_from_dds(endpoint.qos) for endpoint in session.graph.endpoints_of(dds_topic, writers=not writer)]
    chosen = copy.copy(profile)
    for name in wanted:
        setattr(chosen, name, _best(name, [getattr(peer, name) for peer in peers], writer))
    return chosen


def _best(name: str, of_peers: list[Any], writer: bool) -> Any:
    if name not in WEAK_AND_STRICT:
        return (min if writer else max)(of_peers, key=lambda duration: duration.nanoseconds, default=Duration())
    weak, strict = WEAK_AND_STRICT[name]
    if not writer:  # may ask only for what every writer offers
        return strict if all(value == strict for value in of_peers) else weak
    # What a writer offers beyond need does no harm, but liveliness has to be asserted by its program.
    return strict if name != "liveliness" or strict in of_peers else weak


@dataclass(frozen=True)
class RequestId:
    """Which request of which client."""

    writer_guid: int
    sequence_number: int


def peer_id(data: Any, role: str) -> str | None:
    """Return the id that a matched peer has as "client" or "service": '' if it has none, None if the peer is gone."""
    return None if data is None else user_data_field(data.qos, f"{role}id") or ""


def matched_ids(handles: Callable[[], list[int]], data_of: Callable[[int], Any], role: str) -> set[str]:
    ids = {peer_id(data_of(handle), role) for handle in matched(handles)}
    return {found for found in ids if found is not None}


class CallReader(Reader):
    """The handle of a client or a service."""

    def receive(self, support: TypeSupport, writer_guid: bytes = b"") -> tuple[RequestId, Any, Any] | None:
        """Take the next message, its id and its SampleInfo; with `writer_guid`, only what belongs to this client."""
        for sample in self.take(1):
            if sample.sample_info.valid_data and sample.data.startswith(writer_guid, _ENCAPSULATION_SIZE):
                try:
                    header, message = support.deserialize_with_prefix(sample.data, _HEADER.size)
                    return RequestId(*_HEADER.unpack(header)), message, sample.sample_info
                except (ValueError, struct.error) as error:
                    faults.count(self.name, f"malformed {support.cls.__name__} on '{self.name}': {error}")
        return None


class ServiceEndpoint(Endpoint):
    """One end of a service: sends requests and receives responses, or the other way round.

    The service has the name `srv_name` (as it was given) and the full `name`.
    """

    _is_server: ClassVar[bool]
    #: Class of the handle.
    _kind: ClassVar[type[CallReader]] = CallReader

    def __init__(
        self,
        local_node: LocalNode,
        srv_type: Any,
        srv_name: str,
        name: str,
        qos_profile: QoSProfile,
        callback_group: CallbackGroup,
    ) -> None:
        self.srv_type = srv_type
        self.srv_name = srv_name
        self.qos_profile = qos_profile
        self.callback_group = callback_group
        session = local_node.session
        requests = f"rq{name}Request", type_support(srv_type.Request)
        responses = f"rr{name}Reply", type_support(srv_type.Response)
        received, sent = (requests, responses) if self._is_server else (responses, requests)
        self._received, self._sent = received[1], sent[1]
        prefix = f"{'service' if self._is_server else 'client'}id={session.next_id()};"
        self._writer: Any = session.create(Writer, *sent, qos_profile, prefix)
        self._reader: Any = session.create(self._kind, *received, qos_profile, prefix)
        super().__init__(local_node, name, self._reader, self._writer)

    @property
    def service_name(self) -> str:
        """Full name of the service."""
        return str(self.handle.name)

    def _reader_ids(self, role: str) -> set[str]:
        return matched_ids(self._writer.get_matched_subscriptions, self._writer.get_matched_subscription_data, role)

    def _send(self, request_id: RequestId, message: Any) -> None:
        prefix = _HEADER.pack(request_id.writer_guid, request_id.sequence_number)
        self._use(self._writer.write, self._writer.data_type(self._sent.serialize(message, prefix)))
