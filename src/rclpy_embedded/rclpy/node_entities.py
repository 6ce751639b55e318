"""What a node creates and destroys: publishers, subscriptions, clients, services, timers, guard conditions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, cast

from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.clock import Clock
from rclpy.constants import S_TO_NS
from rclpy.context import Context
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.guard_condition import GuardCondition
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, qos_profile_services_default
from rclpy.qos_overriding_options import QoSOverridingOptions, declare_qos_parameters
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Rate, Timer
from rclpy.type_support import check_is_valid_msg_type, check_is_valid_srv_type
from rclpy.waitable import Waitable

if TYPE_CHECKING:
    from rclpy.impl.session import LocalNode
    from rclpy.node import Node


class NodeEntities:
    """The entities of a Node, and the methods that make and destroy them."""

    _context: Context
    _clock: Clock
    resolve_topic_name: Callable[..., str]
    resolve_service_name: Callable[..., str]
    _wake_executor: Callable[[], None]

    if TYPE_CHECKING:

        @property
        def handle(self) -> LocalNode: ...

    def __init__(self) -> None:
        self._publishers: list[Publisher] = []
        self._subscriptions: list[Subscription] = []
        self._clients: list[Client] = []
        self._services: list[Service] = []
        self._timers: list[Timer] = []
        self._guards: list[GuardCondition] = []
        self.__waitables: list[Waitable] = []
        self._default_callback_group: CallbackGroup = MutuallyExclusiveCallbackGroup()
        self._rate_group = ReentrantCallbackGroup()

    @property
    def publishers(self) -> Iterator[Publisher]:
        """Publishers of this node."""
        yield from self._publishers

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Subscriptions of this node."""
        yield from self._subscriptions

    @property
    def clients(self) -> Iterator[Client]:
        """Service clients of this node."""
        yield from self._clients

    @property
    def services(self) -> Iterator[Service]:
        """Service servers of this node."""
        yield from self._services

    @property
    def timers(self) -> Iterator[Timer]:
        """Timers of this node."""
        yield from self._timers

    @property
    def guards(self) -> Iterator[GuardCondition]:
        """Guard conditions of this node."""
        yield from self._guards

    @property
    def waitables(self) -> Iterator[Waitable]:
        """Waitables of this node: event handlers, and what was added."""
        yield from self.__waitables

    @property
    def default_callback_group(self) -> CallbackGroup:
        """The group of everything that is created without one."""
        return self._default_callback_group

    # Creating

    @staticmethod
    def __profile(qos_or_depth: QoSProfile | int) -> QoSProfile:
        if isinstance(qos_or_depth, QoSProfile):
            return qos_or_depth
        if not isinstance(qos_or_depth, int):
            raise TypeError(f"Expected QoSProfile or int, but received {type(qos_or_depth)!r}")
        if qos_or_depth < 0:
            raise ValueError("history depth must be greater than or equal to zero")
        return QoSProfile(depth=qos_or_depth)

    def __add(self, entity: Any, entities: list[Any]) -> None:
        entity.callback_group.add_entity(entity)
        entities.append(entity)
        self._wake_executor()

    def __topic(
        self,
        msg_type: Any,
        topic: str,
        qos_profile: QoSProfile | int,
        options: QoSOverridingOptions | None,
        *,
        writer: bool,
    ) -> tuple[str, QoSProfile]:
        """Return full name and profile of a publisher or subscription to be made."""
        profile = self.__profile(qos_profile)
        check_is_valid_msg_type(msg_type)
        name = self.resolve_topic_name(topic)
        if options is not None:
            kind = "publisher" if writer else "subscription"
            profile = declare_qos_parameters(kind, cast("Node", self), name, profile, options)
        return name, profile

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
        """Create a publisher; an int as QoS is the depth of the default profile.

        Raises
        ------
        InvalidTopicNameException
            If the name is invalid.
        """
        group = callback_group or self._default_callback_group
        name, profile = self.__topic(msg_type, topic, qos_profile, qos_overriding_options, writer=True)
        callbacks = event_callbacks or PublisherEventCallbacks()
        publisher = publisher_class(self.handle, msg_type, topic, name, profile, callbacks, group)
        self._publishers.append(publisher)
        self.__waitables.extend(publisher.event_handlers)
        self._wake_executor()
        return publisher

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

        Raises
        ------
        InvalidTopicNameException
            If the name is invalid.
        RuntimeError
            If the callback takes neither one nor two arguments.
        """
        group = callback_group or self._default_callback_group
        name, profile = self.__topic(msg_type, topic, qos_profile, qos_overriding_options, writer=False)
        callbacks = event_callbacks or SubscriptionEventCallbacks()
        subscription = Subscription(
            self.handle, msg_type, topic, name, profile, callbacks, group, callback=callback, raw=raw
        )
        self.__waitables.extend(subscription.event_handlers)
        self.__add(subscription, self._subscriptions)
        return subscription

    def create_client(
        self,
        srv_type: Any,
        srv_name: str,
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Client:
        """Create a service client; InvalidServiceNameException if the name is invalid."""
        group = callback_group or self._default_callback_group
        check_is_valid_srv_type(srv_type)
        name = self.resolve_service_name(srv_name)
        client = Client(self.handle, srv_type, srv_name, name, qos_profile, group, context=self._context)
        self.__add(client, self._clients)
        return client

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Service:
        """Create a service server; its callback takes request and response, and returns the response.

        Raises
        ------
        InvalidServiceNameException
            If the name is invalid.
        """
        group = callback_group or self._default_callback_group
        check_is_valid_srv_type(srv_type)
        name = self.resolve_service_name(srv_name)
        service = Service(self.handle, srv_type, srv_name, name, qos_profile, group, callback=callback)
        self.__add(service, self._services)
        return service

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[..., Any] | None,
        callback_group: CallbackGroup | None = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Timer:
        """Create a timer that counts in the node's clock (or another one)."""
        group = callback_group or self._default_callback_group
        timer = Timer(
            callback,
            group,
            int(float(timer_period_sec) * S_TO_NS),
            clock or self._clock,
            context=self._context,
            autostart=autostart,
        )
        self.__add(timer, self._timers)
        return timer

    def create_guard_condition(
        self, callback: Callable[[], Any], callback_group: CallbackGroup | None = None
    ) -> GuardCondition:
        """Create a guard condition, whose callback is called after its ``trigger``."""
        group = callback_group or self._default_callback_group
        guard = GuardCondition(callback, group, context=self._context)
        self.__add(guard, self._guards)
        return guard

    def create_rate(self, frequency: float, clock: Clock | None = None) -> Rate:
        """Create a rate of `frequency` Hz; ValueError unless it is positive."""
        if frequency <= 0:
            raise ValueError("frequency must be > 0")
        timer = self.create_timer(1.0 / frequency, None, self._rate_group, clock)
        return Rate(timer, context=self._context)

    def add_waitable(self, waitable: Waitable) -> None:
        """Have an executor wait for something else."""
        self.__waitables.append(waitable)
        self._wake_executor()

    def remove_waitable(self, waitable: Waitable) -> None:
        """Undo `add_waitable`."""
        self.__waitables.remove(waitable)
        self._wake_executor()

    # Destroying

    def __destroy(self, entity: Any, entities: list[Any]) -> bool:
        if entity not in entities:
            return False
        entities.remove(entity)
        for handler in getattr(entity, "event_handlers", ()):
            self.__waitables.remove(handler)
        entity.destroy()
        self._wake_executor()
        return True

    def destroy_publisher(self, publisher: Publisher) -> bool:
        """Destroy a publisher of this node; return whether it was one."""
        return self.__destroy(publisher, self._publishers)

    def destroy_subscription(self, subscription: Subscription) -> bool:
        """Destroy a subscription of this node; return whether it was one."""
        return self.__destroy(subscription, self._subscriptions)

    def destroy_client(self, client: Client) -> bool:
        """Destroy a client of this node; return whether it was one."""
        return self.__destroy(client, self._clients)

    def destroy_service(self, service: Service) -> bool:
        """Destroy a service of this node; return whether it was one."""
        return self.__destroy(service, self._services)

    def destroy_timer(self, timer: Timer) -> bool:
        """Destroy a timer of this node; return whether it was one."""
        return self.__destroy(timer, self._timers)

    def destroy_guard_condition(self, guard: GuardCondition) -> bool:
        """Destroy a guard condition of this node; return whether it was one."""
        return self.__destroy(guard, self._guards)

    def destroy_rate(self, rate: Rate) -> bool:
        """Destroy a rate of this node; return whether it was one."""
        done = self.destroy_timer(rate._timer)
        rate.destroy()
        return done

    def destroy_node(self) -> None:
        """Destroy everything that is left."""
        for entities in (
            self._publishers,
            self._subscriptions,
            self._clients,
            self._services,
            self._timers,
            self._guards,
        ):
            while entities:
                self.__destroy(entities[0], entities)
