"""Service introspection."""

from __future__ import annotations

from typing import Any

import pytest
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rclpy.service_introspection import ServiceIntrospectionState
from service_msgs.msg import ServiceEventInfo
from std_srvs.srv import SetBool

# Nothing is lost before the subscription is matched.
_LATCHED = QoSProfile(depth=10, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
_REQUESTS = ServiceEventInfo.REQUEST_SENT, ServiceEventInfo.REQUEST_RECEIVED
_RESPONSES = ServiceEventInfo.RESPONSE_SENT, ServiceEventInfo.RESPONSE_RECEIVED


def _answer(request: Any, response: Any) -> Any:
    response.message = f"got {request.data}"
    return response


class Talk:
    """A client and a service that are introspected."""

    def __init__(self, node: Any, spinner: Any) -> None:
        self.node, self.spinner = node, spinner
        self.client = node.create_client(SetBool, "switch")
        self.service = node.create_service(SetBool, "switch", _answer)
        self.events: list[Any] = []
        node.create_subscription(SetBool.Event, "switch/_service_event", self.events.append, _LATCHED)

    def configure(self, state: ServiceIntrospectionState) -> None:
        for end in (self.client, self.service):
            end.configure_introspection(self.node.get_clock(), _LATCHED, state)

    def call(self, expected: int) -> dict[int, Any]:
        """Call the service; return the events by kind when as many as expected are there."""
        self.events.clear()
        assert self.client.wait_for_service(120)
        future = self.client.call_async(SetBool.Request(data=True))
        assert self.spinner.until(lambda: future.done() and len(self.events) >= expected)
        self.spinner.rest()
        assert len(self.events) == expected
        return {event.info.event_type: event for event in self.events}


@pytest.fixture
def talk(node: Any, spinner: Any) -> Talk:
    return Talk(node, spinner)


def test_metadata(talk: Talk) -> None:
    talk.configure(ServiceIntrospectionState.METADATA)
    numbers: list[int] = []
    for _ in range(2):
        events = talk.call(expected=4)
        assert set(events) == {*_REQUESTS, *_RESPONSES}
        numbers += {event.info.sequence_number for event in events.values()}
        assert all(len(event.request) == len(event.response) == 0 for event in events.values())
        assert all(event.info.stamp.sec > 0 and any(event.info.client_gid) for event in events.values())
    # Those of the two calls, each the same in all its events.
    assert len(numbers) == 2 and numbers[0] < numbers[1]


def test_contents(talk: Talk) -> None:
    talk.configure(ServiceIntrospectionState.CONTENTS)
    events = talk.call(expected=4)
    for kind in _REQUESTS:
        assert [request.data for request in events[kind].request] == [True] and len(events[kind].response) == 0
    for kind in _RESPONSES:
        assert [response.message for response in events[kind].response] == ["got True"]
        assert len(events[kind].request) == 0


def test_off(talk: Talk) -> None:
    talk.call(expected=0)
    talk.configure(ServiceIntrospectionState.METADATA)
    talk.call(expected=4)
    talk.configure(ServiceIntrospectionState.OFF)
    talk.call(expected=0)


def test_the_publishers_of_events_end_with_client_and_service(talk: Talk, wait_until: Any) -> None:
    talk.configure(ServiceIntrospectionState.METADATA)
    assert wait_until(lambda: talk.node.count_publishers("switch/_service_event") == 2)
    talk.node.destroy_client(talk.client)
    talk.node.destroy_service(talk.service)
    assert wait_until(lambda: talk.node.count_publishers("switch/_service_event") == 0)
