"""The entities of a node: publishers, subscriptions, clients, services, timers, guard conditions."""

from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.clock import Clock
from rclpy.constants import S_TO_NS
from rclpy.context import Context
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.impl.session import LocalNode
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, qos_profile_services_default
from rclpy.qos_overriding_options import QoSOverridingOptions, _declare_qos_parameters
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Rate, Timer
from rclpy.type_support import check_is_valid_msg_type, check_is_valid_srv_type
from rclpy.waitable import Waitable

Entity = TypeVar("Entity", Publisher, Subscription, Client, Service, Timer, GuardCondition)


def _profile(qos_or_depth: QoSProfile | int) -> QoSProfile:
    if isinstance(qos_or_depth, QoSProfile):
        return qos_or_depth
    if not isinstance(qos_or_depth, int):
        raise TypeError(f"Expected QoSProfile or int, but received {type(qos_or_depth)!r}")
    if qos_or_depth < 0:
        raise ValueError("history depth must be greater than or equal to zero")
    return QoSProfile(depth=qos_or_depth)


def _remove(entities: list[Any], entity: Any) -> bool:
    """Remove an entity; return whether it was there, to one of several threads."""
    try:
        entities.remove(entity)
    except ValueError:
        return False
    return True


class NodeEntities:
    """The entities of a Node, and the methods that make and destroy them."""

    _context: Context
    _clock: Clock
    handle: LocalNode
    resolve_topic_name: Callable[..., str]
    resolve_service_name: Callable[..., str]
    _wake_executor: Callable[[], None]

    def __init__(self) -> None:
        self.publishers: list[Publisher] = []
        self.subscriptions: list[Subscription] = []
        self.clients: list[Client] = []
        self.services: list[Service] = []
        self.timers: list[Timer] = []
        self.guards: list[GuardCondition] = []
        self.__waitables: list[Waitable] = []
        self._default_callback_group: CallbackGroup = MutuallyExclusiveCallbackGroup()
        self._rate_group = ReentrantCallbackGroup()

    @property
    def waitables(self) -> Iterator[Waitable]:
        """Event handlers, and the waitables that were added."""
        yield from self.__waitables

    @property
    def default_callback_group(self) -> CallbackGroup:
        """The group of all entities that are created without one."""
        return self._default_callback_group

    def __make(self, entities: list[Entity], kind: type[Entity], *args: Any, **options: Any) -> Entity:
        with self.handle.session.using(f"failed to create {kind.__name__.lower()}"):
            entity = kind(*args, **options)
        if entity.callback_group is not None and not isinstance(entity, Publisher):
            entity.callback_group.add_entity(entity)
        entities.append(entity)
        self.__waitables.extend(getattr(entity, "event_handlers", ()))
        try:
            _ = self.handle
        except InvalidHandle:  # another thread has destroyed the node, perhaps before it could see this entity
            self.__destroy(entity)
            raise
        self._wake_executor()
        return entity

    def __topic(
        self,
        kind: type[Publisher | Subscription],
        msg_type: Any,
        topic: str,
        qos: QoSProfile | int,
        options: QoSOverridingOptions | None,
    ) -> tuple[LocalNode, Any, str, str, QoSProfile]:
        """Return the arguments of a publisher or subscription to be made."""
        profile = _profile(qos)
        check_is_valid_msg_type(msg_type)
        name = self.resolve_topic_name(topic)
        if options is not None:
            profile = profile.get_c_qos_profile()  # a copy: it is the caller's
            _declare_qos_parameters(kind, self, name, profile, options)
        return self.handle, msg_type, topic, name, profile

    def create_publisher(
        self,
        msg_type: Any,
        topic: str,
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: PublisherEventCallbacks | None = None,
        qos_overriding_options: QoSOverridingOptions | None = None,
        publisher_class: type[Publisher] = Publisher,
    ) -> Publisher:
        """Create a publisher; an int as QoS is the depth of the default profile."""
        group, callbacks = callback_group or self._default_callback_group, event_callbacks or PublisherEventCallbacks()
        arguments = self.__topic(Publisher, msg_type, topic, qos_profile, qos_overriding_options)
        return self.__make(self.publishers, publisher_class, *arguments, callbacks, group)

    def create_subscription(
        self,
        msg_type: Any,
        topic: str,
        callback: Callable[..., Any],
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: SubscriptionEventCallbacks | None = None,
        qos_overriding_options: QoSOverridingOptions | None = None,
        raw: bool = False,
    ) -> Subscription:
        """Create a subscription; its callback takes the message, or the message and its MessageInfo.

        With `raw` the callback gets the bytes of the serialized message.
        """
        group = callback_group or self._default_callback_group
        callbacks = event_callbacks or SubscriptionEventCallbacks()
        arguments = self.__topic(Subscription, msg_type, topic, qos_profile, qos_overriding_options)
        return self.__make(self.subscriptions, Subscription, *arguments, callbacks, group, callback=callback, raw=raw)

    def create_client(
        self,
        srv_type: Any,
        srv_name: str,
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Client:
        group = callback_group or self._default_callback_group
        check_is_valid_srv_type(srv_type)
        name = self.resolve_service_name(srv_name)
        arguments = self.handle, srv_type, srv_name, name, qos_profile, group
        return self.__make(self.clients, Client, *arguments, context=self._context)

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Service:
        """Create a service server; its callback takes request and response, and returns the response."""
        group = callback_group or self._default_callback_group
        check_is_valid_srv_type(srv_type)
        name = self.resolve_service_name(srv_name)
        arguments = self.handle, srv_type, srv_name, name, qos_profile, group
        return self.__make(self.services, Service, *arguments, callback=callback)

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[..., Any] | None,
        callback_group: CallbackGroup | None = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Timer:
        """Create a timer that runs on the node's clock, or on another one."""
        group, period_ns = callback_group or self._default_callback_group, int(float(timer_period_sec) * S_TO_NS)
        arguments = callback, group, period_ns, clock or self._clock
        return self.__make(self.timers, Timer, *arguments, context=self._context, autostart=autostart)

    def create_guard_condition(
        self, callback: Callable[[], Any], callback_group: CallbackGroup | None = None
    ) -> GuardCondition:
        group = callback_group or self._default_callback_group
        return self.__make(self.guards, GuardCondition, callback, group, context=self._context)

    def create_rate(self, frequency: float, clock: Clock | None = None) -> Rate:
        if frequency <= 0:
            raise ValueError("frequency must be > 0")
        timer = self.create_timer(1.0 / frequency, None, self._rate_group, clock)
        return Rate(timer, context=self._context)

    def add_waitable(self, waitable: Waitable) -> None:
        self.__waitables.append(waitable)
        self._wake_executor()

    def remove_waitable(self, waitable: Waitable) -> None:
        self.__waitables.remove(waitable)
        self._wake_executor()

    @property
    def __lists(self) -> tuple[list[Any], ...]:
        return self.publishers, self.subscriptions, self.clients, self.services, self.timers, self.guards

    def __destroy(self, entity: Any) -> bool:
        """Destroy an entity of this node; return False if it is not one."""
        if not any(_remove(entities, entity) for entities in self.__lists):
            return False
        for handler in getattr(entity, "event_handlers", ()):
            _remove(self.__waitables, handler)
        entity.destroy()
        self._wake_executor()
        return True

    destroy_publisher = destroy_subscription = destroy_client = __destroy
    destroy_service = destroy_timer = destroy_guard_condition = __destroy

    def destroy_rate(self, rate: Rate) -> bool:
        """Destroy a rate of this node; return False if it is not one."""
        done = self.__destroy(rate._timer)
        rate.destroy()
        return done

    def destroy_node(self) -> None:
        for entities in self.__lists:
            for entity in list(entities):
                self.__destroy(entity)
        for waitable in list(self.__waitables):
            waitable._end()
