"""Service introspection: requests and responses as events on ``<service>/_service_event``."""

from enum import IntEnum
from typing import Any

from rclpy.clock import Clock
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.impl.endpoint import RequestId, ServiceEndpoint
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from service_msgs.msg import ServiceEventInfo


class ServiceIntrospectionState(IntEnum):
    """What is published: nothing, what happens, or also what the requests and responses hold."""

    OFF = 0
    METADATA = 1
    CONTENTS = 2


class IntrospectedEndpoint(ServiceEndpoint):
    """A client or a service that may publish what it sends and receives."""

    __events: Publisher | None = None

    def configure_introspection(
        self, clock: Clock, service_event_qos_profile: QoSProfile, introspection_state: ServiceIntrospectionState
    ) -> None:
        """Publish events from now on, or stop that; the stamps are those of the clock."""
        if self.__events is not None:
            self.__events.destroy()
        self.__clock, self.__state, self.__events = clock, introspection_state, None
        if introspection_state is not ServiceIntrospectionState.OFF:
            name = f"{self.service_name}/_service_event"
            topic = self._local_node, self.srv_type.Event, name, name, service_event_qos_profile
            callbacks = PublisherEventCallbacks(use_default_callbacks=False)
            self.__events = Publisher(*topic, callbacks, self.callback_group)

    def _tell(self, event_type: int, request_id: RequestId, message: Any) -> None:
        """Publish the event, if that is wanted, that a request or a response was sent or received."""
        if self.__events is None:
            return
        info = ServiceEventInfo(event_type=event_type, stamp=self.__clock.now().to_msg())
        info.client_gid[:8] = list(request_id.writer_guid.to_bytes(8, "little"))
        info.sequence_number = request_id.sequence_number
        event = self.srv_type.Event(info=info)
        if self.__state is ServiceIntrospectionState.CONTENTS:
            is_request = event_type in (ServiceEventInfo.REQUEST_SENT, ServiceEventInfo.REQUEST_RECEIVED)
            (event.request if is_request else event.response).append(message)
        self.__events.publish(event)

    def _clean_up(self) -> None:
        if self.__events is not None:
            self.__events.destroy()
        super()._clean_up()
