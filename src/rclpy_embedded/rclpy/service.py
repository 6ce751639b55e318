"""Service servers."""

from __future__ import annotations

import inspect
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cyclonedds.core import DDSException
from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import RCLError
from rclpy.impl import faults
from rclpy.impl.dds import any_sample, matched, raw_type
from rclpy.impl.endpoint import Endpoint
from rclpy.impl.graph import user_data_field
from rclpy.impl.session import LocalNode, Session
from rclpy.qos import QoSProfile

from rosidl_embedded.typesupport import service_type_support

#: Header of requests and replies: the client's id and the number of the request.
HEADER = struct.Struct("<Qq")
# How long a reply waits for the client's reply reader to be discovered; as rmw_cyclonedds.
_CLIENT_DISCOVERY_S = 0.1


@dataclass(frozen=True)
class RequestId:
    """Which request of which client."""

    writer_guid: int
    sequence_number: int


@dataclass(frozen=True)
class ServiceInfo:
    """What is known about a request or reply; times are nanoseconds since 1970."""

    source_timestamp: int
    received_timestamp: int
    request_id: RequestId
    publication_handle: int = 0


class Service(Endpoint):
    """Answers requests; made by ``Node.create_service``."""

    def __init__(
        self,
        session: Session,
        local_node: LocalNode,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        callback_group: CallbackGroup,
        qos_profile: QoSProfile,
    ) -> None:
        self.srv_type = srv_type
        self.srv_name = srv_name
        self.callback = callback
        self.callback_group = callback_group
        self.qos_profile = qos_profile
        support = service_type_support(srv_type)
        self._request, self._response = support.request, support.response
        self._sample = raw_type(self._response.dds_name)
        prefix = f"serviceid={session.next_id()};"
        writer = session.writer(f"rr{srv_name}Reply", self._response, qos_profile, prefix)
        reader = session.reader(f"rq{srv_name}Request", self._request, qos_profile, prefix)
        self.condition = any_sample(reader)
        self._reachable: set[int] = set()
        super().__init__(session, local_node, srv_name, reader=reader, writer=writer)

    @property
    def service_name(self) -> str:
        """Full name of the service."""
        return self._full_name()

    def take_request(self) -> tuple[Any, ServiceInfo] | None:
        """Take the next request, None if there is none (or only a malformed one)."""
        for sample in self.handle.take(1):
            info = sample.sample_info
            if not info.valid_data:
                continue
            try:
                header, request = self._request.deserialize_with_prefix(sample.data, HEADER.size)
                request_id = RequestId(*HEADER.unpack(header))
            except (ValueError, struct.error) as error:
                faults.count(self._name, f"malformed request to '{self._name}': {error}")
                continue
            return request, ServiceInfo(info.source_timestamp, time.time_ns(), request_id, info.publication_handle)
        return None

    def _take(self) -> Callable[[], Any] | None:
        taken = self.take_request()
        return None if taken is None else lambda: self._answer(*taken)

    def _answer(self, request: Any, info: ServiceInfo) -> Any:
        response = self.callback(request, self.srv_type.Response())
        if inspect.isawaitable(response):
            return self._answer_later(response, info)
        self.send_response(response, info)
        return None

    async def _answer_later(self, awaitable: Any, info: ServiceInfo) -> None:
        self.send_response(await awaitable, info)

    def _await_client(self, info: ServiceInfo) -> bool:
        """Wait until the client's reply reader is known, else the reply would be lost; False if the client is gone."""
        handle = info.publication_handle
        if not handle or handle in self._reachable:
            return True
        deadline = time.monotonic() + _CLIENT_DISCOVERY_S
        while True:
            publication = self._reader.get_matched_publication_data(handle)
            if publication is None:
                return False
            client = user_data_field(publication.qos, "clientid")
            if client is None:
                return True
            for subscription in matched(self._writer.get_matched_subscriptions):
                data = self._writer.get_matched_subscription_data(subscription)
                if data is not None and user_data_field(data.qos, "clientid") == client:
                    self._reachable.add(handle)
                    return True
            if time.monotonic() >= deadline:
                return True
            time.sleep(0.001)

    def send_response(self, response: Any, header: ServiceInfo | RequestId) -> None:
        """Send a response to the request that `header` came with.

        Raises
        ------
        TypeError
            If the response or the header is of a wrong type.
        """
        if not isinstance(response, self.srv_type.Response):
            raise TypeError(f"Expected {self.srv_type.Response}, got {type(response)}")
        assert self.handle
        if isinstance(header, ServiceInfo):
            request_id = header.request_id
            if not self._await_client(header):
                return
        elif isinstance(header, RequestId):
            request_id = header
        else:
            raise TypeError(f"Expected the header of a request, got {type(header)}")
        prefix = HEADER.pack(request_id.writer_guid, request_id.sequence_number)
        try:
            self._writer.write(self._sample(self._response.serialize_with_prefix(prefix, response)))
        except DDSException as error:
            raise RCLError(f"failed to send response: {error}") from error
