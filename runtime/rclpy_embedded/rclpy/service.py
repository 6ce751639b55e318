"""Service servers."""

import inspect
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.impl.endpoint import CallReader, RequestId, peer_id
from rclpy.service_introspection import IntrospectedEndpoint
from service_msgs.msg import ServiceEventInfo

from rosidl_embedded.typesupport import type_support

# How long a reply waits for the client's reply reader to be discovered; as rmw_cyclonedds.
_CLIENT_DISCOVERY_S = 0.1


@dataclass(frozen=True)
class ServiceInfo:
    """Metadata of a request or reply; times are nanoseconds since 1970."""

    source_timestamp: int
    received_timestamp: int
    request_id: RequestId
    publication_handle: int = 0


class RequestReader(CallReader):
    """The handle of a service."""

    def service_take_request(self, request_type: Any) -> tuple[Any, ServiceInfo] | tuple[None, None]:
        """Take the next request, (None, None) if there is none (or only a malformed one)."""
        taken = self.receive(type_support(request_type))
        if taken is None:
            return None, None
        request_id, request, info = taken
        return request, ServiceInfo(info.source_timestamp, time.time_ns(), request_id, info.publication_handle)


class Service(IntrospectedEndpoint):
    """Answers requests; created by ``Node.create_service``."""

    _is_server = True
    _kind = RequestReader

    def __init__(self, *args: Any, callback: Callable[[Any, Any], Any]) -> None:
        super().__init__(*args)
        self.callback = callback
        self._reachable: set[int] = set()

    def take_request(self) -> tuple[Any, ServiceInfo] | None:
        """Take the next request, None if there is none (or only a malformed one)."""
        request, info = self._use(self.handle.service_take_request, self.srv_type.Request)
        if info is None:
            return None
        self._tell(ServiceEventInfo.REQUEST_RECEIVED, info.request_id, request)
        return request, info

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
        while (client := peer_id(self._reader.get_matched_publication_data(handle), "client")) is not None:
            if client in self._reader_ids("client"):
                self._reachable.add(handle)
                return True
            if not client or time.monotonic() >= deadline:
                return True
            time.sleep(0.001)
        return False

    def send_response(self, response: Any, header: ServiceInfo | RequestId) -> None:
        """Send a response to the request that `header` came with."""
        if not isinstance(response, self.srv_type.Response):
            raise TypeError(f"Expected {self.srv_type.Response}, got {type(response)}")
        if not isinstance(header, ServiceInfo | RequestId):
            raise TypeError(f"Expected the header of a request, got {type(header)}")
        with self.using("failed to send response"):
            if isinstance(header, ServiceInfo):
                if not self._await_client(header):
                    return
                header = header.request_id
            self._send(header, response)
            self._tell(ServiceEventInfo.RESPONSE_SENT, header, response)
