"""Callbacks for changes of parameters, of this node or of others."""

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import chain
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterEvent
from rclpy.qos import QoSProfile, qos_profile_parameter_events


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


def _remove(handles: list[Any], handle: Any) -> None:
    if handle not in handles:
        raise RuntimeError("Callback doesn't exist")
    handles.remove(handle)


class ParameterEventHandler:
    """Calls callbacks for the events on ``/parameter_events``, of one parameter or all, the latest added first.

    The node must be spun; the options are those of the subscription.
    """

    class Callbacks:
        """The callbacks: of a parameter by its name and its node's, and of every event."""

        def __init__(self) -> None:
            self.parameter_callbacks: defaultdict[tuple[str, str], list[ParameterCallbackHandle]] = defaultdict(list)
            self.event_callbacks: list[ParameterEventCallbackHandle] = []

        def event_callback(self, event: ParameterEvent) -> None:
            """Call those that an event concerns."""
            # Copies: a callback or another thread may add and remove some meanwhile.
            for (name, node), handles in list(self.parameter_callbacks.items()):
                parameter = ParameterEventHandler.get_parameter_from_event(event, name, node)
                for handle in list(handles) if parameter is not None else ():
                    handle.callback(parameter)
            for entry in list(self.event_callbacks):
                entry.callback(event)

    def __init__(self, node: Any, qos_profile: QoSProfile = qos_profile_parameter_events, **options: Any) -> None:
        self.node = node
        self.qos_profile = qos_profile
        self._callbacks = ParameterEventHandler.Callbacks()
        self.parameter_event_subscription = node.create_subscription(
            ParameterEvent, "/parameter_events", self._callbacks.event_callback, qos_profile, **options
        )

    def destroy(self) -> None:
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
        return chain(event.new_parameters, event.changed_parameters)

    def add_parameter_callback(
        self, parameter_name: str, node_name: str, callback: Callable[[Any], None]
    ) -> ParameterCallbackHandle:
        """Call `callback` with the parameter message when that parameter of that node is set.

        A relative `node_name` is in the namespace of the handler's node, an empty one is that node.
        """
        handle = ParameterCallbackHandle(parameter_name, self._resolve_path(node_name), callback)
        self._callbacks.parameter_callbacks[parameter_name, handle.node_name].insert(0, handle)
        return handle

    def remove_parameter_callback(self, handle: ParameterCallbackHandle) -> None:
        """Remove a callback for a parameter; RuntimeError if it is not there."""
        callbacks, key = self._callbacks.parameter_callbacks, (handle.parameter_name, handle.node_name)
        _remove(callbacks.get(key, []), handle)
        if not callbacks[key]:
            callbacks.pop(key, None)

    def add_parameter_event_callback(self, callback: Callable[[Any], None]) -> ParameterEventCallbackHandle:
        handle = ParameterEventCallbackHandle(callback)
        self._callbacks.event_callbacks.insert(0, handle)
        return handle

    def remove_parameter_event_callback(self, handle: ParameterEventCallbackHandle) -> None:
        """Remove a callback for every event; RuntimeError if it is not there."""
        _remove(self._callbacks.event_callbacks, handle)

    def _resolve_path(self, node_path: str = "") -> str:
        path: str = node_path or self.node.get_fully_qualified_name()
        return path if path.startswith("/") else f"{self.node.get_namespace().rstrip('/')}/{path}"
