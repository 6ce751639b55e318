"""What publishers, subscriptions, clients and services share."""

from typing import Any, ClassVar

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.impl.best_available import resolve
from rclpy.impl.dds import any_sample, delete
from rclpy.impl.handle import Destroyable
from rclpy.impl.session import LocalNode, Reader, Writer
from rclpy.qos import QoSProfile

from rosidl_embedded.typesupport import type_support


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
            self.condition = any_sample(entities[0])
        local_node.session.add_endpoints(local_node, *entities)

    def destroy(self) -> None:
        """Remove it from the graph; programs call the node's method for this."""
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
        self._support = type_support(msg_type)
        session, dds_topic = local_node.session, "rt" + name
        create = session.writer if self._is_writer else session.reader
        entity = create(dds_topic, self._support, resolve(qos_profile, session, dds_topic, writer=self._is_writer))
        super().__init__(local_node, name, entity)
        logger_name = local_node.logger_name
        self.event_handlers = event_callbacks.create_event_handlers(callback_group, entity, topic, logger_name)

    @property
    def topic_name(self) -> str:
        """Full name of the topic."""
        self._check()
        return self._name
