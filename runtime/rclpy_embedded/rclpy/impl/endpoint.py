"""What publishers, subscriptions, clients and services share."""

import copy
from typing import Any, ClassVar

from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState
from rclpy.callback_groups import CallbackGroup
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.impl.dds import delete, profile_from_dds
from rclpy.impl.handle import Destroyable
from rclpy.impl.session import LocalNode, Reader, Session, Writer
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy, qos_profile_best_available

from rosidl_embedded.typesupport import type_support

_STRICT_AND_LAX = {
    "reliability": (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT),
    "durability": (DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE),
    "liveliness": (LivelinessPolicy.MANUAL_BY_TOPIC, LivelinessPolicy.AUTOMATIC),
}
_POLICIES = (*_STRICT_AND_LAX, "deadline", "liveliness_lease_duration")


class Endpoint(Destroyable):
    """One or two DDS entities under a full name, announced as a node's; the first one is the handle."""

    #: What wakes the executor.
    condition: Any = None
    event_handlers: list[Any] | tuple[()] = ()

    def __init__(self, local_node: LocalNode, name: str, *entities: Reader | Writer) -> None:
        super().__init__(entities[0])
        self._local_node = local_node
        self._name = name
        self._entities = entities
        if isinstance(entities[0], Reader):
            self.condition = ReadCondition(entities[0], SampleState.Any | ViewState.Any | InstanceState.Any)
        local_node.session.add_endpoints(local_node, *entities)

    def destroy(self) -> None:
        if self._handle is not None:
            super().destroy()
            for handler in self.event_handlers:
                handler.destroy()
            delete(self.condition)
            self._local_node.session.remove_endpoints(self._local_node, *self._entities)


class TopicEndpoint(Endpoint):
    """A publisher or subscription of a `topic` (as it was given) with the full `name`."""

    _is_writer: ClassVar[bool]

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
        create = session.writer if self._is_writer else session.reader
        entity = create(dds_topic, self._support, _resolve(qos_profile, session, dds_topic, writer=self._is_writer))
        super().__init__(local_node, name, entity)
        logger_name = local_node.logger_name
        self.event_handlers = event_callbacks.create_event_handlers(callback_group, entity, topic, logger_name)

    @property
    def topic_name(self) -> str:
        """Full name of the topic."""
        self._check()
        return self._name


def _resolve(profile: QoSProfile, session: Session, dds_topic: str, *, writer: bool) -> QoSProfile:
    """Choose the BEST_AVAILABLE policies: the strictest that match what is in the graph now."""
    wanted = [name for name in _POLICIES if getattr(profile, name) == getattr(qos_profile_best_available, name)]
    if not wanted:
        return profile
    peers = [profile_from_dds(endpoint.qos) for endpoint in session.graph.endpoints_of(dds_topic, writers=not writer)]
    chosen = copy.copy(profile)
    for name in wanted:
        setattr(chosen, name, _best(name, [getattr(peer, name) for peer in peers], writer))
    return chosen


def _best(name: str, of_peers: list[Any], writer: bool) -> Any:
    if name not in _STRICT_AND_LAX:
        return (min if writer else max)(of_peers, key=lambda duration: duration.nanoseconds, default=Duration())
    strict, lax = _STRICT_AND_LAX[name]
    if not writer:  # may ask only for what every writer offers
        return strict if all(value == strict for value in of_peers) else lax
    # What a writer offers beyond need does no harm, but liveliness has to be asserted by its program.
    return strict if name != "liveliness" or strict in of_peers else lax
