"""Callbacks for changes of parameters, of this node or of others."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import chain
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterEvent
from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_parameter_events
from rclpy.qos_overriding_options import QoSOverridingOptions


@dataclass(frozen=True, eq=False)
class ParameterCallbackHandle:
    """One callback for one parameter; needed to remove it."""

    parameter_name: str
    node_name: str
    callback: Callable[[Any], None]


@dataclass(frozen=True, eq=False)
class ParameterEventCallbackHandle:
    """One callback for every event; needed to remove it."""

    callback: Callable[[Any], None]


class Callbacks:
    """What is called with the events that come."""

    def __init__(self) -> None:
        self.parameter_callbacks: dict[tuple[str, str], list[ParameterCallbackHandle]] = defaultdict(list)
        self.event_callbacks: list[ParameterEventCallbackHandle] = []

    def event_callback(self, event: ParameterEvent) -> None:
        """Call what was added for the parameters of an event, and for any event."""
        # Copies: a callback or another thread may add and remove some meanwhile.
        for (parameter_name, node_name), handles in list(self.parameter_callbacks.items()):
            parameter = ParameterEventHandler.get_parameter_from_event(event, parameter_name, node_name)
            if parameter is not None:
                for handle in list(handles):
                    handle.callback(parameter)
        for entry in list(self.event_callbacks):
            entry.callback(event)

    def _alike(self, handle: Any) -> list[Any]:
        """Return the list that a handle belongs to."""
        if isinstance(handle, ParameterCallbackHandle):
            return self.parameter_callbacks[handle.parameter_name, handle.node_name]
        return self.event_callbacks

    def add(self, handle: Any) -> None:
        """Add a handle before the others of its kind."""
        self._alike(handle).insert(0, handle)

    def remove(self, handle: Any) -> None:
        """Remove a handle; RuntimeError if it is not there."""
        try:
            self._alike(handle).remove(handle)
        except ValueError:
            raise RuntimeError("Callback doesn't exist") from None


class ParameterEventHandler:
    """Listens to ``/parameter_events`` and calls what was added for a parameter or for any event, the latest first.

    Parameters
    ----------
    node : Node
        Has to be spun.
    qos_profile, callback_group, event_callbacks, qos_overriding_options
        Those of the subscription.
    """

    def __init__(
        self,
        node: Node,
        qos_profile: QoSProfile = qos_profile_parameter_events,
        callback_group: CallbackGroup | None = None,
        event_callbacks: SubscriptionEventCallbacks | None = None,
        qos_overriding_options: QoSOverridingOptions | None = None,
    ) -> None:
        self.node = node
        self.qos_profile = qos_profile
        self._callbacks = Callbacks()
        self.parameter_event_subscription = node.create_subscription(
            ParameterEvent,
            "/parameter_events",
            self._callbacks.event_callback,
            qos_profile,
            callback_group=callback_group,
            event_callbacks=event_callbacks,
            qos_overriding_options=qos_overriding_options,
        )

    def destroy(self) -> None:
        """Stop listening."""
        self.node.destroy_subscription(self.parameter_event_subscription)

    @staticmethod
    def get_parameter_from_event(event: ParameterEvent, parameter_name: str, node_name: str) -> Parameter | None:
        """Return the new or changed parameter of a node (full name) from an event, None if it is not in there."""
        if event.node != node_name:
            return None
        parameters = ParameterEventHandler.get_parameters_from_event(event)
        return next((parameter for parameter in parameters if parameter.name == parameter_name), None)

    @staticmethod
    def get_parameters_from_event(event: ParameterEvent) -> Iterable[Parameter]:
        """Return all new and changed parameters of an event."""
        return chain(event.new_parameters, event.changed_parameters)

    def add_parameter_callback(
        self, parameter_name: str, node_name: str, callback: Callable[[Any], None]
    ) -> ParameterCallbackHandle:
        """Have `callback` called with the parameter message when that parameter of that node is set.

        A relative `node_name` is in the namespace of the handler's node, an empty one is that node.
        """
        handle = ParameterCallbackHandle(parameter_name, self._resolve_path(node_name), callback)
        self._callbacks.add(handle)
        return handle

    def remove_parameter_callback(self, handle: ParameterCallbackHandle) -> None:
        """Undo `add_parameter_callback`; RuntimeError if that was done before."""
        self._callbacks.remove(handle)

    def add_parameter_event_callback(self, callback: Callable[[Any], None]) -> ParameterEventCallbackHandle:
        """Have `callback` called with every parameter event."""
        handle = ParameterEventCallbackHandle(callback)
        self._callbacks.add(handle)
        return handle

    def remove_parameter_event_callback(self, handle: ParameterEventCallbackHandle) -> None:
        """Undo `add_parameter_event_callback`; RuntimeError if that was done before."""
        self._callbacks.remove(handle)

    def _resolve_path(self, node_path: str | None = None) -> str:
        if not node_path:
            return self.node.get_fully_qualified_name()
        return node_path if node_path.startswith("/") else f"{self.node.get_namespace().rstrip('/')}/{node_path}"
