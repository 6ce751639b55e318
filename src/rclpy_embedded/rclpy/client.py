"""Service clients."""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Callable
from typing import Any

from cyclonedds.core import DDSException, DDSStatus, WaitSet
from rclpy.callback_groups import CallbackGroup
from rclpy.context import Context
from rclpy.exceptions import RCLError
from rclpy.impl import faults
from rclpy.impl.dds import any_sample, matched, raw_type
from rclpy.impl.endpoint import Endpoint
from rclpy.impl.graph import user_data_field
from rclpy.impl.session import LocalNode, Session
from rclpy.qos import QoSProfile
from rclpy.service import HEADER
from rclpy.task import Future

from rosidl_embedded.typesupport import service_type_support

# A wait for a service looks at least this often whether the context is still up.
_LONGEST_WAIT_S = 0.25


class Client(Endpoint):
    """Sends requests; made by ``Node.create_client``."""

    def __init__(
        self,
        context: Context,
        session: Session,
        local_node: LocalNode,
        srv_type: Any,
        srv_name: str,
        qos_profile: QoSProfile,
        callback_group: CallbackGroup,
    ) -> None:
        self.context = context
        self.srv_type = srv_type
        self.srv_name = srv_name
        self.qos_profile = qos_profile
        self.callback_group = callback_group
        self._pending_requests: dict[int, Future] = {}
        self._sequence_number = 0
        self._lock = threading.Lock()
        support = service_type_support(srv_type)
        self._request, self._response = support.request, support.response
        self._sample = raw_type(self._request.dds_name)
        prefix = f"clientid={session.next_id()};"
        writer = session.writer(f"rq{srv_name}Request", self._request, qos_profile, prefix)
        reader = session.reader(f"rr{srv_name}Reply", self._response, qos_profile, prefix)
        self._guid = writer.get_instance_handle() & 0xFFFFFFFFFFFFFFFF
        self.condition = any_sample(reader)
        super().__init__(session, local_node, srv_name, reader=reader, writer=writer)

    @property
    def service_name(self) -> str:
        """Full name of the service."""
        return self._full_name()

    def call(self, request: Any, timeout_sec: float | None = None) -> Any:
        """Send a request and wait for the response. In a callback this would wait for itself.

        Returns
        -------
        response or None
            None if it did not come in time.

        Raises
        ------
        TypeError
            If the request is of a wrong type.
        """
        future = self.call_async(request)
        event = threading.Event()
        future.add_done_callback(lambda _: event.set())
        if not future.done() and not event.wait(timeout_sec):
            self.remove_pending_request(future)
        return future.result()

    def call_async(self, request: Any) -> Future:
        """Send a request; the returned future ends with the response.

        Raises
        ------
        TypeError
            If the request is of a wrong type.
        """
        if not isinstance(request, self.srv_type.Request):
            raise TypeError(f"Expected {self.srv_type.Request}, got {type(request)}")
        assert self.handle
        with self._lock:
            number = self._sequence_number + 1
            data = self._request.serialize_with_prefix(HEADER.pack(self._guid, number), request)
            self._sequence_number = number
            future = Future()
            # Known before it is sent: the response may come before write returns.
            self._pending_requests[number] = future
            try:
                self._writer.write(self._sample(data))
            except DDSException as error:
                del self._pending_requests[number]
                raise RCLError(f"failed to send request: {error}") from error
        future.add_done_callback(self.remove_pending_request)
        return future

    def get_pending_request(self, sequence_number: int) -> Future:
        """Return the future of a request; KeyError if it is not pending."""
        with self._lock:
            return self._pending_requests[sequence_number]

    def remove_pending_request(self, future: Future) -> None:
        """Forget a request: its future will never be done."""
        with self._lock:
            for number, pending in self._pending_requests.items():
                if pending is future:
                    del self._pending_requests[number]
                    break

    def take_response(self) -> tuple[int, Any] | None:
        """Take the next response to this client and the number of its request, None if there is none."""
        for sample in self.handle.take(1):
            if not sample.sample_info.valid_data:
                continue
            # Replies to all clients of the service come by; only our own are worth decoding.
            if sample.data[4:12] != self._guid.to_bytes(8, "little"):
                continue
            try:
                header, response = self._response.deserialize_with_prefix(sample.data, HEADER.size)
                return HEADER.unpack(header)[1], response
            except (ValueError, struct.error) as error:
                faults.count(self._name, f"malformed response from '{self._name}': {error}")
        return None

    def _take(self) -> Callable[[], Any] | None:
        taken = self.take_response()
        if taken is None:
            return None
        number, response = taken

        def complete() -> None:
            try:
                future = self.get_pending_request(number)
            except KeyError:  # removed
                return
            future.set_result(response)

        return complete

    def service_is_ready(self) -> bool:
        """Return whether a server is there: a request reader and a reply writer with the same service id."""
        assert self.handle
        writer, reader = self._writer, self._reader
        requests = {
            self._service_id(writer.get_matched_subscription_data, handle)
            for handle in matched(writer.get_matched_subscriptions)
        }
        replies = {
            self._service_id(reader.get_matched_publication_data, handle)
            for handle in matched(reader.get_matched_publications)
        }
        return bool(requests & replies - {None})

    @staticmethod
    def _service_id(get_data: Callable[[int], Any], handle: int) -> str | None:
        data = get_data(handle)
        return None if data is None else user_data_field(data.qos, "serviceid") or ""

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        """Wait for a server; return whether there is one. Without a timeout, wait until shutdown."""
        if self.service_is_ready():
            return True
        self._writer.set_status_mask(DDSStatus.PublicationMatched)
        self._reader.set_status_mask(DDSStatus.SubscriptionMatched)
        waitset = WaitSet(self._session.participant)
        waitset.attach(self._writer)
        waitset.attach(self._reader)
        deadline = None if timeout_sec is None or timeout_sec < 0 else time.monotonic() + timeout_sec
        while self.context.ok():
            self._writer.get_publication_matched_status()
            self._reader.get_subscription_matched_status()
            if self.service_is_ready():
                return True
            remaining = _LONGEST_WAIT_S if deadline is None else min(_LONGEST_WAIT_S, deadline - time.monotonic())
            if remaining <= 0:
                return False
            waitset.wait(int(remaining * 1e9))
        return False
