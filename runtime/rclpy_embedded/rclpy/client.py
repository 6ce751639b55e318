"""Service clients."""

import threading
from collections.abc import Callable
from typing import Any

from rclpy.context import Context
from rclpy.impl.endpoint import RequestId, matched_ids
from rclpy.service_introspection import IntrospectedEndpoint
from rclpy.task import Future
from rclpy.utilities import wait_until
from service_msgs.msg import ServiceEventInfo


class Client(IntrospectedEndpoint):
    """Sends requests; created by ``Node.create_client``."""

    _is_server = False

    def __init__(self, *args: Any, context: Context) -> None:
        super().__init__(*args)
        self.context = context
        self._pending_requests: dict[int, Future] = {}
        self._sequence_number = 0
        self._lock = threading.Lock()
        self._guid = self._writer.get_instance_handle() & 0xFFFFFFFFFFFFFFFF

    def call(self, request: Any, timeout_sec: float | None = None) -> Any:
        """Send a request and wait for the response, None if it does not come in time.

        Not for use in callbacks: there it blocks the executor, which then never receives the response.
        """
        future = self.call_async(request)
        response = future._wait(timeout_sec)
        self.remove_pending_request(future)
        return response

    def call_async(self, request: Any) -> Future:
        return self._complete(Future(), request)

    def _complete(self, future: Future, request: Any) -> Future:
        """Send a request; complete the future with the response."""
        if not isinstance(request, self.srv_type.Request):
            raise TypeError(f"Expected {self.srv_type.Request}, got {type(request)}")
        self._check()
        with self._lock:
            self._sequence_number += 1
            number = self._sequence_number
            request_id = RequestId(self._guid, number)
            # Known before it is sent: the response may come before write returns.
            self._pending_requests[number] = future
            try:
                self._send(request_id, request)
            except Exception:
                del self._pending_requests[number]
                raise
        future.add_done_callback(self.remove_pending_request)
        self._tell(ServiceEventInfo.REQUEST_SENT, request_id, request)
        return future

    def get_pending_request(self, sequence_number: int) -> Future:
        """Return the future of a request; KeyError if it is not pending."""
        with self._lock:
            return self._pending_requests[sequence_number]

    def remove_pending_request(self, future: Future) -> None:
        """Remove a request; its future will never be done."""
        with self._lock:
            pending = self._pending_requests.items()
            self._pending_requests = {number: other for number, other in pending if other is not future}

    def take_response(self) -> tuple[int, Any] | None:
        """Take the next response to this client and the number of its request, None if there is none."""
        # Replies to all clients of the service come by; only our own are worth decoding.
        taken = self._use(self.handle.receive, self._received, self._guid.to_bytes(8, "little"))
        if taken is None:
            return None
        request_id, response, _ = taken
        self._tell(ServiceEventInfo.RESPONSE_RECEIVED, request_id, response)
        return request_id.sequence_number, response

    def _take(self) -> Callable[[], Any] | None:
        taken = self.take_response()
        if taken is None:
            return None
        number, response = taken
        future = self._pending_requests.get(number)
        return None if future is None else lambda: future.set_result(response)

    def service_is_ready(self) -> bool:
        """Return whether a server is there: a request reader and a reply writer with the same service id."""
        with self.using("failed to check service availability") as reader:
            replies = matched_ids(reader.get_matched_publications, reader.get_matched_publication_data, "service")
            return bool(self._reader_ids("service") & replies)

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        """Wait for a server; return whether there is one. Without a timeout, wait without a limit."""
        return wait_until(self.service_is_ready, timeout_sec)
