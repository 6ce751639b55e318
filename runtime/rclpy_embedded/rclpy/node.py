"""Nodes."""

from __future__ import annotations

import contextlib
import weakref
from typing import Any

from rcl_interfaces.msg import Log, ParameterDescriptor, ParameterEvent
from rclpy import arguments, names
from rclpy.clock import Clock, ROSClock
from rclpy.context import Context, context_or_default
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.exceptions import InvalidHandle, NotInitializedException
from rclpy.executors import Executor
from rclpy.impl.handle import DESTROYED
from rclpy.impl.logging_output import system
from rclpy.impl.session import LocalNode
from rclpy.logging import get_logger
from rclpy.logging_service import LoggingService
from rclpy.node_entities import NodeEntities
from rclpy.node_graph import NodeGraph
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService
from rclpy.parameter_store import ParameterStore
from rclpy.publisher import Publisher
from rclpy.qos import qos_profile_parameter_events, qos_profile_rosout_default
from rclpy.time_source import TimeSource
from rclpy.type_description_service import TypeDescriptionService


class Node(NodeEntities, NodeGraph, ParameterStore):
    """A node, with its publishers, subscriptions, timers, services, clients and parameters.

    `cli_args` is a command line for this node only; that of the context applies too if `use_global_arguments`.
    `parameter_overrides` replace the defaults at declaration, and win over command lines and files. With
    `automatically_declare_parameters_from_overrides` all of them are declared at once.
    """

    # Private beyond what genuine rclpy keeps under a single underscore: nodes in the field use such names themselves.
    __handle: LocalNode | None = None
    __rosout: Publisher | None = None

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
        self._context = context_or_default(context)
        if not self._context.ok():
            raise NotInitializedException("cannot create node")
        session = self._context.session
        local = arguments.parse(cli_args) if cli_args else None
        global_ = self._context.arguments if use_global_arguments else None
        self.__rules = [rule for given in (local, global_) if given for rule in given.remap_rules]
        names.validate_node_name(node_name)
        namespace = "/" + (namespace or "").removeprefix("/")
        names.validate_namespace(namespace)
        name, namespace = names.remap_node(node_name, namespace, self.__rules)
        local_node = LocalNode(session, namespace, name)
        overrides = arguments.parameter_overrides(local_node.full_name, local, global_)
        overrides.update({parameter.name: parameter for parameter in parameter_overrides or []})
        ParameterStore.__init__(
            self, overrides, allow_undeclared=allow_undeclared_parameters, publish_event=self.__publish_event
        )
        NodeEntities.__init__(self)
        self.__executor: weakref.ref[Executor] | None = None
        self._clock = ROSClock()
        self._logger = get_logger(local_node.logger_name)
        session.add_node(local_node)
        self.__handle = local_node
        self._context._nodes.add(self)

        if enable_rosout and all(settings is None or settings.rosout_logs for settings in (local, global_)):
            topic, callbacks, group = "/rosout", PublisherEventCallbacks(), self._default_callback_group
            name = self.resolve_topic_name(topic)
            self.__rosout = Publisher(local_node, Log, topic, name, qos_profile_rosout_default, callbacks, group)
            system.attach(local_node.logger_name, self.__rosout.publish)
        self._parameter_event_publisher: Publisher | None = self.create_publisher(
            ParameterEvent, "/parameter_events", qos_profile_parameter_events
        )
        if automatically_declare_parameters_from_overrides:
            declarations = [(name, parameter.value, ParameterDescriptor()) for name, parameter in overrides.items()]
            self.declare_parameters("", declarations, ignore_override=True)
        self._time_source = TimeSource(node=self)
        self._time_source.attach_clock(self._clock)
        if start_parameter_services:
            self._parameter_service = ParameterService(self)
        if enable_logger_service:
            self._logger_service = LoggingService(self)
        self._type_description_service = TypeDescriptionService(self)

    def __enter__(self) -> Node:
        return self

    def __exit__(self, *_: Any) -> None:
        self.destroy_node()

    def __del__(self) -> None:
        if self.__handle is not None:
            with contextlib.suppress(Exception):
                self.destroy_node()

    def __publish_event(self, event: ParameterEvent) -> None:
        if (publisher := self._parameter_event_publisher) is not None:
            event.node = self.get_fully_qualified_name()
            event.stamp = self._clock.now().to_msg()
            publisher.publish(event)

    @property
    def executor(self) -> Executor | None:
        """The executor the node was added to last; setting it moves the node."""
        return self.__executor() if self.__executor is not None else None

    @executor.setter
    def executor(self, new_executor: Executor | None) -> None:
        current = self.executor
        if current is new_executor:
            return
        if current is not None:
            current.remove_node(self)
        self.__executor = None
        if new_executor is not None:
            self.__executor = weakref.ref(new_executor)
            new_executor.add_node(self)

    def _wake_executor(self) -> None:
        executor = self.executor
        if executor is not None:
            executor._notice()

    @property
    def context(self) -> Context:
        return self._context

    @property
    def handle(self) -> LocalNode:  # type: ignore[override]
        """What the middleware announces of this node; InvalidHandle after destruction."""
        handle = self.__handle
        if handle is None:
            raise InvalidHandle(DESTROYED)
        return handle

    def get_name(self) -> str:
        """Return the name, after remapping."""
        return self.handle.name

    def get_namespace(self) -> str:
        """Return the namespace, after remapping."""
        return self.handle.namespace

    def get_fully_qualified_name(self) -> str:
        return self.handle.full_name

    def get_clock(self) -> Clock:
        return self._clock

    def get_logger(self) -> Any:
        return self._logger

    def __resolve(self, name: str, *, is_service: bool, only_expand: bool) -> str:
        names.validate_topic_name(name, is_service=is_service)
        full = names.expand_topic_name(name, self.get_name(), self.get_namespace())
        names.validate_full_topic_name(full, is_service=is_service)
        if only_expand:
            return full
        return names.remap(full, self.get_name(), self.get_namespace(), self.__rules, is_service=is_service)

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        """Return the full name of a topic, after remapping unless `only_expand`."""
        return self.__resolve(topic, is_service=False, only_expand=only_expand)

    def resolve_service_name(self, service: str, *, only_expand: bool = False) -> str:
        """Return the full name of a service, after remapping unless `only_expand`."""
        return self.__resolve(service, is_service=True, only_expand=only_expand)

    def destroy_node(self) -> None:
        """Destroy the node and everything it created."""
        handle, self.__handle = self.__handle, None
        if handle is None:
            return
        self._parameter_event_publisher = None
        super().destroy_node()
        if self.__rosout is not None:
            system.detach(handle.logger_name, self.__rosout.publish)
            self.__rosout.destroy()
        handle.session.remove_node(handle)
        executor = self.executor
        if executor is not None:
            executor.remove_node(self)
        self._context._nodes.discard(self)
        self._context._close_when_unused()
