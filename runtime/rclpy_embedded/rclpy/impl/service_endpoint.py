"""What clients and servers of a service share."""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from cyclonedds.core import DDSException
from rclpy._rclpy_pybind11 import RCLError
from rclpy.callback_groups import CallbackGroup
from rclpy.impl import faults
from rclpy.impl.dds import matched
from rclpy.impl.endpoint import Endpoint
from rclpy.impl.graph import user_data_field
from rclpy.impl.session import LocalNode
from rclpy.qos import QoSProfile

from rosidl_embedded.typesupport import service_type_support

# Goes before requests and replies: the client's id and the number of the request.
_HEADER = struct.Struct("<Qq")
_ENCAPSULATION_SIZE = 4


@dataclass(frozen=True)
class RequestId:
    """Which request of which client."""

    writer_guid: int
    sequence_number: int


def peer_id(data: Any, role: str) -> str | None:
    """Return the id that a matched peer has as "client" or "service": '' if it has none, None if the peer is gone."""
    return None if data is None else user_data_field(data.qos, f"{role}id") or ""


def matched_ids(handles: Callable[[], list[int]], data_of: Callable[[int], Any], role: str) -> set[str]:
    """Return the ids of all matched peers."""
    ids = {peer_id(data_of(handle), role) for handle in matched(handles)}
    return {found for found in ids if found is not None}


class ServiceEndpoint(Endpoint):
    """One end of a service: sends requests and receives responses, or the other way round.

    The service has the name `srv_name` (as it was given) and the full `name`.
    """

    _is_server: ClassVar[bool]

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
        support, session = service_type_support(srv_type), local_node.session
        requests, responses = (f"rq{name}Request", support.request), (f"rr{name}Reply", support.response)
        received, sent = (requests, responses) if self._is_server else (responses, requests)
        self._received, self._sent = received[1], sent[1]
        prefix = f"{'service' if self._is_server else 'client'}id={session.next_id()};"
        self._writer: Any = session.writer(*sent, qos_profile, prefix)
        self._reader: Any = session.reader(*received, qos_profile, prefix)
        super().__init__(local_node, name, self._reader, self._writer)

    @property
    def service_name(self) -> str:
        """Full name of the service."""
        self._check()
        return self._name

    def _reader_ids(self, role: str) -> set[str]:
        return matched_ids(self._writer.get_matched_subscriptions, self._writer.get_matched_subscription_data, role)

    def _send(self, request_id: RequestId, message: Any) -> None:
        prefix = _HEADER.pack(request_id.writer_guid, request_id.sequence_number)
        try:
            self._writer.write(self._writer.data_type(self._sent.serialize_with_prefix(prefix, message)))
        except DDSException as error:
            raise RCLError(f"failed to send {type(message).__name__}: {error}") from error

    def _receive(self, writer_guid: bytes = b"") -> tuple[RequestId, Any, Any] | None:
        """Take the next message, its id and its SampleInfo; with `writer_guid`, only what belongs to this client."""
        for sample in self.handle.take(1):
            if sample.sample_info.valid_data and sample.data.startswith(writer_guid, _ENCAPSULATION_SIZE):
                try:
                    header, message = self._received.deserialize_with_prefix(sample.data, _HEADER.size)
                    return RequestId(*_HEADER.unpack(header)), message, sample.sample_info
                except (ValueError, struct.error) as error:
                    faults.count(self._name, f"malformed {self._received.cls.__name__} on '{self._name}': {error}")
        return None
