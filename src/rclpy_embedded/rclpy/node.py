"""Nodes."""

from __future__ import annotations

import contextlib
import weakref
from collections.abc import Iterator
from typing import Any

from rcl_interfaces.msg import Log, ParameterDescriptor, ParameterEvent
from rclpy import arguments, logging_rosout
from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.clock import Clock, ROSClock
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle, NotInitializedException
from rclpy.executors import Executor
from rclpy.guard_condition import GuardCondition
from rclpy.impl.session import LocalNode
from rclpy.logging import get_logger
from rclpy.names import expand_topic_name, remap
from rclpy.node_entities import NodeEntities
from rclpy.node_graph import NodeGraph
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService
from rclpy.parameter_store import ParameterStore
from rclpy.publisher import Publisher
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, qos_profile_parameter_events
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.time_source import TimeSource
from rclpy.timer import Timer
from rclpy.type_description_service import TypeDescriptionService
from rclpy.utilities import get_default_context
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_node_name import validate_node_name
from rclpy.validate_topic_name import validate_topic_name
from rclpy.waitable import Waitable


def _rosout_profile() -> QoSProfile:
    from rclpy.duration import Duration

    return QoSProfile(depth=1000, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL, lifespan=Duration(seconds=10))


class Node(NodeEntities, NodeGraph, ParameterStore):
    """A node of the graph: the way to publishers, subscriptions, timers, services, clients and parameters.

    Parameters
    ----------
    node_name : str
        Name, without namespace.
    context : Context, optional
        The global context by default.
    cli_args : list of str, optional
        Command line for this node only, with its ``--ros-args``.
    namespace : str, optional
        Namespace, '/' by default.
    use_global_arguments : bool
        Whether the command line of the context applies.
    enable_rosout : bool
        Whether log messages go to /rosout.
    start_parameter_services : bool
        Whether other nodes can reach the parameters.
    parameter_overrides : list of Parameter, optional
        Values that replace the defaults at declaration; they win over command line and files.
    allow_undeclared_parameters : bool
        Whether parameters can be used without being declared.
    automatically_declare_parameters_from_overrides : bool
        Whether all overrides are declared at once.
    enable_logger_service : bool
        Whether other nodes can change log levels.

    Raises
    ------
    NotInitializedException
        If the context is not initialized.
    InvalidNodeNameException, InvalidNamespaceException
        If a name is invalid.
    """

    def __init__(
        self,
        node_name: str,
        *,
        context: Context | None = None,
        cli_args: list[str] | None = None,
        namespace: str | None = None,
        use_global_arguments: bool = True,
        enable_rosout: bool = True,
        start_parameter_services: bool = True,
        parameter_overrides: list[Parameter] | None = None,
        allow_undeclared_parameters: bool = False,
        automatically_declare_parameters_from_overrides: bool = False,
        enable_logger_service: bool = False,
    ) -> None:
        self._alive = False
        self._context = get_default_context() if context is None else context
        if not self._context.ok():
            raise NotInitializedException("cannot create node")
        self._session = self._context.session
        local = arguments.parse(cli_args) if cli_args else None
        global_ = self._context.arguments if use_global_arguments else None
        self._rules = arguments.rules_for(local, global_)
        validate_node_name(node_name)
        namespace = "/" + (namespace or "").removeprefix("/")
        validate_namespace(namespace)
        self._name, self._namespace = arguments.remap_node(node_name, namespace, self._rules)
        overrides = arguments.parameter_overrides(self.get_fully_qualified_name(), local, global_)
        overrides.update({parameter.name: parameter for parameter in parameter_overrides or []})
        ParameterStore.__init__(
            self, overrides, allow_undeclared=allow_undeclared_parameters, publish_event=self._publish_event
        )
        NodeEntities.__init__(self)
        self._executor: weakref.ref[Executor] | None = None
        self._clock = ROSClock()
        self._logger_name = self.get_fully_qualified_name()[1:].replace("/", ".")
        self._logger = get_logger(self._logger_name)
        self._local_node = LocalNode(self._namespace, self._name)
        self._session.add_node(self._local_node)
        self._alive = True
        self._context._nodes.add(self)

        self._rosout: Publisher | None = None
        if enable_rosout and (global_ is None or global_.rosout_logs) and (local is None or local.rosout_logs):
            self._rosout = self._new_publisher(Log, "/rosout", _rosout_profile())
            logging_rosout.attach(self._logger_name, self._rosout.publish)
        self._parameter_event_publisher: Publisher | None = self.create_publisher(
            ParameterEvent, "/parameter_events", qos_profile_parameter_events
        )
        if automatically_declare_parameters_from_overrides:
            self.declare_parameters(
                "",
                [(name, parameter.value, ParameterDescriptor()) for name, parameter in overrides.items()],
                ignore_override=True,
            )
        self._time_source = TimeSource(node=self)
        self._time_source.attach_clock(self._clock)
        if start_parameter_services:
            self._parameter_service = ParameterService(self)
        if enable_logger_service:
            from rclpy.logging_service import LoggingService

            self._logger_service = LoggingService(self)
        self._type_description_service = TypeDescriptionService(self)

    def __enter__(self) -> Node:
        return self

    def __exit__(self, *_: Any) -> None:
        self.destroy_node()

    def __del__(self) -> None:
        if getattr(self, "_alive", False):
            with contextlib.suppress(Exception):
                self.destroy_node()

    def _publish_event(self, event: ParameterEvent) -> None:
        if self._parameter_event_publisher is not None:
            event.node = self.get_fully_qualified_name()
            event.stamp = self._clock.now().to_msg()
            self._parameter_event_publisher.publish(event)

    # Properties

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
        yield from self._waitables

    @property
    def executor(self) -> Executor | None:
        """The executor the node was added to last; setting it moves the node."""
        return self._executor() if self._executor is not None else None

    @executor.setter
    def executor(self, new_executor: Executor | None) -> None:
        current = self.executor
        if current is new_executor:
            return
        if current is not None:
            current.remove_node(self)
        self._executor = None
        if new_executor is not None:
            self._executor = weakref.ref(new_executor)
            new_executor.add_node(self)

    def _wake_executor(self) -> None:
        executor = self.executor
        if executor is not None:
            executor._notice()

    @property
    def context(self) -> Context:
        """The context of this node."""
        return self._context

    @property
    def default_callback_group(self) -> CallbackGroup:
        """The group of everything that is created without one."""
        return self._default_callback_group

    @property
    def handle(self) -> LocalNode:
        """What the middleware announces of this node.

        Raises
        ------
        InvalidHandle
            After destruction.
        """
        if not self._alive:
            raise InvalidHandle("Cannot use Destroyable because destruction was requested")
        return self._local_node

    # Names

    def get_name(self) -> str:
        """Return the name, after remapping."""
        return self._name

    def get_namespace(self) -> str:
        """Return the namespace, after remapping."""
        return self._namespace

    def get_fully_qualified_name(self) -> str:
        """Return namespace and name."""
        return f"{self._namespace.rstrip('/')}/{self._name}"

    def get_clock(self) -> Clock:
        """Return the clock, ROS time."""
        return self._clock

    def get_logger(self) -> Any:
        """Return the logger."""
        return self._logger

    def _resolve(self, name: str, *, is_service: bool, only_expand: bool = False) -> str:
        validate_topic_name(name, is_service=is_service)
        full = expand_topic_name(name, self._name, self._namespace)
        validate_full_topic_name(full, is_service=is_service)
        if only_expand:
            return full
        return remap(full, self._name, self._namespace, self._rules, is_service=is_service)

    def _remapped(self, full_name: str) -> str:
        return remap(full_name, self._name, self._namespace, self._rules)

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        """Return the full name of a topic, after remapping unless `only_expand`."""
        return self._resolve(topic, is_service=False, only_expand=only_expand)

    def resolve_service_name(self, service: str, *, only_expand: bool = False) -> str:
        """Return the full name of a service, after remapping unless `only_expand`."""
        return self._resolve(service, is_service=True, only_expand=only_expand)

    def destroy_node(self) -> None:
        """Destroy the node and everything it created; harmless when done twice."""
        if not self._alive:
            return
        self._alive = False
        self._parameter_event_publisher = None
        self._destroy_all()
        if self._rosout is not None:
            logging_rosout.detach(self._logger_name, self._rosout.publish)
            self._rosout.destroy()
        self._session.remove_node(self._local_node)
        executor = self.executor
        if executor is not None:
            executor.remove_node(self)
        self._context._nodes.discard(self)
        self._context._close_when_unused()
